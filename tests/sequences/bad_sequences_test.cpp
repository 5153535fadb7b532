// One bad file for each defect in tests/sequences/bad/: refused with one line that names the place, what was found
// there and what was expected.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <set>
#include <string>

#include "sequences/sequence.h"
#include "tests/outcome.h"

namespace turncal {
namespace {

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
  const Result<Sequence> missing = read_sequence(folder + "no_such_file.seq");
  ASSERT_FALSE(missing.ok());
  EXPECT_EQ(missing.error().message, folder + "no_such_file.seq: cannot open: No such file or directory");
  const Result<Sequence> a_folder = read_sequence(folder);
  ASSERT_FALSE(a_folder.ok());
  EXPECT_EQ(a_folder.error().message, folder + ": not a regular file");
  const Result<Sequence> endless = read_sequence("/dev/zero");
  ASSERT_FALSE(endless.ok());
  EXPECT_EQ(endless.error().message, "/dev/zero: not a regular file");
  const std::string large = testing::TempDir() + "turncal_large.seq";
  std::ofstream(large) << std::string(1'000'001, '#');
  const Result<Sequence> too_large = read_sequence(large);
  ASSERT_FALSE(too_large.ok());
  EXPECT_EQ(too_large.error().message, large + ": 1000001 bytes: expected at most 1000000");
}

}  // namespace
}  // namespace turncal
