// Modbus tables that are one controller: the contract of every table with each map, and what is special about them.

#include "tests/turntable_drivers/served_twin.h"
#include "tests/turntable_drivers/table_contract.h"

namespace turncal {
namespace {

// Modbus RTU through a serial server. One block of the whole table: masks of each axis in a shared word, a state code and numbers of
// 64 bits for each; all three angles in one command block; a heartbeat of two documented values.
const std::string one_block = own_map_text("one_block");
// Status registers of each axis with an offset; the mode, the word that says who commands and the heartbeat are of the whole table; one
// command block, in front of which stands the number of the axis.
const std::string selecting = own_map_text("selecting");

template <const std::string& text>
struct MapFactory : DescribedFactory<TwinStation> {
  MapFactory() : DescribedFactory(map_of(text)) {}
  static constexpr double beyond_limits_deg = 3601.0;
};
using OneBlock = MapFactory<one_block>;
using Selecting = MapFactory<selecting>;
INSTANTIATE_TYPED_TEST_SUITE_P(ModbusOneBlock, TableContract, OneBlock);
INSTANTIATE_TYPED_TEST_SUITE_P(ModbusSelecting, TableContract, Selecting);

using MapTable = FaultTable<TwinStation>;

// Each axis reads its own, at three different angles, and a code that is not listed sets none of the flags.
TEST(ModbusForms, EveryAxisReadsItsOwn) {
  for (const std::string& text : {one_block, selecting}) {
    MapTable s(map_of(text));
    EXPECT_EQ(s.expect_truth(5), 15);
  }
  StatusBit bit;
  bit.mask = 0x0F00;
  bit.codes = {3, 5};
  EXPECT_TRUE(bit.is_set(0xF3FF));
  EXPECT_TRUE(bit.is_set(0x0500));
  EXPECT_FALSE(bit.is_set(0x0700)) << "the bits of 3 and 5 together are another code";
  EXPECT_FALSE(bit.is_set(0x0003));
}

// The move of one axis leaves the others where they are, or on their way; after a stop nothing goes on with its old target.
TEST(ModbusForms, AMoveOfOneAxisTellsTheOthersNothingNew) {
  MapTable s(map_of(one_block));
  s.make_ready();
  const auto position = [&](Axis axis) {
    const Result<AxisStatus> now = s.driver.status(axis);
    EXPECT_OK(now);
    return now.ok() ? now->position_deg : 1e9;
  };
  const auto pass = [&](double seconds) {
    for (double t = 0.0; t < seconds; t += 0.2) {
      s.station.pass(0.2);
      position(Axis::heading);  // which feeds the watchdog
    }
  };
  ASSERT_TRUE(s.driver.move_absolute(Axis::heading, 30.0, 10.0, 20.0).ok());
  pass(1.0);
  ASSERT_TRUE(s.driver.move_absolute(Axis::roll, -5.0, 10.0, 20.0).ok());
  pass(6.0);
  EXPECT_NEAR(position(Axis::heading), 30.0, 1e-3) << "its move came to its end";
  EXPECT_NEAR(position(Axis::roll), -5.0, 1e-3);
  EXPECT_NEAR(position(Axis::pitch), 0.0, 1e-3);
  ASSERT_TRUE(s.driver.move_absolute(Axis::heading, 90.0, 10.0, 20.0).ok());
  pass(1.0);
  ASSERT_TRUE(s.driver.stop_all().ok());
  pass(3.0);
  const double stopped_deg = position(Axis::heading);
  EXPECT_LT(stopped_deg, 60.0);
  ASSERT_TRUE(s.driver.move_absolute(Axis::roll, 5.0, 10.0, 20.0).ok());
  pass(4.0);
  EXPECT_NEAR(position(Axis::roll), 5.0, 1e-3);
  EXPECT_NEAR(position(Axis::heading), stopped_deg, 1e-3) << "it went on to the target that was given up";
}

// The documented values in turn, once for the table; a value that stays the same is none, and the watchdog stops the drives.
TEST(ModbusForms, HeartbeatHasItsDocumentedValues) {
  MapTable s(map_of(one_block));
  std::vector<std::uint16_t> beats;
  s.station.disturb([&](const ModbusRequest& request, AnswerPlan&) {
    if (request.address == 0x230) beats.push_back(request.values.front());
  });
  s.make_ready();
  for (int i = 0; i < 10; ++i) {
    s.station.pass(0.25);
    for (const Axis axis : all_axes) EXPECT_TRUE(s.driver.status(axis).ok());
  }
  ASSERT_GE(beats.size(), 10u);
  for (std::size_t i = 0; i < beats.size(); ++i) {
    EXPECT_TRUE(beats[i] == 0x55 || beats[i] == 0xAA);
    EXPECT_TRUE(i == 0 || beats[i] != beats[i - 1]) << "the same twice";
  }
  RegisterMap stuck = map_of(one_block);
  stuck.heartbeat_values = {0x55};
  Rig rig(default_rig_config());
  RigTable mock(rig);
  RigClock clock(rig);
  ModbusTwin twin(map_of(one_block), mock, clock);
  ASSERT_TRUE(twin.power_on().ok());
  ASSERT_TRUE(mock.enable().ok());
  const ModbusRequest same{.unit = 9, .function = 6, .address = 0x230, .count = 1, .values = {0x55}};
  std::vector<ImuSample> samples(100);
  for (int i = 0; i < 6; ++i) {
    EXPECT_EQ(twin.handle(same).exception, 0);
    rig.advance(samples);
  }
  twin.tick();
  EXPECT_TRUE(twin.watchdog_tripped(Axis::pitch));
}

// Through a serial server a late answer is told by unit, function and length, as on the serial line.
TEST(ModbusForms, RtuOverTcpBelievesNoLateAnswer) {
  RegisterMap map = map_of(one_block);
  map.link.reply_timeout_s = 0.1;
  map.link.byte_timeout_s = 0.03;
  map.heartbeat_address.reset();
  MapTable s(map);
  std::vector<std::uint8_t> before;
  s.station.disturb([&before](const ModbusRequest& request, AnswerPlan& plan) {
    if (request.function != 3) return;
    std::swap(before, plan.pieces[0].bytes);  // every answer is that of the request before
  });
  EXPECT_EQ(s.expect_truth(4), 12) << "by its length; the second try has its own";
  s.station.disturb([](const ModbusRequest&, AnswerPlan& plan) { plan.pieces[0].bytes.back() ^= 0x01; });
  EXPECT_EQ(s.expect_truth(1), 0) << "a wrong CRC";
}

TEST(ModbusForms, DefectsAreNamed) {
  const auto expect = [](const std::string& text, const std::string& what, const std::string& with, const char* said) {
    EXPECT_TRUE(fails(parse_register_map(replaced(text, what, with), "my.map"), said));
  };
  const std::string &block = one_block, &select = selecting;
  expect(block, "link.kind = rtu_tcp", "link.kind = rtu_udp", "expected tcp, rtu or rtu_tcp");
  expect(block, "axis.roll.bit.homed.mask = 0x400\n", "", "'bit.homed.mask' is missing");
  expect(block, "axis.roll.position.address = 0x10C", "axis.roll.position.address = 0x119", "inside the status block");
  expect(block, "bit.fault.codes = 7, 8", "bit.fault.codes = 7, 256", "numbers from 0 to 255");
  expect(block, "bit.fault.codes = 7, 8", "bit.fault.codes =", "bit.fault.codes");
  expect(block, "write.abort.scope = table", "write.abort.scope = axis", "the same scope as write.abort");
  expect(block, "f64 position.pitch", "f64 position", "with write.move.scope = table");
  expect(block, "f64 position.pitch", "f96 position.pitch", "steps 'ADDRESS TYPE VALUE'");
  expect(block, "heartbeat.values = 0x55, 0xAA", "heartbeat.values = 0x55, x", "numbers from 0 to 65535");
  expect(block, "heartbeat.scope = table", "heartbeat.scope = all", "axis or table");
  expect(select, "u16 axis + s32 position +", "u16 axis + s32 position.roll +", "else without an axis");
  expect(select, "write.setup = table 0x940", "write.setup = globe 0x940", "steps 'ADDRESS TYPE VALUE'");
  expect(select, "status2.scope = table", "status2.scope = none", "axis or table");
  expect(select, "axis.roll.code = 30", "axis.roll.code = -1", "between 0 and 65535");
  expect(select, "axis.roll.code = 30", "axis.roll.name = 3", "axis.roll.name");
  // What a run has to be told must be sayable.
  expect(block, "axis.pitch.bit.in_position.mask = 0x020",
         "axis.pitch.bit.in_position.mask = 0x020\nbit.remote.mask = "
         "0x002\nbit.remote.active = low\nbit.remote.address = 0x100",
         "'bit.remote.mask'");
  expect(block, "axis.roll.bit.homed.mask = 0x400", "axis.roll.bit.homed.mask = 0x004", "not those of bit.enabled");
  expect(block, "bit.moving.codes = 2", "bit.moving.codes = 7", "a status that can say of an axis that it moves");
  expect(block, "axis.roll.bit.homed.mask = 0x400", "axis.roll.bit.homed.mask = 0x040", "'axis.roll.bit.homed.mask'");
  expect(block, "axis.roll.bit.in_position.mask = 0x040", "axis.roll.bit.in_position.mask = 0xFC",
         "not those of bit.enabled");
  expect(select, "axis.roll.address_offset = 0x200", "axis.roll.address_offset = 0xFFFF",
         "at most 65513: the last register used is 22 without it");
  expect(select, "heartbeat.address = 0x960\nheartbeat.scope = table", "heartbeat.address = 0x12", "heartbeat.address");
  expect(select, "bit.in_position.codes = 1, 3", "bit.in_position.codes = 2, 9", "that it has arrived");
  expect(select, "bit.enabled.codes = 1, 2, 3", "bit.enabled.codes = 1, 3", "that it moves");
  expect(select, "rate.address = 0x13", "rate.address = 0x12", "a register of its own: the position is there");
  expect(select, "bit.fault.address = 0x10", "bit.fault.address = 0x11",
         "a register of its own: the position is there");
  expect(block, "axis.pitch.sign = -1", "axis.pitch.sign = -1\naxis.pitch.modulo_deg = 1e-3", "a circle of 90 to 3600");
  expect(block, "link.quiet_s = 0.1", "link.quiet_s = 0.1\nmoving.rate_degps = 500", "between 1e-06 and 1");
  expect(block, "link.quiet_s = 0.1", "link.quiet_s = 0.1\nplausible.angle_deg = 1e-6", "between 1 and 1000000");
  expect(select, "axis.pitch.counts_per_degree = 10000", "axis.pitch.counts_per_degree = 1e99",
         "between 1e-06 and 1000000000");
}

}  // namespace
}  // namespace turncal
