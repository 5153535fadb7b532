// What every chamber obeys (chamber.h), of the rig's own and of both languages over both lines; faults of a line; files that are refused.
#include <functional>

#include "tests/said.h"
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

class ChamberContract : public testing::TestWithParam<ChamberKind> {
 protected:
  void begin(const RigConfig& config = default_rig_config()) {
    s.emplace(GetParam().text ? GetParam().text() : registers_text("tcp"), config);
    ASSERT_OK(chamber().connect());
  }
  Chamber& chamber() { return GetParam().text ? static_cast<Chamber&>(*s->driver) : s->simulated; }
  ChamberStatus status() { return expect_value(chamber().status()); }
  std::optional<ServedChamber> s;
};

TEST_P(ChamberContract, GoesWhereItIsToldAndOff) {
  begin();
  EXPECT_NEAR(status().actual_c, 24.0, 0.01);
  EXPECT_FALSE(status().on);
  EXPECT_EQ(status().door_open, false);
  EXPECT_EQ(status().alarm, false);
  EXPECT_TRUE(fails(chamber().set(90.0, 1.0), ErrorKind::input, "expected -40 to 85 C"));
  EXPECT_TRUE(fails(chamber().set(40.0, 5.0), ErrorKind::input, "expected at most 3"));
  EXPECT_TRUE(fails(chamber().set(std::nan(""), 1.0), ErrorKind::input));
  for (const double target_c : {-10.5, 40.2}) {
    ASSERT_OK(chamber().set(target_c, 3.0));
    ASSERT_OK(chamber().on());
    ASSERT_OK(chamber().on()) << "a command may be repeated";
    const double from_c = status().actual_c, way_c = target_c - from_c, half_s = 60.0 * 0.5 * std::abs(way_c) / 3.0;
    s->pass(half_s);
    EXPECT_TRUE(status().on);
    EXPECT_NEAR(status().set_point_c, target_c, 1e-9);
    EXPECT_NEAR(status().actual_c, from_c + 0.5 * way_c, 4.0) << "at the ramp that it was told, less a lag";
    s->pass(half_s + 600.0);
    EXPECT_NEAR(status().actual_c, target_c, 0.2);
  }
  EXPECT_GT(s->group.rig(0).temperature_c(), 38.0) << "the unit followed";
  ASSERT_OK(chamber().off());
  EXPECT_FALSE(status().on);
  EXPECT_FALSE(s->heats());
  s->pass(5000.0);
  EXPECT_NEAR(status().actual_c, 24.0, 1.0);
}

TEST_P(ChamberContract, TellsItsFaults) {
  RigConfig config = default_rig_config();
  for (const RigFaultKind kind : {RigFaultKind::chamber_door_open, RigFaultKind::chamber_alarm})
    config.faults.push_back({.kind = kind, .time_s = 10.0});
  config.faults.push_back({.kind = RigFaultKind::chamber_link_lost, .time_s = 20.0});
  begin(config);
  s->pass(11.0);
  EXPECT_EQ(status().door_open, true);
  EXPECT_EQ(status().alarm, true);
  s->pass(10.0);
  EXPECT_TRUE(fails(chamber().status(), ErrorKind::device));
  EXPECT_FALSE(chamber().off().ok());
}

INSTANTIATE_TEST_SUITE_P(All, ChamberContract, testing::ValuesIn(kinds), name_of);

// ---- faults of a line ----

struct ChamberLineFault {
  const char* name;
  std::function<void(AnswerPlan&)> how;
};
void PrintTo(const ChamberLineFault& fault, std::ostream* out) { *out << fault.name; }

const ChamberLineFault chamber_line_faults[] = {
    {"silence", [](AnswerPlan& plan) { plan.pieces.clear(); }},
    {"late", [](AnswerPlan& plan) { plan.pieces[0].delay_s = 0.2; }},
    {"cut_short", [](AnswerPlan& plan) { bytes_of(plan).resize(bytes_of(plan).size() - 3); }},
    {"flipped_bit", [](AnswerPlan& plan) { bytes_of(plan)[1] ^= 0x10; }},
    {"trailing_junk",
     [](AnswerPlan& plan) {
       bytes_of(plan).insert(bytes_of(plan).end(), {0xAA, 0x55, 0x00});
     }},
    {"twice", [](AnswerPlan& plan) { plan.pieces.push_back(plan.pieces[0]); }},
    {"twice_later", [](AnswerPlan& plan) { plan.pieces.resize(2, plan.pieces[0]), plan.pieces[1].delay_s = 0.02; }},
    {"split", [](AnswerPlan& plan) { cut(plan, 3, 0.015); }},
};

class ChamberLineFaults : public testing::TestWithParam<std::tuple<ChamberKind, ChamberLineFault>> {};

TEST_P(ChamberLineFaults, NoWrongReadingIsBelieved) {
  const ChamberKind& kind = std::get<0>(GetParam());
  const ChamberLineFault& fault = std::get<1>(GetParam());
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
                         testing::Combine(testing::ValuesIn(std::begin(kinds) + 1, std::end(kinds)),
                                          testing::ValuesIn(chamber_line_faults)),
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
  expect_said("turntable_drivers/chambers.said",
              [](const std::string& name, const std::string& what, const std::string& with) {
                return said_of(parse_chamber(replaced(own_chamber_text(name, "tcp"), what, with), "own.chamber"));
              });
}

}  // namespace
}  // namespace turncal
