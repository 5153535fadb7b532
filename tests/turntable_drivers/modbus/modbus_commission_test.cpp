// Word order, sign and scale of a map that is not its drives: nothing moves, and commissioning says which fit.
#include <gtest/gtest.h>

#include "tests/turntable_drivers/served_twin.h"

namespace turncal {
namespace {

// The map's word order is the other one: no number that comes out of it is believed, and nothing moves.
TEST(ModbusCommission, SwappedWords) {
  RigConfig config = default_rig_config();
  config.table.power_on_deg = {90.0, 90.0, 90.0};  // 900000 = 0x000DBBA0, swapped -1147142131
  RegisterMap map = map_of(plain_map_text("tcp"));
  TwinStation station(map, config);
  RegisterMap wrong = station.described;
  wrong.layout.high_word_first = false;
  ModbusTurntable driver(wrong, station.clock);
  const Status status = driver.connect();
  ASSERT_FALSE(status.ok());
  EXPECT_NE(status.error().message.find("word order"), std::string::npos) << status.error().message;
}

TEST(ModbusCommission, CommissioningNamesTheOrderThatFits) {
  RigConfig config = default_rig_config();
  config.table.power_on_deg = {0.1, 0.1, 0.1};
  RegisterMap map = map_of(plain_map_text("tcp"));
  map.axis[2].zero_deg = 0.0;
  map.axis[1].sign = 1;
  TwinStation station(map, config);
  const AxisTriple known{{0.1, 0.1, 0.1}};
  {
    ModbusTurntable right(station.described, station.clock);
    ASSERT_TRUE(right.connect().ok());
    const Status status = right.commission(known, 0.01);
    EXPECT_TRUE(status.ok()) << (status.ok() ? "" : status.error().message);
    EXPECT_FALSE(right.commission({{0.2, 0.1, 0.1}}, 0.01).ok());
  }
  RegisterMap wrong = station.described;  // 1000 = 0x03E8 reads 65536000 the other way round
  wrong.layout.high_word_first = false;
  wrong.plausible_deg = 1000.0;
  wrong.commissioned = false;
  ModbusTurntable driver(wrong, station.clock);
  EXPECT_FALSE(driver.connect().ok()) << "no such position is plausible";
  const Status status = driver.commission(known, 0.01);
  ASSERT_FALSE(status.ok());
  EXPECT_NE(status.error().message.find("words.order = high_first"), std::string::npos) << status.error().message;
  EXPECT_EQ(driver.enable().error().kind, ErrorKind::input) << "nothing is switched on either";
  EXPECT_EQ(driver.home().error().kind, ErrorKind::input);
  EXPECT_EQ(driver.move_absolute(Axis::roll, 5.0, 10.0, 10.0).error().kind, ErrorKind::input);
}

TEST(ModbusCommission, ZeroCannotCommission) {
  RegisterMap map = map_of(plain_map_text("tcp"));
  map.axis[2].zero_deg = 0.0;
  TwinStation station(map);
  ModbusTurntable driver(station.described, station.clock);
  ASSERT_TRUE(driver.connect().ok());
  const Status status = driver.commission({}, 0.01);
  ASSERT_FALSE(status.ok());
  EXPECT_NE(status.error().message.find("other settings fit as well"), std::string::npos) << status.error().message;
}

}  // namespace
}  // namespace turncal
