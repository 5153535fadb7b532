// The register map's text: every defect is named with its line, and the maps that ship say what they are and work with the twin.
#include "turntable_drivers/modbus/register_map.h"

#include "tests/turntable_drivers/served_twin.h"
#include "tests/turntable_drivers/table_contract.h"
#include "turntable_drivers/modbus/modbus_frame.h"
#include "turntable_drivers/table/table_description.h"

namespace turncal {
namespace {

std::string map_error(const std::string& what, const std::string& with) {
  const Result<RegisterMap> map = parse_register_map(replaced(plain_map_text("rtu"), what, with), "my.map");
  if (map.ok()) return "accepted";
  EXPECT_EQ(map.error().kind, ErrorKind::input);
  EXPECT_SAYS_NOT(map.error().message, "\n");
  return map.error().message;
}

void map_refused(const std::string& what, const std::string& with, const char* said) {
  EXPECT_SAYS(map_error(what, with), said) << what << ": " << with;
}

TEST(RegisterMap, EveryKeyArrives) {
  const RegisterMap map = map_of(plain_map_text("rtu"));
  EXPECT_EQ(map.name, "three plain drives");
  EXPECT_FALSE(map.link.tcp);
  EXPECT_EQ(map.link.serial.parity, SerialParity::even) << "the protocol's default";
  EXPECT_EQ(map.of(Axis::roll).unit, 3);
  EXPECT_EQ(map.of(Axis::pitch).sign, -1);
  EXPECT_EQ(map.of(Axis::roll).units_of(13.5), 10000.0);
  EXPECT_EQ(map.of(Axis::pitch).angle_of(25000.0), -2.5);
  EXPECT_EQ(map.alarm_text.at(0x26), "overload");
  ASSERT_EQ(map.list(TableOperation::move).size(), 2u);
  EXPECT_EQ(map.list(TableOperation::move)[0].length(), 6);
  EXPECT_EQ(map.list(TableOperation::move)[0].address, 0x210);
  EXPECT_EQ(map.of(Axis::roll).bit(DriveBit::emergency_stop)->active_high, false);
  EXPECT_FALSE(map.of(Axis::heading).bit(DriveBit::limit_negative));
}

TEST(RegisterMap, DefectsAreNamed) {
  EXPECT_EQ(map_error("words.order = high_first", "words.order = big"),
            "my.map:16: key 'words.order' = 'big': expected high_first or low_first");
  map_refused("words.order = high_first\n", "", "'words.order' is missing");
  map_refused("position.address = 0x100", "position.address = 0x105", "inside the status block");
  map_refused("position.address = 0x100", "position.address = 0xZZ", "decimal or with 0x");
  map_refused("bit.fault.address = 0x105\nbit.fault.mask = 4\n", "", "'bit.fault.address' is missing");
  map_refused("bit.homed.address = 0x105\nbit.homed.mask = 0x10\n", "", "'bit.homed.address' is missing");
  map_refused("write.stop = ", "# write.stop = ", "'write.stop' is missing");
  map_refused("write.abort = 0x203 u16 1", "write.abort = 0x203 u16 70000", "fit their type");
  map_refused("write.abort = 0x203 u16 1", "write.abort = 0x203 u16 position", "belong to write.move");
  map_refused("write.abort = 0x203 u16 1", "write.abort = 0x203 u99 1", "steps 'ADDRESS TYPE VALUE'");
  EXPECT_SAYS(map_error("write.abort = 0x203 u16 1", "write.abort = wait 3"), "steps 'ADDRESS TYPE VALUE'")
      << "a stop would wait for it";
  map_refused("write.abort = 0x203 u16 1", "write.abort = wait 0.06, 0x203 u16 1", "waits of at most 0.05 s");
  map_refused("write.stop = 0x202 u16 1, 0x202 u16 0", "write.stop = 0x202 u16 1, wait 0.03, wait 0.03, 0x202 u16 0",
              "at most 0.05 s together, not 0.06");
  EXPECT_EQ(map_error("write.enable = 0x200 u16 1", "write.enable = 0x200 u16 1, wait 1"), "accepted");
  map_refused("s32 position + u32 rate", "s32 distance + s32 position + u32 rate", "either position or distance");
  map_refused("", "axis.roll.modulo_deg = 360\n", "distance: with modulo_deg");
  map_refused("heartbeat.watchdog_s = 1", "heartbeat.watchdog_s = 0.3", "at least twice");
  map_refused("heartbeat.period_s = 0.2", "heartbeat.period_s = 2e-10", "number between 0.001 and 60");
  map_refused("heartbeat.watchdog_s = 1", "heartbeat.watchdog_s = 1e-308", "number between 0.01 and 600");
  map_refused("", "status2.address = 0x300\nstatus2.count = 8\n", "its own length");
  map_refused("", "bit.moveing.mask = 3\n", "bit.moveing.mask");
  map_refused("", "bit.moving.kind = pulse\n", "only in_position");
}

class ShippedMap : public testing::TestWithParam<const char*> {};

// Opening, stopping or the heartbeat must not be what enables a drive, homes or moves it.
TEST(RegisterMap, AStopThatCannotStopIsRefused) {
  const std::string stop = "write.stop = 0x202 u16 1, 0x202 u16 0", abort = "write.abort = 0x203 u16 1",
                    enable = "write.enable = 0x200 u16 1", home = "write.home = 0x201 u16 1, 0x201 u16 0";
  for (const std::string& line : {stop, abort, enable, home}) {
    const std::string key = line.substr(0, line.find(' '));
    for (const char* const nothing : {" =", " = wait 0.01"}) {
      const std::string said = map_error(line, key + nothing);
      EXPECT_SAYS(said, "at least one write of a register") << key << nothing << ": ";
      EXPECT_SAYS_NOT(said, "\n");
    }
  }
  // Off, and on again with the word that only holds a drive.
  const std::string word = "write.enable = 0x200 u16 0xF";
  const std::string text = replaced(replaced(plain_map_text("tcp"), enable, word), abort,
                                    "write.abort = 0x200 u16 0, wait 0.05, 0x200 u16 0x10F");
  const Result<RegisterMap> again = parse_register_map(text, "my.map");
  ASSERT_TRUE(fails(again, "write.abort"));
  EXPECT_TRUE(fails(again, "holds the bits of write.enable"));
  EXPECT_TRUE(parse_register_map(text + "switch_off = false\n", "my.map").ok());
}

TEST(RegisterMap, WritesThatWouldMoveUnderAnotherNameAreRefused) {
  EXPECT_EQ(map_error("", "write.setup = 0x200 u16 1\n"),
            "my.map:50: key 'write.setup' = '0x200 u16 1': expected no write of 1 (0x1) to register 512 (0x200) of "
            "axis.heading, which is write.enable: it would switch the drive on; write another value, without the bits "
            "1 (0x1), or, if it takes the numbers of commands and not bits, name it in write.codes");
  map_refused("", "write.setup = 0x300 u16 1, 0x201 u16 1\n", "which is write.home");
  map_refused("", "write.setup = 0x216 u16 1\n", "which is write.move");
  const std::string stop = "write.stop = 0x202 u16 1, 0x202 u16 0", abort = "write.abort = 0x203 u16 1",
                    clear = "write.clear_fault = 0x204 u16 1, 0x204 u16 0", beat = "heartbeat.address = 0x220";
  map_refused(stop, stop + ", 0x200 u16 1", "'write.stop'");
  map_refused(abort, abort + ", 0x216 u16 1", "'write.abort'");
  map_refused(clear, clear + ", 0x200 u16 1", "'write.clear_fault'");
  map_refused(beat, "heartbeat.address = 0x201", "which is write.home");
  for (const std::string of_stop : {"0x202", "0x203"})
    EXPECT_SAYS(map_error(beat, "heartbeat.address = " + of_stop), "the count would take it back") << of_stop;
  map_refused(beat, "heartbeat.address = 0x200\nheartbeat.values = 7, 1", "'heartbeat.values'");
  // Half of a number of 32 bits is a register as well, whichever half the drive takes for the high one.
  map_refused("", "write.setup = 0x200 s32 65536, 0x1ff s32 1\n", "which is write.enable");
  map_refused(stop, stop + ", 0x215 s32 1, 0x215 s32 65536", "which is write.move");
  // The same registers with other values, and a release, start nothing.
  EXPECT_EQ(map_error("", "write.setup = 0x200 u16 2, 0x216 u16 2\n"), "accepted");
  EXPECT_SAYS(map_error(clear, clear + ", 0x216 u16 1, 0x216 u16 0"), "which is write.move")
      << "a release does not make good what went before";
  EXPECT_EQ(map_error(clear, clear + ", 0x216 u16 2, 0x216 u16 0"), "accepted");
  EXPECT_EQ(map_error(beat, "heartbeat.address = 0x200\nheartbeat.values = 6, 8"), "accepted");
}

// Bits of a control word do what they do, whatever stands beside them and however they are written.
TEST(RegisterMap, BitsThatEnableUnderAnotherNameAreRefused) {
  const std::string enable = "write.enable = 0x200 u16 1", abort = "write.abort = 0x203 u16 1",
                    stop = "write.stop = 0x202 u16 1, 0x202 u16 0", beat = "heartbeat.address = 0x220",
                    clear = "write.clear_fault = 0x204 u16 1, 0x204 u16 0";
  EXPECT_EQ(
      map_error("", "write.setup = 0x200 u16 0x8001\n"),
      "my.map:50: key 'write.setup' = '0x200 u16 0x8001': expected no write of 32769 (0x8001) to register "
      "512 (0x200) of axis.heading, which holds the bits of write.enable, 1 (0x1): it would switch the drive on; write "
      "another value, without the bits 1 (0x1), or, if it takes the numbers of commands and not bits, name it in "
      "write.codes");
  EXPECT_EQ(map_error("", "write.setup = 0x200 u16 0x8001\nwrite.codes = 0x200\n"), "accepted");
  map_refused("", "write.setup = 0x200 s16 -1\n", "'write.setup'");
  map_refused("", "write.setup = 0x1FF u16 0 + u16 3\n", "'write.setup'");
  map_refused("", "write.setup = 0x1FF u32 3\n", "'write.setup'");
  map_refused("", "write.setup = 0x1FE f64 5e-324, 0x200 s32 -1\n", "'write.setup'");
  map_refused("", "write.setup = 0x216 u16 3\n", "which holds the bits of write.move");
  map_refused(beat, "heartbeat.address = 0x200\nheartbeat.values = 0x8001, 0x8000", "'heartbeat.values'");
  map_refused(clear, "write.clear_fault = 0x200 u16 0x81", "'write.clear_fault'");
  map_refused(abort, "write.abort = 0x200 u16 0x4001", "'write.abort'");
  map_refused(abort, "write.abort = 0x200 u16 0x4001, 0x200 u16 0", "'write.abort'");
  map_refused(stop, "write.stop = 0x216 u16 0x8001", "which holds the bits of write.move");
  EXPECT_EQ(map_error(stop, "write.stop = 0x200 u16 0x101"), "accepted") << "a brake with the drive on: check warns";
  EXPECT_EQ(map_error(abort, "write.abort = 0x200 u16 0x4000"), "accepted");
  // A drive that is on without a bit: what lacks the bit by which it is switched off switches it on.
  const std::string text = replaced(replaced(plain_map_text("tcp"), enable, "write.enable = 0x200 u16 0"), abort,
                                    "write.abort = 0x200 u16 0x40");
  EXPECT_TRUE(parse_register_map(text + "write.setup = 0x200 u16 0xC0\n", "my.map").ok());
  EXPECT_FALSE(parse_register_map(text + "write.setup = 0x200 u16 0x80\n", "my.map").ok());
  EXPECT_FALSE(parse_register_map(text + "write.setup = 0x200 u16 0x40, 0x200 u16 0\n", "my.map").ok());
}

TEST(RegisterMap, AMoveThatTheRegistersCannotHoldIsSaid) {
  const auto said_of = [](const std::string& what, const std::string& with, double position_deg, double rate_degps) {
    Moves moves;
    moves[0] = {position_deg, position_deg, rate_degps, 10.0};
    const Status fits = check_move(map_of(replaced(plain_map_text("tcp"), what, with)), Axis::heading, moves);
    return fits ? "fits" : fits.error().message;
  };
  const std::string counts = "axis.heading.counts_per_degree = 10000", move = "s32 position + u32 rate";
  EXPECT_EQ(said_of(counts, counts, 540.0, 100.0), "fits");
  const std::string rate = counts + "\naxis.heading.rate_scale = ";
  EXPECT_SAYS(said_of(counts, "axis.heading.counts_per_degree = 1e9", 90.0, 1.0),
              ": write.move: register 528 cannot hold 90000000000: expected another type than s32, "
              "or another axis.heading.counts_per_degree");
  // The rate stands behind the position, in the register after its two.
  EXPECT_SAYS(said_of(counts, rate + "1e9", 90.0, 30.0),
              "register 530 cannot hold 30000000000: expected another type than u32, or another axis.heading.rate");
  // 30 deg/s would be 1.5, and is 2 to the drive: a third too fast.
  EXPECT_SAYS(said_of(counts, rate + "0.05", 90.0, 30.0), "register 530 cannot hold 1.5 to 5 %: expected another");
  EXPECT_EQ(said_of(counts, rate + "0.35", 90.0, 30.0), "fits") << "10.5 is told as 11";
  EXPECT_SAYS(said_of(counts, rate + "1e-4", 90.0, 1.0), "cannot hold");
  EXPECT_SAYS(said_of(counts, counts + "\naxis.heading.acceleration_scale = 1e-3", 90.0, 1.0), "cannot hold 0.01");
  EXPECT_SAYS(said_of(move, "s32 position + u16 rate", 90.0, 10.0), "cannot hold 100000");
  EXPECT_SAYS(said_of(move, "u16 position + u32 rate", 7.0, 1.0), "cannot hold 70000");
  EXPECT_SAYS(said_of("position.address = 0x100", "position.address = 0x100\nposition.type = u16", 7.0, 1.0),
              "cannot read 70000");
}

// One controller: a stop that goes to one axis only leaves the others on.
TEST(RegisterMap, AStopOfOneAxisAloneIsRefused) {
  const std::string text = replaced(
      replaced(plain_map_text("tcp"), "axis.pitch.unit = 2", "axis.pitch.unit = 1\naxis.pitch.address_offset = 0x1000"),
      "axis.roll.unit = 3", "axis.roll.unit = 1\naxis.roll.address_offset = 0x2000");
  const auto said_of = [&](const std::string& stop, const std::string& abort, const std::string& more) {
    const std::string changed =
        replaced(replaced(text + more, "write.stop = 0x202 u16 1, 0x202 u16 0", "write.stop = " + stop),
                 "write.abort = 0x203 u16 1", "write.abort = " + abort);
    const Result<RegisterMap> map = parse_register_map(changed, "my.map");
    return map.ok() ? "accepted" : map.error().message;
  };
  EXPECT_EQ(said_of("0x202 u16 1", "0x203 u16 1", ""), "accepted");
  EXPECT_EQ(said_of("table 0x900 u16 1", "table 0x900 u16 2", ""), "accepted") << "one register stops all";
  EXPECT_SAYS(said_of("0x202 u16 1", "table 0x200 u16 0", ""), "is that of axis.heading alone");
  EXPECT_SAYS(said_of("table 0x1200 u16 2", "0x203 u16 0", ""), "is that of axis.pitch alone");
  EXPECT_SAYS(said_of("0x200 u16 2", "0x200 u16 0", "write.stop.scope = table\nwrite.abort.scope = table\n"),
              "is that of axis.heading alone");
  map_refused("", "write.stop.scope = table\nwrite.abort.scope = table\n", "a unit of its own");
}

// A drive that is on may go where its target register says, without any other command.
TEST(RegisterMap, NothingButAMoveWritesWhereItGoes) {
  EXPECT_EQ(
      map_error("", "write.setup = 0x210 s32 0\n"),
      "my.map:50: key 'write.setup' = '0x210 s32 0': expected no write to register 528 (0x210) of axis.heading, "
      "where write.move says where to go: a drive that is on would start a motion; write to another register, and "
      "leave the place to write.move");
  EXPECT_SAYS(map_error("", "write.setup = 0x211 u16 5\n"), "'write.setup'") << "half of it";
  EXPECT_SAYS(map_error("", "write.setup = 0x20f s32 5\n"), "'write.setup'") << "half of it";
  EXPECT_EQ(map_error("", "write.setup = 0x212 u32 5, 0x20e s32 5\n"), "accepted") << "its neighbours";
  map_refused("heartbeat.address = 0x220", "heartbeat.address = 0x211", "where write.move says");
  const std::string stop = "write.stop = 0x202 u16 1, 0x202 u16 0";
  map_refused(stop, stop + ", 0x210 s32 0", "'write.stop'");
  // A command block: another command stands before it.
  const std::string move = "write.move = 0x210 s32 position + u32 rate + u32 acceleration, 0x216 u16 1";
  EXPECT_EQ(map_error(move,
                      "write.setup = 0x20f u16 9, 0x210 s32 0\nwrite.move = 0x20f u16 7, 0x210 s32 position + u32 "
                      "rate + u32 acceleration, 0x216 u16 1"),
            "accepted");
}

TEST(RegisterMap, AxesThatCannotBeToldApartAreRefused) {
  map_refused("axis.pitch.unit = 2", "axis.pitch.unit = 1", "not those of axis.heading: both read one position");
  map_refused("axis.roll.unit = 3", "axis.roll.unit = 2", "'axis.roll.unit'");
  map_refused("axis.pitch.unit = 2",
              "axis.pitch.unit = 1\naxis.pitch.position.address = 0x102\naxis.pitch.rate.address = 0x100",
              "one write.move moves both");
  const auto with_offset = [](const std::string& offset) {
    return map_error("axis.pitch.unit = 2", "axis.pitch.unit = 1\naxis.pitch.address_offset = " + offset);
  };
  EXPECT_SAYS(with_offset("1"), "both read one position") << "one of two registers";
  EXPECT_SAYS(with_offset("3"), "one write.move moves both") << "its position is the other's rate";
  EXPECT_NE(with_offset("0x10"), "accepted") << "its enable is the other's position";
  EXPECT_EQ(map_error("axis.pitch.unit = 2", "axis.pitch.unit = 1\naxis.pitch.address_offset = 0x1000"), "accepted");
}

TEST_P(ShippedMap, SaysThatItIsUnverifiedAndMovesTheTwin) {
  const std::string path = std::string(TURNCAL_SOURCE_DIR) + "/turntable_drivers/modbus/maps/" + GetParam() + ".map";
  Result<RegisterMap> read = good(read_register_map(path));
  EXPECT_FALSE(read->verified_on_hardware);
  EXPECT_FALSE(read->commissioned) << "no motion before the user has checked it";
  RegisterMap map = *read;
  map.link.quiet_s = 0.1;
  TwinStation station(map);
  {
    DescribedTurntable driver(station.described, station.clock);
    ASSERT_TRUE(driver.connect().ok());
    EXPECT_EQ(driver.enable().error().kind, ErrorKind::input) << "not commissioned";
    EXPECT_EQ(driver.home().error().kind, ErrorKind::input);
  }
  station.described.commissioned = true;
  DescribedTurntable driver(station.described, station.clock);
  ASSERT_OK(driver.connect());
  EXPECT_SAYS(driver.identify()->description, "not verified");
  ASSERT_TRUE(driver.enable().ok());
  ASSERT_TRUE(driver.home().ok());
  const auto wait_until = [&](const std::function<bool(const AxisStatus&)>& condition) {
    for (int i = 0; i < 200; ++i) {
      bool all = true;
      for (const Axis axis : all_axes) {
        const Result<AxisStatus> now = driver.status(axis);
        EXPECT_OK(now);
        all = all && now.ok() && condition(*now);
      }
      if (all) return true;
      station.pass(0.1);
    }
    return false;
  };
  ASSERT_TRUE(wait_until([](const AxisStatus& now) { return now.homed && !now.moving; }));
  for (const Axis axis : all_axes) ASSERT_OK(driver.move_absolute(axis, -30.0, 10.0, 10.0));
  station.pass(1.5);
  for (const Axis axis : all_axes) {
    // The twin's own axis, not what is read back through the same map.
    EXPECT_NEAR(station.rig.axis(axis).rate_degps, -10.0, 0.2) << to_string(axis);
    EXPECT_NEAR(driver.status(axis)->position_deg, station.rig.axis(axis).position_deg, 0.01);
  }
  ASSERT_TRUE(wait_until([](const AxisStatus& now) { return now.in_position && !now.moving; }));
  for (const Axis axis : all_axes) EXPECT_NEAR(station.rig.axis(axis).position_deg, -30.0, 0.005) << to_string(axis);
  ASSERT_TRUE(driver.move_absolute(Axis::heading, 60.0, 10.0, 10.0).ok());
  station.pass(2.0);
  ASSERT_TRUE(driver.stop_all().ok());
  station.pass(2.0);
  EXPECT_FALSE(station.rig.axis(Axis::heading).moving);
  EXPECT_LT(station.rig.axis(Axis::heading).position_deg, 0.0);
}

INSTANTIATE_TEST_SUITE_P(Maps, ShippedMap, testing::Values("oriental_az", "leadshine_pr", "delta_asda_a2"),
                         [](const auto& which) { return std::string(which.param); });

// ---- word order, sign and scale that are not the drives': nothing moves, and commissioning says which fit ----

// The map's word order is the other one: no number that comes out of it is believed, and nothing moves.
TEST(ModbusCommission, SwappedWords) {
  RigConfig config = default_rig_config();
  config.table.power_on_deg = {90.0, 90.0, 90.0};  // 900000 = 0x000DBBA0, swapped -1147142131
  RegisterMap map = map_of(plain_map_text("tcp"));
  TwinStation station(map, config);
  RegisterMap wrong = station.described;
  wrong.layout.high_word_first = false;
  DescribedTurntable driver(wrong, station.clock);
  ASSERT_TRUE(fails(driver.connect(), "word order"));
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
    DescribedTurntable right(station.described, station.clock);
    ASSERT_TRUE(right.connect().ok());
    EXPECT_OK(right.commission(known, 0.01));
    EXPECT_FALSE(right.commission({{0.2, 0.1, 0.1}}, 0.01).ok());
  }
  RegisterMap wrong = station.described;  // 1000 = 0x03E8 reads 65536000 the other way round
  wrong.layout.high_word_first = false;
  wrong.plausible_deg = 1000.0;
  wrong.commissioned = false;
  DescribedTurntable driver(wrong, station.clock);
  EXPECT_FALSE(driver.connect().ok()) << "no such position is plausible";
  ASSERT_TRUE(fails(driver.commission(known, 0.01), "words.order = high_first"));
  EXPECT_EQ(driver.enable().error().kind, ErrorKind::input) << "nothing is switched on either";
  EXPECT_EQ(driver.home().error().kind, ErrorKind::input);
  EXPECT_EQ(driver.move_absolute(Axis::roll, 5.0, 10.0, 10.0).error().kind, ErrorKind::input);
}

TEST(ModbusCommission, ZeroCannotCommission) {
  RegisterMap map = map_of(plain_map_text("tcp"));
  map.axis[2].zero_deg = 0.0;
  TwinStation station(map);
  DescribedTurntable driver(station.described, station.clock);
  ASSERT_TRUE(driver.connect().ok());
  ASSERT_TRUE(fails(driver.commission({}, 0.01), "other settings fit as well"));
}

// ---- numbers as registers

using V = std::vector<std::uint16_t>;
constexpr WordLayout high{true, false}, low{false, false}, high_swapped{true, true}, low_swapped{false, true};

V encoded(double value, WordType type, WordLayout layout) {
  const std::optional<Words> words = encode_words(value, type, layout);
  return words ? V(words->span().begin(), words->span().end()) : V{};
}

TEST(RegisterWords, SignAt7FFFAnd8000) {
  EXPECT_EQ(decode_words(V{0x7FFF}, WordType::s16, high), 32767.0);
  EXPECT_EQ(decode_words(V{0x8000}, WordType::s16, high), -32768.0);
  EXPECT_EQ(decode_words(V{0x8000}, WordType::u16, high), 32768.0);
  EXPECT_EQ(decode_words(V{0x0000, 0x7FFF}, WordType::s32, high), 32767.0);
  EXPECT_EQ(decode_words(V{0x0000, 0x8000}, WordType::s32, high), 32768.0);
  EXPECT_EQ(decode_words(V{0x7FFF, 0xFFFF}, WordType::s32, high), 2147483647.0);
  EXPECT_EQ(decode_words(V{0x8000, 0x0000}, WordType::s32, high), -2147483648.0);
  EXPECT_EQ(decode_words(V{0x8000, 0x0000}, WordType::u32, high), 2147483648.0);
  EXPECT_EQ(decode_words(V{0xFFFF, 0xFFFE}, WordType::s32, high), -2.0);
}

// 0x12345678 in the four orders that makers use, and 1.0f = 0x3F800000.
TEST(RegisterWords, OrderOfWordsAndBytes) {
  const double value = 0x12345678;
  EXPECT_EQ(encoded(value, WordType::u32, high), (V{0x1234, 0x5678}));
  EXPECT_EQ(encoded(value, WordType::u32, low), (V{0x5678, 0x1234}));
  EXPECT_EQ(encoded(value, WordType::u32, high_swapped), (V{0x3412, 0x7856}));
  EXPECT_EQ(encoded(value, WordType::u32, low_swapped), (V{0x7856, 0x3412}));
  EXPECT_EQ(encoded(1.0, WordType::f32, high), (V{0x3F80, 0x0000}));
  EXPECT_EQ(encoded(1.0, WordType::f32, low_swapped), (V{0x0000, 0x803F}));
  for (const WordLayout layout : {high, low, high_swapped, low_swapped}) {
    EXPECT_EQ(decode_words(encoded(value, WordType::u32, layout), WordType::u32, layout), value);
    EXPECT_EQ(decode_words(encoded(-1.5, WordType::f32, layout), WordType::f32, layout), -1.5);
    EXPECT_EQ(decode_words(encoded(-90001, WordType::s32, layout), WordType::s32, layout), -90001.0);
  }
  EXPECT_EQ(encoded(0x1234, WordType::u16, high_swapped), V{0x3412});
  EXPECT_EQ(decode_words(V{0x3412}, WordType::u16, low_swapped), 0x1234);
}

TEST(RegisterWords, WhatDoesNotFitIsNotSent) {
  EXPECT_EQ(encoded(32767.4, WordType::s16, high), V{0x7FFF});
  EXPECT_EQ(encoded(32768.0, WordType::s16, high), V{});
  EXPECT_EQ(encoded(-32768.0, WordType::s16, high), V{0x8000});
  EXPECT_EQ(encoded(-32769.0, WordType::s16, high), V{});
  EXPECT_EQ(encoded(-1.0, WordType::u16, high), V{});
  EXPECT_EQ(encoded(4294967295.0, WordType::u32, high), (V{0xFFFF, 0xFFFF}));
  EXPECT_EQ(encoded(4294967296.0, WordType::u32, high), V{});
  EXPECT_EQ(encoded(2147483648.0, WordType::s32, high), V{});
  EXPECT_EQ(encoded(std::nan(""), WordType::s32, high), V{});
  EXPECT_EQ(encoded(std::numeric_limits<double>::infinity(), WordType::f32, high), V{});
  EXPECT_TRUE(std::isnan(decode_words(V{0x7FC0, 0x0000}, WordType::f32, high)));
}

TEST(RegisterWords, WrapAt360) {
  EXPECT_EQ(unwrapped_deg(359.0, 1.0, 360.0), -1.0);
  EXPECT_EQ(unwrapped_deg(1.0, 359.0, 360.0), 361.0);
  EXPECT_EQ(unwrapped_deg(0.5, 719.5, 360.0), 720.5);
  EXPECT_EQ(unwrapped_deg(270.0, 0.0, 360.0), -90.0);
  EXPECT_EQ(unwrapped_deg(10.0, 12.0, 360.0), 10.0);
}

// pi is 400921FB 54442D18.
TEST(RegisterWords, NumbersOf64Bits) {
  EXPECT_EQ(decode_words(V{0x4009, 0x21FB, 0x5444, 0x2D18}, WordType::f64, high), 3.141592653589793);
  EXPECT_EQ(decode_words(V{0x2D18, 0x5444, 0x21FB, 0x4009}, WordType::f64, {false, false}), 3.141592653589793);
  EXPECT_EQ(decode_words(V{0x182D, 0x4454, 0xFB21, 0x0940}, WordType::f64, {false, true}), 3.141592653589793);
  const std::optional<Words> words = encode_words(-123456.789012345, WordType::f64, {false, true});
  ASSERT_TRUE(words);
  EXPECT_EQ(words->span().size(), 4u);
  EXPECT_EQ(decode_words(words->span(), WordType::f64, {false, true}), -123456.789012345);
  EXPECT_FALSE(encode_words(std::nan(""), WordType::f64, high));
}

// ---- modbus forms ----

// Modbus tables that are one controller: the contract of every table with each map, and what is special about them.

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
