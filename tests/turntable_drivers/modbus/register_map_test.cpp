// The register map's text: every defect is named with its line, and the maps that ship say what they are and work with the twin.
#include "turntable_drivers/modbus/register_map.h"

#include "tests/said.h"
#include "tests/turntable_drivers/served_twin.h"
#include "tests/turntable_drivers/table_contract.h"
#include "turntable_drivers/modbus/modbus_frame.h"
#include "turntable_drivers/table/table_description.h"

namespace turncal {
namespace {

// One controller: each axis at an offset of its own.
std::string one_unit_text() {
  const std::string text =
      replaced(plain_map_text("tcp"), "axis.pitch.unit = 2", "axis.pitch.unit = 1\naxis.pitch.address_offset = 0x1000");
  return replaced(text, "axis.roll.unit = 3", "axis.roll.unit = 1\naxis.roll.address_offset = 0x2000");
}

// What could not work, could not stop, or would move under another name, and what only resembles it: maps.said. A row in which WHAT is nothing may
// give keys anew that the map has.
TEST(RegisterMap, EveryDefectIsNamedInOneLine) {
  expect_said(
      "turntable_drivers/maps.said", [](const std::string& name, const std::string& what, const std::string& with) {
        const std::string text =
            name == "one_unit" ? one_unit_text() : own_map_text(name, name == "three_drives" ? "rtu" : "");
        return said_of(parse_register_map(what.empty() ? with_keys(text, with) : replaced(text, what, with), "my.map"));
      });
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

using MapTable = FaultTable<TwinStation>;
class ShippedMap : public testing::TestWithParam<const char*> {};

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

// The twin's own axes, not what is read back through the same map.
TEST_P(ShippedMap, SaysThatItIsUnverifiedAndMovesTheTwin) {
  RegisterMap map = expect_value(
      read_register_map(std::string(TURNCAL_SOURCE_DIR) + "/turntable_drivers/modbus/maps/" + GetParam() + ".map"));
  EXPECT_FALSE(map.verified_on_hardware || map.commissioned);
  map.link.quiet_s = 0.1;
  {
    TwinStation station(map);
    DescribedTurntable driver(station.described, station.clock);
    ASSERT_OK(driver.connect());
    EXPECT_EQ(driver.enable().error().kind, ErrorKind::input) << "not commissioned";
    EXPECT_EQ(driver.home().error().kind, ErrorKind::input);
  }
  map.commissioned = true;
  MapTable s(map);
  EXPECT_SAYS(s.driver.identify()->description, "not verified");
  s.make_ready();
  for (const Axis axis : all_axes) ASSERT_OK(s.driver.move_absolute(axis, -30.0, 10.0, 10.0));
  s.station.pass(1.5);
  const auto at = [&](Axis axis) { return s.station.rig.axis(axis); };
  for (const Axis axis : all_axes) {
    EXPECT_NEAR(at(axis).rate_degps, -10.0, 0.2) << to_string(axis);
    EXPECT_NEAR(s.driver.status(axis)->position_deg, at(axis).position_deg, 0.01);
  }
  for (int i = 0; i < 30; ++i) {
    s.station.pass(0.1);
    for (const Axis axis : all_axes) EXPECT_OK(s.driver.status(axis));
  }
  for (const Axis axis : all_axes) {
    EXPECT_TRUE(s.driver.status(axis)->in_position && !s.driver.status(axis)->moving);
    EXPECT_NEAR(at(axis).position_deg, -30.0, 0.005) << to_string(axis);
  }
  ASSERT_OK(s.driver.move_absolute(Axis::heading, 60.0, 10.0, 10.0));
  s.station.pass(2.0);
  ASSERT_OK(s.driver.stop_all());
  s.station.pass(2.0);
  EXPECT_FALSE(at(Axis::heading).moving);
  EXPECT_LT(at(Axis::heading).position_deg, 0.0);
}

INSTANTIATE_TEST_SUITE_P(Maps, ShippedMap, testing::Values("oriental_az", "leadshine_pr", "delta_asda_a2"),
                         [](const auto& which) { return std::string(which.param); });

// ---- word order, sign and scale that are not the drives': nothing moves, and commissioning says which fit ----

// The map's word order is the other one: no number that comes out of it is believed, nothing moves, and the order that fits is named.
TEST(ModbusCommission, SwappedWords) {
  const auto station_at = [](double angle_deg) {
    RigConfig config = default_rig_config();
    config.table.power_on_deg.fill(angle_deg);
    RegisterMap map = map_of(plain_map_text("tcp"));
    map.axis[2].zero_deg = 0.0;
    map.axis[1].sign = 1;
    return std::make_unique<TwinStation>(map, config);
  };
  const auto station = station_at(0.1);
  const AxisTriple known{{0.1, 0.1, 0.1}};
  {
    DescribedTurntable right(station->described, station->clock);
    ASSERT_OK(right.connect());
    EXPECT_OK(right.commission(known, 0.01));
    EXPECT_FALSE(right.commission({{0.2, 0.1, 0.1}}, 0.01).ok());
  }
  RegisterMap wrong = station->described;  // 1000 = 0x03E8 reads 65536000 the other way round
  wrong.layout.high_word_first = false;
  wrong.plausible_deg = 1000.0;
  wrong.commissioned = false;
  DescribedTurntable driver(wrong, station->clock);
  EXPECT_TRUE(fails(driver.connect(), "word order")) << "no such position is plausible";
  ASSERT_TRUE(fails(driver.commission(known, 0.01), "words.order = high_first"));
  for (const Status& refused : {driver.enable(), driver.home(), driver.move_absolute(Axis::roll, 5.0, 10.0, 10.0)})
    EXPECT_TRUE(fails(refused, ErrorKind::input)) << "nothing is switched on either";
  const auto at_zero = station_at(0.0);
  DescribedTurntable zero(at_zero->described, at_zero->clock);
  ASSERT_OK(zero.connect());
  ASSERT_TRUE(fails(zero.commission({}, 0.01), "other settings fit as well"));
}

// ---- numbers as registers

using V = std::vector<std::uint16_t>;
constexpr WordLayout high{true, false}, low{false, false}, high_swapped{true, true}, low_swapped{false, true};

V encoded(double value, WordType type, WordLayout layout) {
  const std::optional<Words> words = encode_words(value, type, layout);
  return words ? V(words->span().begin(), words->span().end()) : V{};
}

// Signs at 0x7FFF and 0x8000; 0x12345678 in the four orders that makers use, 1.0f = 0x3F800000, pi = 400921FB 54442D18.
TEST(RegisterWords, NumbersThatFitAreReadAndWritten) {
  constexpr double pi = 3.141592653589793, count = 0x12345678;
  const struct {
    V words;
    WordType type;
    WordLayout layout;
    double value;
  } cases[] = {{{0x7FFF}, WordType::s16, high, 32767.0},
               {{0x8000}, WordType::s16, high, -32768.0},
               {{0x8000}, WordType::u16, high, 32768.0},
               {{0x3412}, WordType::u16, high_swapped, 0x1234},
               {{0x0000, 0x7FFF}, WordType::s32, high, 32767.0},
               {{0x0000, 0x8000}, WordType::s32, high, 32768.0},
               {{0x7FFF, 0xFFFF}, WordType::s32, high, 2147483647.0},
               {{0x8000, 0x0000}, WordType::s32, high, -2147483648.0},
               {{0x8000, 0x0000}, WordType::u32, high, 2147483648.0},
               {{0xFFFF, 0xFFFE}, WordType::s32, high, -2.0},
               {{0xFFFF, 0xFFFF}, WordType::u32, high, 4294967295.0},
               {{0x1234, 0x5678}, WordType::u32, high, count},
               {{0x5678, 0x1234}, WordType::u32, low, count},
               {{0x3412, 0x7856}, WordType::u32, high_swapped, count},
               {{0x7856, 0x3412}, WordType::u32, low_swapped, count},
               {{0x3F80, 0x0000}, WordType::f32, high, 1.0},
               {{0x0000, 0x803F}, WordType::f32, low_swapped, 1.0},
               {{0x4009, 0x21FB, 0x5444, 0x2D18}, WordType::f64, high, pi},
               {{0x2D18, 0x5444, 0x21FB, 0x4009}, WordType::f64, low, pi},
               {{0x182D, 0x4454, 0xFB21, 0x0940}, WordType::f64, low_swapped, pi}};
  for (const auto& [words, type, layout, value] : cases) {
    EXPECT_EQ(decode_words(words, type, layout), value);
    EXPECT_EQ(encoded(value, type, layout), words) << value;
  }
  EXPECT_EQ(encoded(32767.4, WordType::s16, high), V{0x7FFF});
}

TEST(RegisterWords, WhatDoesNotFitIsNotSent) {
  constexpr double inf = std::numeric_limits<double>::infinity();
  for (const auto& [value, type] : {std::pair(32768.0, WordType::s16),
                                    {-32769.0, WordType::s16},
                                    {-1.0, WordType::u16},
                                    {4294967296.0, WordType::u32},
                                    {2147483648.0, WordType::s32},
                                    {NAN, WordType::s32},
                                    {NAN, WordType::f64},
                                    {inf, WordType::f32}})
    EXPECT_EQ(encoded(value, type, high), V{}) << value;
  EXPECT_TRUE(std::isnan(decode_words(V{0x7FC0, 0x0000}, WordType::f32, high)));
}

TEST(RegisterWords, WrapAt360) {
  EXPECT_EQ(unwrapped_deg(359.0, 1.0, 360.0), -1.0);
  EXPECT_EQ(unwrapped_deg(1.0, 359.0, 360.0), 361.0);
  EXPECT_EQ(unwrapped_deg(0.5, 719.5, 360.0), 720.5);
  EXPECT_EQ(unwrapped_deg(270.0, 0.0, 360.0), -90.0);
  EXPECT_EQ(unwrapped_deg(10.0, 12.0, 360.0), 10.0);
}

// ---- modbus forms ----

// Modbus tables that are one controller: the contract of every table with each map, and what is special about them.

// Modbus RTU through a serial server. One block of the whole table: masks of each axis in a shared word, a state code and numbers of
// 64 bits for each; all three angles in one command block; a heartbeat of two documented values.
const std::string one_block = own_map_text("one_block");
// Status registers of each axis with an offset; the mode, the word that says who commands and the heartbeat are of the whole table; one
// command block, in front of which stands the number of the axis.
const std::string selecting = own_map_text("selecting");

using OneBlock = MapFactory<one_block>;
using Selecting = MapFactory<selecting>;
INSTANTIATE_TYPED_TEST_SUITE_P(ModbusOneBlock, TableContract, OneBlock);
INSTANTIATE_TYPED_TEST_SUITE_P(ModbusSelecting, TableContract, Selecting);

// Each axis reads its own, at three different angles, and a code that is not listed sets none of the flags.
TEST(ModbusForms, EveryAxisReadsItsOwn) {
  for (const std::string& text : {one_block, selecting}) {
    MapTable s(map_of(text));
    EXPECT_EQ(s.expect_truth(5), 15);
  }
  const StatusBit bit{.mask = 0x0F00, .codes = {3, 5}};
  EXPECT_TRUE(bit.is_set(0xF3FF));
  EXPECT_TRUE(bit.is_set(0x0500));
  EXPECT_FALSE(bit.is_set(0x0700)) << "the bits of 3 and 5 together are another code";
  EXPECT_FALSE(bit.is_set(0x0003));
}

// The documented values in turn, once for the table.
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
}

// ---- what check --explain prints: the rows of maps, against what is known of them by hand ----

// Of an axis and an operation, as explained.said has them: all rows, with " / " between, without the numbers of lines. leadshine_pr: 90 deg at 4000
// counts a degree; 10 deg/s are 240 rpm; 41667 ms over 20 deg/s^2. twin: with an offset of pitch and a fault that reads 0.
TEST(Explain, RegistersAndValuesOfAMap) {
  RegisterMap leadshine =
      expect_value(read_register_map(TURNCAL_SOURCE_DIR "/turntable_drivers/modbus/maps/leadshine_pr.map"));
  RegisterMap twin = expect_value(read_register_map(TURNCAL_SOURCE_DIR "/orchestrator/stations/twin.map"));
  twin.axis[1].address_offset = 0x100;
  twin.axis[1].bits[std::size_t(DriveBit::fault)]->active_high = false;
  expect_said("turntable_drivers/explained.said",
              [&](const std::string& map, const std::string& axis, const std::string& operation) {
                std::string text;
                for (const TableRow& row : explain(map == "twin" ? twin : leadshine)) {
                  if (row.operation != operation || row.axis != axis) continue;
                  text += (text.empty() ? "" : " / ") + row.sent + "|" + row.says + "|" + row.answer + "|" + row.source;
                }
                for (std::size_t at; (at = text.find("line ")) != std::string::npos;)
                  text.erase(at, text.find(' ', at + 5) + 1 - at);
                return text;
              });
}

}  // namespace
}  // namespace turncal
