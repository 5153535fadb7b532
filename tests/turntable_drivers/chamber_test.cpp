// What every chamber obeys (chamber.h), of the rig's own and of both languages over both lines; faults of a line; files that are refused.
#include <functional>

#include "tests/turntable_drivers/served_chamber.h"

namespace turncal {
namespace {

struct ChamberKind {
  const char* name;
  std::function<std::string()> text;  // empty: the rig's own
};
void PrintTo(const ChamberKind& kind, std::ostream* out) { *out << kind.name; }
const ChamberKind kinds[] = {{"rig", {}},
                             {"tcp", [] { return registers_text("tcp"); }},
                             {"rtu", [] { return registers_text("rtu"); }},
                             {"text_tcp", [] { return sentences_text("tcp"); }},
                             {"text_serial", [] { return sentences_text("serial"); }}};
std::string name_of(const testing::TestParamInfo<ChamberKind>& info) { return info.param.name; }

class ChamberContract : public testing::TestWithParam<ChamberKind> {};

TEST_P(ChamberContract, GoesWhereItIsToldAndOff) {
  ServedChamber s(GetParam().text ? GetParam().text() : registers_text("tcp"));
  Chamber& chamber = GetParam().text ? static_cast<Chamber&>(*s.driver) : s.simulated;
  ASSERT_OK(chamber.connect());
  const ChamberStatus at_first = expect_value(chamber.status());
  EXPECT_NEAR(at_first.actual_c, 24.0, 0.01);
  EXPECT_FALSE(at_first.on);
  EXPECT_EQ(at_first.door_open, false);
  EXPECT_EQ(at_first.alarm, false);
  EXPECT_TRUE(fails(chamber.set(90.0, 1.0), ErrorKind::input, "expected -40 to 85 C"));
  EXPECT_TRUE(fails(chamber.set(40.0, 5.0), ErrorKind::input, "expected at most 3"));
  EXPECT_TRUE(fails(chamber.set(std::nan(""), 1.0), ErrorKind::input));
  for (const double target_c : {-10.5, 40.2}) {
    ASSERT_OK(chamber.set(target_c, 3.0));
    ASSERT_OK(chamber.on());
    ASSERT_OK(chamber.on()) << "a command may be repeated";
    const double from_c = expect_value(chamber.status()).actual_c, way_c = target_c - from_c;
    s.pass(60.0 * 0.5 * std::abs(way_c) / 3.0);
    const ChamberStatus under_way = expect_value(chamber.status());
    EXPECT_TRUE(under_way.on);
    EXPECT_NEAR(under_way.set_point_c, target_c, 1e-9);
    EXPECT_NEAR(under_way.actual_c, from_c + 0.5 * way_c, 4.0) << "at the ramp that it was told, less a lag";
    s.pass(60.0 * 0.5 * std::abs(way_c) / 3.0 + 600.0);
    EXPECT_NEAR(expect_value(chamber.status()).actual_c, target_c, 0.2);
  }
  EXPECT_GT(s.group.rig(0).temperature_c(), 38.0) << "the unit followed";
  ASSERT_OK(chamber.off());
  EXPECT_FALSE(expect_value(chamber.status()).on);
  EXPECT_FALSE(s.heats());
  s.pass(5000.0);
  EXPECT_NEAR(expect_value(chamber.status()).actual_c, 24.0, 1.0);
}

TEST_P(ChamberContract, TellsItsFaults) {
  RigConfig config = default_rig_config();
  for (const RigFaultKind kind : {RigFaultKind::chamber_door_open, RigFaultKind::chamber_alarm})
    config.faults.push_back({.kind = kind, .time_s = 10.0});
  config.faults.push_back({.kind = RigFaultKind::chamber_link_lost, .time_s = 20.0});
  ServedChamber s(GetParam().text ? GetParam().text() : registers_text("tcp"), config);
  Chamber& chamber = GetParam().text ? static_cast<Chamber&>(*s.driver) : s.simulated;
  ASSERT_OK(chamber.connect());
  s.pass(11.0);
  const ChamberStatus now = expect_value(chamber.status());
  EXPECT_EQ(now.door_open, true);
  EXPECT_EQ(now.alarm, true);
  s.pass(10.0);
  EXPECT_TRUE(fails(chamber.status(), ErrorKind::device));
  EXPECT_FALSE(chamber.off().ok());
}

INSTANTIATE_TEST_SUITE_P(All, ChamberContract, testing::ValuesIn(kinds), name_of);

// ---- faults of a line ----

struct ChamberLineFault {
  const char* name;
  std::function<void(AnswerPlan&)> how;
  bool in_text = true, in_registers = true;
};
void PrintTo(const ChamberLineFault& fault, std::ostream* out) { *out << fault.name; }

Frame& answer_of(AnswerPlan& plan) { return plan.pieces[0].bytes; }
const ChamberLineFault chamber_line_faults[] = {
    {"silence", [](AnswerPlan& plan) { plan.pieces.clear(); }},
    {"late", [](AnswerPlan& plan) { plan.pieces[0].delay_s = 0.2; }},
    {"cut_short", [](AnswerPlan& plan) { answer_of(plan).resize(answer_of(plan).size() - 3); }},
    {"flipped_bit", [](AnswerPlan& plan) { answer_of(plan)[1] ^= 0x10; }},
    {"trailing_junk",
     [](AnswerPlan& plan) {
       answer_of(plan).insert(answer_of(plan).end(), {0xAA, 0x55, 0x00});
     }},
    {"twice",
     [](AnswerPlan& plan) {
       const Frame once = answer_of(plan);
       answer_of(plan).insert(answer_of(plan).end(), once.begin(), once.end());
     }},
    {"split",
     [](AnswerPlan& plan) {
       const Frame tail(answer_of(plan).begin() + 3, answer_of(plan).end());
       answer_of(plan).resize(3);
       plan.pieces.push_back({tail, 0.015});
     }},
    {"digit_changed", [](AnswerPlan& plan) { answer_of(plan)[3] ^= 0x40; }, true, false}};

class ChamberLineFaults : public testing::TestWithParam<std::tuple<ChamberKind, ChamberLineFault>> {};

TEST_P(ChamberLineFaults, NoWrongReadingIsBelieved) {
  const ChamberKind& kind = std::get<0>(GetParam());
  const ChamberLineFault& fault = std::get<1>(GetParam());
  if (!kind.text || !(std::string(kind.name).starts_with("text") ? fault.in_text : fault.in_registers)) GTEST_SKIP();
  ServedChamber s(kind.text());
  ASSERT_OK(s.driver->connect());
  ASSERT_OK(s.driver->set(30.0, 2.0));
  ASSERT_OK(s.driver->on());
  int answers = 0;
  s.disturb([&](bool reads, AnswerPlan& plan) {
    if (reads && ++answers % 4 == 3) fault.how(plan);
  });
  for (int i = 0; i < 4; ++i) {
    const ChamberStatus now = expect_value(s.driver->status());
    EXPECT_NEAR(now.actual_c, 24.0, 0.01);
    EXPECT_NEAR(now.set_point_c, 30.0, 1e-9);
    EXPECT_TRUE(now.on);
  }
  // A command whose answer is spoilt is an error or was taken; off is told until it is read.
  s.disturb([&](bool reads, AnswerPlan& plan) {
    if (!reads && ++answers % 2 == 0) fault.how(plan);
  });
  for (int i = 0; i < 5 && s.heats(); ++i) static_cast<void>(s.driver->off().ok());
  EXPECT_FALSE(expect_value(s.driver->status()).on);
}

INSTANTIATE_TEST_SUITE_P(All, ChamberLineFaults,
                         testing::Combine(testing::ValuesIn(kinds), testing::ValuesIn(chamber_line_faults)),
                         [](const auto& which) {
                           return std::string(std::get<0>(which.param).name) + "_" + std::get<1>(which.param).name;
                         });

TEST(DescribedChamber, GoesOffOnALinkThatIsOpenedAnew) {
  ServedChamber s(registers_text("tcp"));
  ASSERT_OK(s.driver->connect());
  ASSERT_OK(s.driver->on());
  s.hang_up();
  EXPECT_TRUE(fails(s.driver->status(), ErrorKind::device, "chamber own: read.actual"));
  ASSERT_OK(s.driver->off());
  EXPECT_FALSE(s.heats());
  ASSERT_OK(s.driver->on());
  s.driver.reset();
  EXPECT_FALSE(s.heats()) << "whoever leaves it switched on leaves it off";
}

TEST(DescribedChamber, WhatIsNotCommissionedIsNotSwitchedOn) {
  ServedChamber s(replaced(registers_text("tcp"), "commissioned = true", "commissioned = false"));
  ASSERT_OK(s.driver->connect());
  EXPECT_TRUE(fails(s.driver->on(), ErrorKind::input, "not commissioned"));
  EXPECT_FALSE(s.heats());
}

// ---- files ----

TEST(ChamberFile, ShippedOnesAreUnverifiedAndSayWhereEachLineComesFrom) {
  for (const std::string name : {"watlow_f4", "espec_p300"}) {
    const ChamberDescription chamber =
        expect_value(read_chamber(TURNCAL_SOURCE_DIR "/turntable_drivers/chamber/chambers/" + name + ".chamber"));
    EXPECT_FALSE(chamber.verified_on_hardware || chamber.commissioned);
    EXPECT_SAYS(chamber.link().address, "SET-ME");
    for (const LineSource& line : chamber.lines)
      EXPECT_TRUE(!line.mark.empty() || line.key == "format" || line.key == "name" ||
                  line.key.ends_with("_on_hardware") || line.key == "commissioned")
          << name << ": " << line.key;
    EXPECT_GE(explain(chamber).size(), 7u);
    // They work against their own twins.
    std::string text =
        expect_value(read_whole_file(TURNCAL_SOURCE_DIR "/turntable_drivers/chamber/chambers/" + name + ".chamber"));
    ServedChamber s(replaced(text, "\ncommissioned = false", "\ncommissioned = true"));
    ASSERT_OK(s.driver->connect()) << name;
    ASSERT_OK(s.driver->set(-20.5, 3.0)) << name;
    ASSERT_OK(s.driver->on());
    const ChamberStatus now = expect_value(s.driver->status());
    EXPECT_NEAR(now.set_point_c, -20.5, 1e-9);
    EXPECT_TRUE(now.on);
    ASSERT_OK(s.driver->off());
    EXPECT_FALSE(expect_value(s.driver->status()).on);
  }
}

TEST(ChamberFile, WhatCouldNotWorkIsSaidInOneLine) {
  const struct {
    std::string what, with, said;
    bool text = false;
  } rows[] = {
      {"read.actual = 100 f32", "read.actual = 100", "key 'read.actual' = '100': expected ADDRESS TYPE"},
      {"read.actual = 100 f32", "read.actual = 65535 f32", "expected ADDRESS TYPE"},
      {"read.on = 104 u16\n", "", "read.on"},
      {"read.on.mask = 0x3", "read.on.mask = 0", "expected bits of a register"},
      {"read.on.values = 2", "read.on.values = RUN", "expected numbers"},
      {"write.off = 210 u16 0", "write.off = 211 u16 7", "expected other words than those with which write.on ends"},
      {"write.off = 210 u16 0", "write.off = 210 u16 0.5", "expected steps 'ADDRESS TYPE NUMBER'"},
      {"write.off = 210 u16 0", "write.off =", "expected steps"},
      {"write.off = 210 u16 0", "write.off = 210 u16", "expected steps 'ADDRESS TYPE NUMBER'"},
      {"write.off = 210 u16 0", "write.off = 210 u16 position", "expected steps 'ADDRESS TYPE NUMBER'"},
      {"write.set_point.scale = 10", "write.set_point.scale = 1", "write.set_point that tell 0.5 C"},
      {"write.set_point = 200 s16", "write.set_point = 200 u16", "expected a type that holds limits.low_c"},
      {"limits.low_c = -40", "limits.low_c = 90", "expected a number below limits.high_c"},
      {"limits.ramp_c_per_min = 3\n", "", "limits.ramp_c_per_min"},
      {"format = 1", "format = 2", "format"},
      {"language = registers", "language = words", "language"},
      {"", "read.actaul = 1\n", "read.actaul"},
      {"read.actual.expect = T={value},{*}", "read.actual.expect = T={*}", "expected a sentence with {value} once",
       true},
      {"write.on = RUN", "write.on = RUN {value}", "expected a sentence without {value}", true},
      {"write.off = STOP", "write.off = RUN", "expected other words than those", true},
      {"read.on.values = RUN\n", "", "read.on.values", true},
  };
  for (const auto& row : rows) {
    const auto parsed = parse_chamber(
        replaced(row.text ? sentences_text("tcp") : registers_text("tcp"), row.what, row.with), "own.chamber");
    ASSERT_FALSE(parsed.ok()) << row.with << ": " << row.said;
    EXPECT_SAYS(parsed.error().message, row.said);
    EXPECT_SAYS(parsed.error().message, "own.chamber");
    EXPECT_SAYS_NOT(parsed.error().message, "\n");
  }
}

}  // namespace
}  // namespace turncal
