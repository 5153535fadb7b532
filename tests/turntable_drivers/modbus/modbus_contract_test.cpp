// The Modbus driver against the twin, over TCP and RTU, with two very different maps: the contract of every table.
#include "turntable_drivers/modbus/modbus_turntable.h"

#include <gtest/gtest.h>

#include "tests/turntable_drivers/table_contract.h"
#include "tests/turntable_drivers/twin_station.h"

namespace turncal {
namespace {

template <bool tcp, bool circle>
struct ModbusFactory {
  TwinStation station{map_of(circle ? circle_map_text(tcp ? "tcp" : "rtu") : plain_map_text(tcp ? "tcp" : "rtu"))};
  ModbusTurntable driver{station.described, station.clock};
  Turntable& table() { return driver; }
  void pass(double seconds) { station.pass(seconds); }
  static constexpr double tolerance_deg = 1e-3;
  static constexpr double beyond_limits_deg = 3601.0;
  static constexpr bool must_home = true, must_enable = true;
};
using PlainTcp = ModbusFactory<true, false>;
using PlainRtu = ModbusFactory<false, false>;
using CircleTcp = ModbusFactory<true, true>;
using CircleRtu = ModbusFactory<false, true>;
INSTANTIATE_TYPED_TEST_SUITE_P(ModbusTcp, TableContract, PlainTcp);
INSTANTIATE_TYPED_TEST_SUITE_P(ModbusRtu, TableContract, PlainRtu);
INSTANTIATE_TYPED_TEST_SUITE_P(ModbusCircleTcp, TableContract, CircleTcp);
INSTANTIATE_TYPED_TEST_SUITE_P(ModbusCircleRtu, TableContract, CircleRtu);

}  // namespace
}  // namespace turncal
