// What does not fit the closed form gives one line that names step and place, never parameters.

#include "tests/calib/closed_form_fixture.h"

namespace turncal {
namespace {

std::string message_of(const CompressedRecording& recording) {
  const Result<ClosedFormResult> result = closed_form_calibrate(recording, start_parameters(recording.info));
  if (result.ok()) return "(success) " + result->message;
  EXPECT_EQ(result.error().kind, ErrorKind::input);
  EXPECT_EQ(result.error().message.find('\n'), std::string::npos);
  return result.error().message;
}

void expect_says(const std::string& message, const std::vector<const char*>& parts) {
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

struct Wrong {
  const char* name;
  std::function<void(CompressedRecording&)> alter;
  std::vector<const char*> says;
};

// Of the segments of one step.
std::function<void(CompressedRecording&)> in_step(int step, std::function<void(Segment&)> alter) {
  return [=](CompressedRecording& r) {
    for (Segment& s : r.segments)
      if (s.step == step) alter(s);
  };
}

std::function<void(CompressedRecording&)> of_blocks(std::function<void(Block&)> alter) {
  return [=](CompressedRecording& r) { std::for_each(r.blocks.begin(), r.blocks.end(), alter); };
}

TEST(ClosedFormInput, WhatDoesNotFitIsNamed) {
  using R = CompressedRecording;
  const Wrong wrong[] = {
      {"no dwell",
       in_step(7, [](Segment& s) { s.kind = s.roll_deg == -90.0 ? SegmentKind::rotate : s.kind; }),
       {"step 7: expected a dwell after a turn by heading 0, pitch 0, roll -90 that starts at rest at heading 0, pitch "
        "0, roll 0"}},
      {"x never up",
       in_step(1, [](Segment& s) { s.pitch_deg = s.pitch_deg == 90.0 ? 60.0 : s.pitch_deg; }),
       {"step 1 never sees the x axis vertical (up): expected a dwell at heading 0, pitch 90, roll 0"}},
      {"y never down",
       in_step(5, [](Segment& s) { s.roll_deg = s.roll_deg != 0.0 ? 170.0 : s.roll_deg; }),
       {"step 5 never sees the y axis vertical (down)"}},
      {"no gravity", [](R& r) { r.info.gravity_mps2 = 0.0; }, {"gravity_mps2 = 0.0000: expected more than 0"}},
      {"gravity nan", [](R& r) { r.info.gravity_mps2 = std::nan(""); }, {"gravity_mps2 = nan"}},
      {"latitude", [](R& r) { r.info.latitude_deg = 120.0; }, {"latitude_deg = 120.0000: expected -90 to 90"}},
      {"no period", [](R& r) { r.info.sample_period_s = 0.0; }, {"sample_period_s"}},
      {"nothing recorded",
       [](R& r) { r.blocks.clear(), r.segments.clear(); },
       {"the recording has no samples in its segments"}},
      {"angles that are not felt",
       in_step(1, [](Segment& s) { s.pitch_deg = -s.pitch_deg; }),
       {"step 1,", "pitch 90", "179.", "deg from the vertical", "the segments do not fit the data"}},
      // 360 and -360 end at the same attitude: only the gyros can tell.
      {"the other way round",
       in_step(3, [](Segment& s) { s.pitch_deg = s.pitch_deg == 360.0 ? -360.0 : s.pitch_deg; }),
       {"step 3", "felt a turn of", "were commanded"}},
      {"shifted segments", of_blocks([](Block& b) { b.segment = std::max(0, b.segment - 1); }), {"step 1"}},
      {"dead accelerometers", of_blocks([](Block& b) { b.accel.setZero(); }), {"the accelerometers feel"}},
      {"dead gyros",
       of_blocks([](Block& b) { b.gyro.setZero(), b.gyro_time.setZero(), b.coning.setZero(), b.sculling.setZero(); }),
       {"step 2", "felt a turn of", "360 were commanded"}},
      {"moved in a dwell",
       [](R& r) {
         const auto in_dwell = [&](const Block& b) {
           return r.segments[b.segment].step == 9 && r.segments[b.segment].kind == SegmentKind::still;
         };
         std::find_if(r.blocks.begin(), r.blocks.end(), in_dwell)->gyro.x() += 10.0 * 3600.0 / 0.93;
       },
       {"step 9,", "the unit turned by 10.0 deg, expected rest"}},
  };
  for (const Wrong& one : wrong) {
    CompressedRecording r = short_recording();
    one.alter(r);
    SCOPED_TRACE(one.name);
    expect_says(message_of(r), one.says);
  }
}

TEST(ClosedFormInput, AShortDwellIsNamedWithItsLength) {
  std::string text = short_steps().text;
  text.replace(text.find("dwell 3000", text.find("step 8")), 10, "dwell 1200");
  const CompressedRecording r = record_on_rig(must(parse_sequence(text, "one short dwell")), paper_unit()).recording;
  expect_says(message_of(r), {"step 8, static segment of samples", "(heading -90, pitch 90, roll 0)",
                              "a dwell of 6.000 s is too short, expected at least 10 s"});
}

// ---- lost samples

RigConfig losing(std::int64_t sample, std::int64_t count) {
  RigConfig config = paper_unit();
  config.faults.push_back({.kind = RigFaultKind::lost_sample, .sample = sample, .count = count});
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
  const Parameters whole = calibrated(short_recording()).parameters;
  const CompressedRecording r = record_on_rig(short_steps(), losing(middle(10, SegmentKind::still), 37)).recording;
  ASSERT_EQ(r.events.size(), 1u);
  const ClosedFormResult result = calibrated(r);
  EXPECT_TRUE(result.converged);
  // 37 samples of a second are taken from the rest of it: exact but for rounding, without noise
  expect_within(distance(result.parameters, whole, r.info), {1e-6, 1e-9, 1e-9, 1e-9}, "bridged");
}

}  // namespace
}  // namespace turncal
