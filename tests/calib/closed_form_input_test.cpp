// What does not fit the closed form gives one line that names step and place, never parameters.
#include <gtest/gtest.h>

#include "tests/calib/closed_form_fixture.h"

namespace turncal {
namespace {

std::string message_of(const CompressedRecording& recording, const ClosedFormOptions& options = {}) {
  const Result<ClosedFormResult> result = closed_form_calibrate(recording, start_parameters(recording.info), options);
  if (result.ok()) return "(success) " + result->message;
  EXPECT_EQ(result.error().kind, ErrorKind::input);
  EXPECT_EQ(result.error().message.find('\n'), std::string::npos);
  return result.error().message;
}

void expect_says(const std::string& message, std::initializer_list<const char*> parts) {
  for (const char* part : parts) EXPECT_NE(message.find(part), std::string::npos) << "'" << part << "' in: " << message;
}

TEST(ClosedFormInput, AMissingStepIsNamed) {
  for (int step = 1; step <= closed_form_steps; ++step) {
    CompressedRecording r = short_recording();
    for (Segment& s : r.segments)
      if (s.step == step) s.step = 77;
    EXPECT_EQ(message_of(r), "step " + std::to_string(step) + " is missing: the closed form needs steps 1 to 14");
  }
}

TEST(ClosedFormInput, AMissingDwellIsNamed) {
  CompressedRecording r = short_recording();
  for (Segment& s : r.segments)
    if (s.step == 7 && s.roll_deg == -90.0) s.kind = SegmentKind::rotate;
  EXPECT_EQ(message_of(r),
            "step 7: expected a dwell after a turn by heading 0, pitch 0, roll -90 that starts at rest at heading 0, "
            "pitch 0, roll 0");
}

TEST(ClosedFormInput, AnAxisThatIsNeverVerticalIsNamed) {
  CompressedRecording r = short_recording();
  for (Segment& s : r.segments)
    if (s.step == 1 && s.pitch_deg == 90.0) s.pitch_deg = 60.0;
  EXPECT_EQ(message_of(r),
            "step 1 never sees the x axis vertical (up): expected a dwell at heading 0, pitch 90, roll 0");
  r = short_recording();
  for (Segment& s : r.segments)
    if (s.step == 5 && s.roll_deg != 0.0) s.roll_deg = 170.0;
  expect_says(message_of(r), {"step 5 never sees the y axis vertical (down)"});
}

TEST(ClosedFormInput, AShortDwellIsNamedWithItsLength) {
  std::string text = short_steps().text;
  const std::size_t at = text.find("dwell 3000", text.find("step 8"));
  text.replace(at, 10, "dwell 1200");
  const CompressedRecording r = record_on_rig(must(parse_sequence(text, "one short dwell")), paper_unit()).recording;
  expect_says(message_of(r), {"step 8, static segment of samples", "(heading -90, pitch 90, roll 0)",
                              "a dwell of 6.000 s is too short, expected at least 10 s"});
}

TEST(ClosedFormInput, AShortAlignmentIsNamedToo) {
  ClosedFormOptions options;
  options.min_dwell_s = 13.0;  // alignments are 12 s
  expect_says(message_of(short_recording(), options),
              {"step 2,", "a dwell of 12.000 s is too short, expected at least 13 s"});
}

TEST(ClosedFormInput, SiteOutOfRange) {
  CompressedRecording r = short_recording();
  r.info.gravity_mps2 = 0.0;
  EXPECT_EQ(message_of(r), "gravity_mps2 = 0.0000: expected more than 0");
  r.info.gravity_mps2 = std::nan("");
  expect_says(message_of(r), {"gravity_mps2 = nan"});
  r = short_recording();
  r.info.latitude_deg = 120.0;
  expect_says(message_of(r), {"latitude_deg = 120.0000: expected -90 to 90"});
  r = short_recording();
  r.info.sample_period_s = 0.0;
  expect_says(message_of(r), {"sample_period_s"});
}

TEST(ClosedFormInput, NothingRecorded) {
  CompressedRecording r;
  r.info = short_recording().info;
  EXPECT_EQ(message_of(r), "the recording has no samples in its segments");
}

TEST(ClosedFormInput, AnglesThatTheAccelerometersDoNotFeel) {
  CompressedRecording r = short_recording();
  for (Segment& s : r.segments)
    if (s.step == 1) s.pitch_deg = -s.pitch_deg;
  expect_says(message_of(r),
              {"step 1,", "pitch 90", "179.", "deg from the vertical", "the segments do not fit the data"});
}

TEST(ClosedFormInput, ATurnTheOtherWayRound) {  // 360 and -360 end at the same attitude: only the gyros can tell
  CompressedRecording r = short_recording();
  for (Segment& s : r.segments)
    if (s.step == 3 && s.pitch_deg == 360.0) s.pitch_deg = -360.0;
  const std::string message = message_of(r);
  expect_says(message, {"step 3"});
  // both legs still turn by a whole turn, but the other one comes first: it is not there
  expect_says(message, {"felt a turn of", "were commanded"});
}

TEST(ClosedFormInput, SegmentsShiftedAgainstTheData) {
  CompressedRecording r = short_recording();
  for (Block& block : r.blocks) block.segment = std::max(0, block.segment - 1);
  expect_says(message_of(r), {"step 1"});
}

TEST(ClosedFormInput, DeadSensors) {
  CompressedRecording r = short_recording();
  for (Block& block : r.blocks) block.accel.setZero();
  expect_says(message_of(r), {"the accelerometers feel"});
  r = short_recording();
  for (Block& block : r.blocks) {
    block.gyro.setZero();
    block.gyro_time.setZero();
    block.coning.setZero();
    block.sculling.setZero();
  }
  expect_says(message_of(r), {"step 2", "felt a turn of", "360 were commanded"});
}

TEST(ClosedFormInput, ATableThatMovedInADwell) {
  CompressedRecording r = short_recording();
  bool done = false;
  for (Block& block : r.blocks) {
    const Segment& s = r.segments[static_cast<std::size_t>(block.segment)];
    if (done || s.step != 9 || s.kind != SegmentKind::still) continue;
    block.gyro.x() += 10.0 * 3600.0 / 0.93;
    done = true;
  }
  expect_says(message_of(r), {"step 9,", "the unit turned by 10.0 deg, expected rest"});
}

// ---- lost samples

RigConfig losing(std::int64_t sample, std::int64_t count) {
  RigConfig config = paper_unit();
  RigFault fault;
  fault.kind = RigFaultKind::lost_sample;
  fault.sample = sample;
  fault.count = count;
  config.faults.push_back(fault);
  return config;
}

// The middle of the first segment of that kind in the step, after `skip` others.
std::int64_t middle(int step, SegmentKind kind, int skip = 0) {
  for (const Segment& s : short_recording().segments)
    if (s.step == step && s.kind == kind && skip-- == 0) return (s.start_sample + s.end_sample) / 2;
  ADD_FAILURE() << "no such segment";
  return 0;
}

TEST(ClosedFormInput, SamplesLostInARotationAreNamed) {
  const std::int64_t sample = middle(10, SegmentKind::rotate, 1);  // the first one positions
  const CompressedRecording r = record_on_rig(short_steps(), losing(sample, 7)).recording;
  ASSERT_EQ(r.events.size(), 1u);
  expect_says(message_of(r), {"step 10: 7 samples are missing near sample", "in a rotation: the angle turned is lost"});
}

TEST(ClosedFormInput, SamplesLostAtRestAreBridged) {
  const Parameters whole =
      must(closed_form_calibrate(short_recording(), start_parameters(short_recording().info))).parameters;
  const CompressedRecording r = record_on_rig(short_steps(), losing(middle(10, SegmentKind::still), 37)).recording;
  ASSERT_EQ(r.events.size(), 1u);
  const ClosedFormResult result = must(closed_form_calibrate(r, start_parameters(r.info)));
  EXPECT_TRUE(result.converged);
  // 37 samples of a second are taken from the rest of it: exact but for rounding, without noise
  expect_within(distance(result.parameters, whole, r.info), {1e-6, 1e-9, 1e-9, 1e-9}, "bridged");
}

}  // namespace
}  // namespace turncal
