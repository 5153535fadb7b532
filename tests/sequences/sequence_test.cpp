// The parser: what a good file becomes, and the shipped sequences.
#include "sequences/sequence.h"

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

// ---- bad files

const std::string folder = std::string(TURNCAL_SOURCE_DIR) + "/tests/sequences/bad/";

struct BadFile {
  const char* name;
  const char* message;  // begins with this, after the file's name and a colon
};

const BadFile bad_files[] = {
    {"acceleration_overflow.seq", "9:29: found '1e999', expected a number from 0.001 to 100000 for"},
    {"acceleration_too_large.seq", "9:29: found '1e300', expected a number from 0.001 to 100000 for"},
    {"acceleration_zero.seq", "9:36: found '0', expected a number from 0.001 to 100000 for"},
    {"align_too_short.seq", "9:9: found '100', expected a whole number of samples from 200 (1 s) to"},
    {"bad_name.seq", "2:8: found the title \"two words\", expected a name of letters, digits, '_', '-' and '.'"},
    {"binary.seq", "2:1: found 'name?\?\?', expected format, name, rate_degps,"},
    {"cumulative_too_large.seq", "11:12: found '+0.5', expected an angle that keeps the axis within -3600"},
    {"decreasing_step.seq", "9:6: found '3', expected a step number above 4, that of the step"},
    {"determines_fixed.seq", "6:14: found 'a21', expected one of the 21 parameters that are estimated"},
    {"determines_late.seq", "9:3: found 'determines', expected determines once in a step, above its first"},
    {"determines_nothing.seq", "6:13: found the end of the line, expected one of the 21 parameters that are estimated"},
    {"determines_twice.seq", "7:3: found 'determines', expected determines once in a step, above its first"},
    {"determines_twice_one.seq", "6:18: found 'n11', expected each parameter once"},
    {"determines_unknown.seq", "6:18: found 'n44', expected one of the 21 parameters that are estimated"},
    {"duplicate_step.seq", "9:6: found '1', expected a step number above 1, that of the step"},
    {"dwell_before_initial.seq", "10:3: found 'dwell', expected 'initial' before the first item of a step"},
    {"dwell_fraction.seq", "9:9: found '200.5', expected a whole number of samples from 200 (1 s) to"},
    {"dwell_missing.seq", "9:8: found the end of the line, expected a whole number of samples from 200 (1 s) to"},
    {"dwell_negative.seq", "9:9: found '-200', expected a whole number of samples from 200 (1 s) to"},
    {"dwell_overflow.seq", "9:9: found '99999999999999999999', expected a whole number of samples from 200 (1 s) to"},
    {"dwell_seconds.seq", "9:9: found '100', expected a whole number of samples from 200 (1 s) to"},
    {"dwell_text_after.seq", "9:13: found 's', expected the end of the line after the number of"},
    {"dwell_too_long.seq", "9:9: found '17280001', expected a whole number of samples from 200 (1 s) to"},
    {"dwell_too_short.seq", "9:9: found '199', expected a whole number of samples from 200 (1 s) to"},
    {"dwell_zero.seq", "9:9: found '0', expected a whole number of samples from 200 (1 s) to"},
    {"empty.seq", "1:1: found an empty file, expected 'format = 1' and the steps of a sequence"},
    {"empty_step.seq", "9:1: found step 2 with nothing to do, expected align, dwell or rotate"},
    {"first_item_dwell.seq", "7:3: found 'dwell', expected 'align' as the first item of the first step"},
    {"first_item_rotate.seq", "7:3: found 'rotate', expected 'align' as the first item of the first step"},
    {"header_after_step.seq", "9:1: found 'rate_degps', expected step, determines, initial, align, dwell or"},
    {"header_twice.seq", "5:1: found 'rate_degps', expected each of format, name, rate_degps and"},
    {"initial_axis_missing.seq", "6:18: found the end of the line, expected H, P and R, each once and with its angle,"},
    {"initial_axis_twice.seq", "6:19: found 'P', expected H, P and R, each once and with its angle,"},
    {"initial_not_a_number.seq", "6:17: found 'zero', expected an angle from -3600 to 3600 deg"},
    {"initial_text_after.seq", "6:23: found 'deg', expected the end of the line after three axes"},
    {"initial_too_large.seq", "6:21: found '-3601', expected an angle from -3600 to 3600 deg"},
    {"initial_twice.seq", "9:3: found 'initial', expected one initial position in a step"},
    {"item_above_steps.seq", "5:1: found 'dwell', expected format, name, rate_degps,"},
    {"long_word.seq",
     "9:3: found 'xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx...', expected step, determines, initial, align, dwell or"},
    {"lower_case_axis.seq", "9:10: found 'r', expected an axis: H, P or R"},
    {"negative_default_acceleration.seq", "4:23: found '-20', expected a number from 0.001 to 100000 for"},
    {"no_acceleration.seq", "4:1: found 'step', expected 'acceleration_degps2 = NUMBER' above the"},
    {"no_dwells.seq", "8:1: found the end of the file without a dwell, expected at least one 'dwell SAMPLES'"},
    {"no_equals.seq", "1:8: found '1', expected '=' after format"},
    {"no_format.seq", "1:1: found 'name', expected 'format = 1' as the first entry"},
    {"no_initial.seq", "10:3: found 'align', expected 'initial' before the first item of a step"},
    {"no_initial_no_items.seq", "9:1: found step 2 without its initial position, expected 'initial H 0 P 0 R 0'"},
    {"no_name.seq", "4:1: found 'step', expected 'name = NAME' above the first step"},
    {"no_rate.seq", "4:1: found 'step', expected 'rate_degps = NUMBER' above the first step"},
    {"no_steps.seq", "4:1: found the end of the file without a step, expected 'step 1'"},
    {"only_comments.seq", "2:1: found the end of the file without a step, expected 'step 1'"},
    {"other_format.seq", "1:10: found '2', expected 1, the format this program reads"},
    {"rate_missing.seq", "9:20: found the end of the line, expected a number from 0.001 to 100000 for rate"},
    {"rate_negative.seq", "9:21: found '-10', expected a number from 0.001 to 100000 for rate"},
    {"rate_too_small.seq", "9:21: found '1e-300', expected a number from 0.001 to 100000 for rate"},
    {"rate_twice.seq", "9:23: found 'rate', expected rate NUMBER, acceleration NUMBER (each at"},
    {"rate_zero.seq", "9:21: found '0', expected a number from 0.001 to 100000 for rate"},
    {"rotate_before_initial.seq", "10:3: found 'rotate', expected 'initial' before the first item of a step"},
    {"rotation_infinite.seq", "9:12: found '-inf', expected an angle to turn by, with its sign and not"},
    {"rotation_missing.seq", "9:11: found the end of the line, expected an angle to turn by, with its sign and not"},
    {"rotation_nan.seq", "9:12: found '+nan', expected an angle to turn by, with its sign and not"},
    {"rotation_overflow.seq", "9:12: found '+1e400', expected an angle to turn by, with its sign and not"},
    {"rotation_too_large.seq", "9:12: found '+3600.5', expected an angle to turn by, with its sign and not"},
    {"rotation_with_unit.seq", "9:12: found '+90deg', expected an angle to turn by, with its sign and not"},
    {"step_number_too_large.seq", "5:6: found '10000', expected a step number of 1 to 9999"},
    {"step_without_number.seq", "5:6: found the title \"one\", expected a step number of 1 to 9999"},
    {"step_zero.seq", "5:6: found '0', expected a step number of 1 to 9999"},
    {"text_after_title.seq", "5:14: found 'two', expected a title in quotes or the end of the line"},
    {"text_after_value.seq", "4:26: found 'deg', expected nothing after the value"},
    {"tiny_rotation.seq", "9:12: found '+1e-12', expected an angle to turn by, with its sign and not"},
    {"title_as_word.seq", "9:3: found the title \"dwell\", expected step, determines, initial, align, dwell or"},
    {"two_signs.seq", "9:12: found '+-90', expected an angle to turn by, with its sign and not"},
    {"unknown_axis.seq", "9:10: found 'Y', expected an axis: H, P or R"},
    {"unknown_header.seq", "5:1: found 'speed', expected format, name, rate_degps,"},
    {"unknown_option.seq", "9:16: found 'speed', expected rate NUMBER, acceleration NUMBER (each at"},
    {"unknown_word.seq", "9:3: found 'wait', expected step, determines, initial, align, dwell or"},
    {"unsigned_rotation.seq", "9:12: found '90', expected an angle to turn by, with its sign and not"},
    {"unterminated_title.seq", "5:8: found '\"one', expected a title that ends with '\"' on the same line"},
    {"zero_default_rate.seq", "3:14: found '0', expected a number from 0.001 to 100000 for rate_degps"},
    {"zero_rotation.seq", "9:12: found '+0', expected an angle to turn by, with its sign and not"}};

