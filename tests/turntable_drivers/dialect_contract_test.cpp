// The ASCII driver with each of the four shipped dialects, and with those of our own invention, against the twin: the contract of every table.
#include <gtest/gtest.h>

#include "tests/turntable_drivers/dialect_station.h"
#include "tests/turntable_drivers/table_contract.h"

namespace turncal {
namespace {

enum class Which { dollar, acutronic, newport, pi, own_dollar, own_bits, own_prompt };
constexpr const char* names[] = {"three_axis_dollar", "acutronic_acl", "newport_esp30x", "pi_gcs2",
                                 "own_dollar",        "own_bits",      "own_prompt"};

template <Which which, bool tcp>
struct DialectFactory {
  DialectStation station{shipped_dialect(names[static_cast<int>(which)], tcp)};
  SerialTurntable driver{station.described, station.clock};
  Turntable& table() { return driver; }
  void pass(double seconds) { station.pass(seconds); }
  static constexpr double tolerance_deg = 1e-3;
  static constexpr double beyond_limits_deg = 7201.0;  // where a device answers nothing, only the driver can refuse
  static constexpr bool must_home = true, must_enable = true;
};
using Dollar = DialectFactory<Which::dollar, false>;
using Acutronic = DialectFactory<Which::acutronic, true>;
using Newport = DialectFactory<Which::newport, false>;
using Pi = DialectFactory<Which::pi, false>;
using PiTcp = DialectFactory<Which::pi, true>;
using OwnDollar = DialectFactory<Which::own_dollar, false>;
using OwnBits = DialectFactory<Which::own_bits, true>;
using OwnPrompt = DialectFactory<Which::own_prompt, false>;
INSTANTIATE_TYPED_TEST_SUITE_P(DollarSerial, TableContract, Dollar);
INSTANTIATE_TYPED_TEST_SUITE_P(AcutronicTcp, TableContract, Acutronic);
INSTANTIATE_TYPED_TEST_SUITE_P(NewportSerial, TableContract, Newport);
INSTANTIATE_TYPED_TEST_SUITE_P(PiSerial, TableContract, Pi);
INSTANTIATE_TYPED_TEST_SUITE_P(PiTcp, TableContract, PiTcp);
INSTANTIATE_TYPED_TEST_SUITE_P(OwnDollarSerial, TableContract, OwnDollar);
INSTANTIATE_TYPED_TEST_SUITE_P(OwnBitsTcp, TableContract, OwnBits);
INSTANTIATE_TYPED_TEST_SUITE_P(OwnPromptSerial, TableContract, OwnPrompt);

}  // namespace
}  // namespace turncal
