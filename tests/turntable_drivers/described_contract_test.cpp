// The driver of described tables against the twin: the contract of every table, with two very different maps over TCP and RTU, with each of
// the shipped dialects, and with those of our own invention.
#include <gtest/gtest.h>

#include "tests/turntable_drivers/served_twin.h"
#include "tests/turntable_drivers/table_contract.h"

namespace turncal {
namespace {

template <bool tcp, bool circle>
struct ModbusFactory : DescribedFactory<TwinStation, ModbusTurntable> {
  ModbusFactory()
      : DescribedFactory(map_of(circle ? circle_map_text(tcp ? "tcp" : "rtu") : plain_map_text(tcp ? "tcp" : "rtu"))) {}
  static constexpr double beyond_limits_deg = 3601.0;  // refused by the twin
};
using PlainTcp = ModbusFactory<true, false>;
using PlainRtu = ModbusFactory<false, false>;
using CircleTcp = ModbusFactory<true, true>;
using CircleRtu = ModbusFactory<false, true>;
INSTANTIATE_TYPED_TEST_SUITE_P(ModbusTcp, TableContract, PlainTcp);
INSTANTIATE_TYPED_TEST_SUITE_P(ModbusRtu, TableContract, PlainRtu);
INSTANTIATE_TYPED_TEST_SUITE_P(ModbusCircleTcp, TableContract, CircleTcp);
INSTANTIATE_TYPED_TEST_SUITE_P(ModbusCircleRtu, TableContract, CircleRtu);

enum class Which { dollar, acutronic, newport, pi, own_dollar, own_bits, own_prompt };
constexpr const char* names[] = {"three_axis_dollar", "acutronic_acl", "newport_esp30x", "pi_gcs2",
                                 "own_dollar",        "own_bits",      "own_prompt"};

template <Which which, bool tcp>
struct DialectFactory : DescribedFactory<DialectStation, SerialTurntable> {
  DialectFactory() : DescribedFactory(shipped_dialect(names[static_cast<int>(which)], tcp)) {}
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