class BadSequence : public testing::TestWithParam<BadFile> {};

TEST_P(BadSequence, IsRefusedWithOneLineThatNamesThePlace) {
  const std::string path = folder + GetParam().name;
  const Result<Sequence> sequence = read_sequence(path);
  ASSERT_TRUE(fails(sequence, ErrorKind::input));
  const std::string& message = sequence.error().message;
  EXPECT_EQ(message.substr(0, path.size() + 1 + std::string(GetParam().message).size()),
            path + ":" + GetParam().message)
      << message;
  EXPECT_SAYS_NOT(message, "\n");
  EXPECT_LT(message.size() - path.size(), 220U);
}

std::string test_name(const testing::TestParamInfo<BadFile>& info) {
  const std::string name = info.param.name;
  return name.substr(0, name.find('.'));
}

INSTANTIATE_TEST_SUITE_P(Every, BadSequence, testing::ValuesIn(bad_files), test_name);

TEST(BadSequences, EveryFileOfTheFolderIsInTheTable) {
  std::set<std::string> listed;
  for (const BadFile& file : bad_files) listed.insert(file.name);
  std::set<std::string> present;
  for (const auto& entry : std::filesystem::directory_iterator(folder))
    present.insert(entry.path().filename().string());
  EXPECT_EQ(listed, present);
}

TEST(BadSequences, UnreadableFilesAreNamed) {
  EXPECT_ERROR(read_sequence(folder + "no_such_file.seq"),
               folder +
                   "no_such_file.seq: there is no such file: expected a sequence; those of turncal are in "
                   "/usr/share/turncal/sequences, or sequences of the source tree");
  EXPECT_ERROR(read_sequence(folder), folder + ": not a regular file");
  EXPECT_ERROR(read_sequence("/dev/zero"), "/dev/zero: not a regular file");
  const std::string large = testing::TempDir() + "turncal_large.seq";
  std::ofstream(large) << std::string(1'000'001, '#');
  EXPECT_ERROR(read_sequence(large), large + ": 1000001 bytes: expected at most 1000000");
}

}  // namespace
}  // namespace turncal
