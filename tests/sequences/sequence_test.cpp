// The parser: what a good file becomes, and the shipped sequences.
#include "sequences/sequence.h"

#include <gtest/gtest.h>

#include <fstream>
#include <map>
#include <set>
#include <string>

#include "calib/model/parameters.h"
#include "sequences/plan.h"
#include "tests/outcome.h"

namespace turncal {
namespace {

const std::string header = "format = 1\nname = test\nrate_degps = 10\nacceleration_degps2 = 20\n";
const std::string first_step = "step 1\ninitial H 0 P 0 R 0\nalign 200\ndwell 200\n";

Sequence parsed(const std::string& text) { return expect_value(parse_sequence(text, "test.seq")); }

Sequence shipped(const std::string& name) {
  return expect_value(read_sequence(std::string(TURNCAL_SOURCE_DIR) + "/sequences/" + name));
}

// "roll 90>" for a move to 90 deg, "align 200", "dwell 200".
std::string text_of(const Step& step) {
  std::string text;
  for (const SequenceItem& item : step.items)
    if (item.kind == SequenceItem::Kind::move)
      text += std::string(to_string(item.move.axis)) + " " + std::to_string(std::lround(item.move.target_deg)) + "> ";
    else
      text += (item.dwell.kind == SegmentKind::align ? "align " : "dwell ") + std::to_string(item.dwell.samples) + " ";
  return text;
}

TEST(Parser, FillsEveryFieldOfTheSequence) {
  const std::string text =
      "# comment\r\n" + header +
      "step 3\"a # title\"# comment\n\tdetermines n11 A03\n  initial P -20 R 1.5 heading 30\n  align 12000\n"
      "  rotate R +360 acceleration 40 rate 5\n\n  dwell 20000\n  rotate heading -0.25\n";
  const Sequence sequence = parsed(text);
  EXPECT_EQ(sequence.name, "test");
  EXPECT_EQ(sequence.file, "test.seq");
  EXPECT_EQ(sequence.text, text);
  EXPECT_EQ(sequence.rate_degps, 10.0);
  EXPECT_EQ(sequence.acceleration_degps2, 20.0);
  EXPECT_EQ(sequence.start_deg, (AxisTriple{{30.0, -20.0, 1.5}}));
  ASSERT_EQ(sequence.steps.size(), 1U);
  const Step& step = sequence.steps[0];
  EXPECT_EQ(step.number, 3);
  EXPECT_EQ(step.title, "a # title");
  EXPECT_EQ(step.line, 6);
  EXPECT_EQ(step.determines, (std::vector<std::string>{"n11", "A03"}));
  EXPECT_EQ(step.initial_deg, sequence.start_deg);
  ASSERT_EQ(step.items.size(), 4U);  // no moves: the table stands there when the recording begins
  EXPECT_EQ(step.items[0].dwell.kind, SegmentKind::align);
  EXPECT_EQ(step.items[0].dwell.samples, 12000);
  EXPECT_EQ(step.items[0].line, 9);
  EXPECT_EQ(step.items[1].move.axis, Axis::roll);
  EXPECT_EQ(step.items[1].move.target_deg, 361.5);
  EXPECT_EQ(step.items[1].move.rate_degps, 5.0);
  EXPECT_EQ(step.items[1].move.acceleration_degps2, 40.0);
  EXPECT_EQ(step.items[2].dwell.kind, SegmentKind::still);
  EXPECT_EQ(step.items[2].line, 12);
  EXPECT_EQ(step.items[3].move.axis, Axis::heading);
  EXPECT_EQ(step.items[3].move.target_deg, 29.75);
  EXPECT_EQ(step.items[3].move.rate_degps, 10.0);
  EXPECT_FALSE(step.items[3].positioning);
}

TEST(Parser, PutsTheMovesToTheInitialPositionInFrontRollPitchHeading) {
  const Sequence sequence = parsed(header + first_step + "step 2\ninitial H -90 P 45 R 30\nalign 200\n" +
                                   "step 3\ninitial H -90 P 0 R 30\nalign 200\n");
  EXPECT_EQ(text_of(sequence.steps[1]), "roll 30> pitch 45> heading -90> align 200 ");
  EXPECT_EQ(text_of(sequence.steps[2]), "pitch 0> align 200 ");
  const SequenceItem& item = sequence.steps[2].items[0];
  EXPECT_TRUE(item.positioning);
  EXPECT_EQ(item.line, 13);  // that of `initial`
  EXPECT_EQ(item.move.rate_degps, 10.0);
  EXPECT_EQ(item.move.acceleration_degps2, 20.0);
}

TEST(Parser, UnwindsWholeTurnsOnlyWhereTheAngleDiffers) {
  const Sequence sequence =
      parsed(header + first_step + "rotate R +360\n" + "step 2\ninitial H 0 P 0 R 360\nalign 200\n" +
             "step 3\ninitial H 0 P 0 R 0\nalign 200\n");
  EXPECT_EQ(text_of(sequence.steps[1]), "align 200 ");
  EXPECT_EQ(text_of(sequence.steps[2]), "roll 0> align 200 ");
}

TEST(Parser, TurnsThatAddUpToNothingEndWhereTheyBegan) {
  // 0.1 + 0.2 - 0.3 is 5.6e-17 in binary arithmetic; that must not become a move.
  const Sequence sequence = parsed(header + first_step + "rotate R +0.1\nrotate R +0.2\nrotate R -0.3\n" +
                                   "step 2\ninitial H 0 P 0 R 0\nalign 200\n");
  EXPECT_EQ(text_of(sequence.steps[1]), "align 200 ");
}

TEST(Parser, TakesTheOddLineEndings) {
  const std::string text = header + first_step;
  std::string crlf;
  for (const char c : text) crlf += c == '\n' ? "\r\n" : std::string(1, c);
  EXPECT_EQ(text_of(parsed("\xEF\xBB\xBF" + crlf).steps[0]), "align 200 dwell 200 ");
  EXPECT_EQ(text_of(parsed(text.substr(0, text.size() - 1)).steps[0]), "align 200 dwell 200 ");  // no last newline
  EXPECT_EQ(parsed("format=1\nname=a\nrate_degps=10\nacceleration_degps2=20\n" + first_step).name, "a");
}

TEST(FourteenStep, IsTheTableOfTheMethod) {
  const Sequence sequence = shipped("fourteen_step.seq");
  ASSERT_EQ(sequence.steps.size(), 14U);
  // By hand from the table of the method; a position differs from the one before in step 3 by heading -90, and so on.
  const std::map<int, std::string> expected = {
      {1,
       "align 12000 dwell 20000 pitch 90> dwell 20000 pitch -90> dwell 20000 pitch 0> roll 90> dwell 20000 "
       "roll -90> dwell 20000 roll 0> "},
      {2, "align 12000 roll 360> dwell 20000 roll 0> dwell 20000 "},
      {4, "roll -90> align 12000 pitch 360> dwell 20000 pitch 0> dwell 20000 "},
      {5, "roll 0> heading 0> align 12000 roll 180> dwell 20000 roll 0> dwell 20000 roll -180> dwell 20000 roll 0> "},
      {9, "roll -90> align 12000 pitch 90> dwell 20000 pitch 0> dwell 20000 pitch -90> dwell 20000 pitch 0> "},
      {11, "align 12000 heading 0> dwell 20000 heading -90> dwell 20000 heading -180> dwell 20000 heading -90> "},
      {13, "align 12000 dwell 120000 "},
      {14, "heading -90> align 12000 dwell 120000 "}};
  for (const auto& [number, items] : expected) {
    EXPECT_EQ(sequence.steps[static_cast<std::size_t>(number - 1)].number, number);
    EXPECT_EQ(text_of(sequence.steps[static_cast<std::size_t>(number - 1)]), items) << "step " << number;
  }
  EXPECT_EQ(sequence.steps[3].initial_deg, (AxisTriple{{-90.0, 0.0, -90.0}}));
  std::set<std::string> determined;
  for (const Step& step : sequence.steps) determined.insert(step.determines.begin(), step.determines.end());
  EXPECT_EQ(determined.size(), 21U);  // all that are free, each somewhere
}

// The same moves and dwells as steps 1 to 14, whatever their lengths and rates.
void expect_fourteen_steps(const Sequence& sequence, bool same_dwells) {
  const Sequence fourteen = shipped("fourteen_step.seq");
  ASSERT_GE(sequence.steps.size(), 14U);
  for (std::size_t s = 0; s < 14; ++s) {
    const Step& a = sequence.steps[s];
    const Step& b = fourteen.steps[s];
    EXPECT_EQ(a.determines, b.determines);
    ASSERT_EQ(a.items.size(), b.items.size()) << "step " << b.number;
    for (std::size_t i = 0; i < a.items.size(); ++i) {
      EXPECT_EQ(a.items[i].kind, b.items[i].kind);
      EXPECT_EQ(a.items[i].move.axis, b.items[i].move.axis);
      EXPECT_EQ(a.items[i].move.target_deg, b.items[i].move.target_deg);
      EXPECT_EQ(a.items[i].dwell.kind, b.items[i].dwell.kind);
      if (same_dwells) {
        EXPECT_EQ(a.items[i].dwell.samples, b.items[i].dwell.samples);
      }
    }
  }
}

TEST(ShortDemo, IsTheFourteenStepsInTenMinutes) {
  const Sequence sequence = shipped("short_demo.seq");
  ASSERT_EQ(sequence.steps.size(), 14U);
  expect_fourteen_steps(sequence, false);
  PlanLimits limits;
  limits.settle_s = 0.5;
  const Plan plan = make_plan(sequence, limits);
  EXPECT_TRUE(plan.ok());
  EXPECT_EQ(plan.samples, 121800);  // 609 s
}

TEST(Extended, AddsAnglesRatesAndAReturnToTheFourteenSteps) {
  const Sequence sequence = shipped("extended.seq");
  expect_fourteen_steps(sequence, true);
  PlanLimits limits;
  limits.settle_s = 0.5;
  const Plan plan = make_plan(sequence, limits);
  EXPECT_TRUE(plan.ok());
  // Every turn of 360 deg: (axis, roll of the unit, sense, rate).
  std::set<std::string> turns;
  bool at_45[3] = {false, false, false};  // a dwell with gravity halfway between x-y, y-z, x-z
  for (const PlannedItem& item : plan.items) {
    const double roll = item.commanded_deg[Axis::roll];
    const double pitch = item.commanded_deg[Axis::pitch];
    if (item.kind == SequenceItem::Kind::move && std::abs(item.to_deg - item.from_deg) == 360.0) {
      const bool on_its_side = item.axis == Axis::pitch && roll == -90.0;
      turns.insert(std::string(to_string(item.axis)) + (on_its_side ? " on its side" : "") +
                   (item.to_deg > item.from_deg ? " +" : " -") + std::to_string(std::lround(item.rate_degps)));
    }
    if (item.kind == SequenceItem::Kind::dwell && item.dwell_kind == SegmentKind::still) {
      at_45[0] = at_45[0] || (roll == 0.0 && std::fmod(pitch, 90.0) == 45.0);
      at_45[1] = at_45[1] || (pitch == 0.0 && std::fmod(roll, 90.0) == 45.0);
      at_45[2] = at_45[2] || (roll == -90.0 && std::fmod(pitch, 90.0) == 45.0);
    }
    // The station polls in tenths of a second; every move ends on one.
    EXPECT_EQ(item.samples % 20, 0) << "line " << item.line;
  }
  EXPECT_EQ(plan.samples, 2608120);       // 13040.6 s, as the document says
  EXPECT_EQ(turns.size(), 3U * 2U * 3U);  // three gyros, two senses, three rates
  EXPECT_TRUE(at_45[0] && at_45[1] && at_45[2]);
  EXPECT_EQ(plan.items.back().commanded_deg, sequence.start_deg);
  EXPECT_EQ(plan.items.back().dwell_kind, SegmentKind::still);
}

}  // namespace
}  // namespace turncal
