// The parser: what a good file becomes, and the shipped sequences.
#include "sequences/sequence.h"

#include <regex>

#include "calib/model/parameters.h"
#include "sequences/plan.h"
#include "tests/test.h"

namespace turncal {
namespace {

const std::string head_text = "format = 1\nname = test\nrate_degps = 10\nacceleration_degps2 = 20\n";
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
      "# comment\r\n" + head_text +
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
  const Sequence sequence = parsed(head_text + first_step + "step 2\ninitial H -90 P 45 R 30\nalign 200\n" +
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
      parsed(head_text + first_step + "rotate R +360\n" + "step 2\ninitial H 0 P 0 R 360\nalign 200\n" +
             "step 3\ninitial H 0 P 0 R 0\nalign 200\n");
  EXPECT_EQ(text_of(sequence.steps[1]), "align 200 ");
  EXPECT_EQ(text_of(sequence.steps[2]), "roll 0> align 200 ");
}

TEST(Parser, TurnsThatAddUpToNothingEndWhereTheyBegan) {
  // 0.1 + 0.2 - 0.3 is 5.6e-17 in binary arithmetic; that must not become a move.
  const Sequence sequence = parsed(head_text + first_step + "rotate R +0.1\nrotate R +0.2\nrotate R -0.3\n" +
                                   "step 2\ninitial H 0 P 0 R 0\nalign 200\n");
  EXPECT_EQ(text_of(sequence.steps[1]), "align 200 ");
}

TEST(Parser, TakesTheOddLineEndings) {
  const std::string text = head_text + first_step;
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
    EXPECT_EQ(sequence.steps[std::size_t(number - 1)].number, number);
    EXPECT_EQ(text_of(sequence.steps[std::size_t(number - 1)]), items) << "step " << number;
  }
  EXPECT_EQ(sequence.steps[3].initial_deg, (AxisTriple{{-90.0, 0.0, -90.0}}));
  std::set<std::string> determined;
  for (const Step& step : sequence.steps) determined.insert(step.determines.begin(), step.determines.end());
  EXPECT_EQ(determined.size(), 21U);  // all that are free, each somewhere
}

// The same moves as the fourteen steps, in ten minutes; and with more angles, rates and a return to the beginning.
TEST(FourteenStep, ItsVariantsMakeTheSameMoves) {
  const Sequence fourteen = shipped("fourteen_step.seq"), demo = shipped("short_demo.seq"),
                 extended = shipped("extended.seq");
  EXPECT_EQ(demo.steps.size(), 14U);
  for (std::size_t s = 0; s < 14; ++s) {
    EXPECT_EQ(text_of(extended.steps[s]), text_of(fourteen.steps[s]));
    EXPECT_EQ(extended.steps[s].determines, fourteen.steps[s].determines);
    const std::regex samples("(align|dwell) \\d+");
    EXPECT_EQ(std::regex_replace(text_of(demo.steps[s]), samples, "$1"),
              std::regex_replace(text_of(fourteen.steps[s]), samples, "$1"));
  }
  const Plan plan = make_plan(extended, PlanLimits{});
  std::set<std::string> turns;   // of 360 deg: axis, roll of the unit, sense, rate
  std::set<std::string> halves;  // dwells with gravity halfway between x-y, y-z, x-z
  for (const PlannedItem& item : plan.items) {
    const double roll = item.commanded_deg[Axis::roll], pitch = item.commanded_deg[Axis::pitch];
    if (std::abs(item.to_deg - item.from_deg) == 360.0)
      turns.insert(std::string(to_string(item.axis)) + (item.axis == Axis::pitch && roll == -90.0 ? " aside" : "") +
                   (item.to_deg > item.from_deg ? " +" : " -") + std::to_string(std::lround(item.rate_degps)));
    if (item.kind != SequenceItem::Kind::dwell || item.dwell_kind != SegmentKind::still) continue;
    if (std::fmod(pitch, 90.0) == 45.0) halves.insert(roll == 0.0 ? "x-y" : roll == -90.0 ? "x-z" : "");
    if (std::fmod(roll, 90.0) == 45.0) halves.insert(pitch == 0.0 ? "y-z" : "");
  }
  EXPECT_EQ(turns.size(), 3U * 2U * 3U);  // three gyros, two senses, three rates
  for (const char* half : {"x-y", "y-z", "x-z"}) EXPECT_TRUE(halves.contains(half)) << half;
  EXPECT_EQ(plan.items.back().commanded_deg, extended.start_deg);
}

// ---- bad files

const std::string folder = std::string(TURNCAL_SOURCE_DIR) + "/tests/sequences/bad/";

// Each is refused in one line that names the place: bad.said has them all.
TEST(BadSequences, AreRefusedAsTheirTableSays) {
  std::set<std::string> said;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    const Result<Sequence> sequence = read_sequence(entry.path());
    ASSERT_TRUE(fails(sequence, ErrorKind::input)) << entry.path();
    EXPECT_SAYS_NOT(sequence.error().message, "\n");
    said.insert(replaced(sequence.error().message, folder, "") + "\n");
  }
  EXPECT_EQ(std::accumulate(said.begin(), said.end(), std::string()), file_text(folder + "../bad.said"));
}

TEST(BadSequences, UnreadableFilesAreNamed) {
  EXPECT_ERROR(read_sequence(folder + "../../../sequences/fourteen_stp.seq"),
               folder +
                   "../../../sequences/fourteen_stp.seq: there is no such file, and no sequence of turncal has "
                   "this name: expected a sequence; did you mean 'fourteen_step.seq'?");
  EXPECT_ERROR(read_sequence(folder), folder + ": not a regular file");
  EXPECT_ERROR(read_sequence("/dev/zero"), "/dev/zero: not a regular file");
  const std::string large = testing::TempDir() + "turncal_large.seq";
  std::ofstream(large) << std::string(1'000'001, '#');
  EXPECT_ERROR(read_sequence(large), large + ": 1000001 bytes: expected at most 1000000");
}

}  // namespace
}  // namespace turncal
