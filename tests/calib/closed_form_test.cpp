// The closed form on what the rig makes and on a recording with noise: accuracy and convergence.

#include "orchestrator/devices/dry_run_devices.h"
#include "tests/calib/closed_form_fixture.h"

namespace turncal {
namespace {

// ---- accuracy

// The paper's unit, and drawn ones on drawn tables: level, north, orthogonality, mounting, encoders.
TEST(ClosedForm, ThreePassesRecoverTheUnit) {
  std::vector<RigConfig> configs = {paper_unit()};
  for (const std::uint64_t seed : {2u, 7u, 11u}) {
    configs.push_back(noise_free(default_rig_config()));
    configs.back().seed = seed;
  }
  for (const RigConfig& config : configs) {
    const RigRecording made = record_on_rig(fourteen_steps(), config);
    EXPECT_EQ(made.recording.samples, 1268400);
    const ClosedFormResult result = calibrated(made.recording, passes(3));
    EXPECT_EQ(result.passes, 3);
    const std::string what = "seed " + std::to_string(config.seed);
    expect_within(distance(result.parameters, made.truth, made.recording.info), demanded, what);
    for (const auto& [i, j] : {std::pair{1, 0}, {2, 0}, {2, 1}})
      EXPECT_EQ(result.parameters.a(i, j), 0.0) << what << ": no parameter";
  }
}

// On a perfect table nothing but rounding is left: the method has no bias of its own. Lengths and rates are free.
TEST(ClosedForm, OnAPerfectTableItIsExact) {
  const RigConfig config = unit_on_a_perfect_table();
  const RigRecording made = record_on_rig(fourteen_steps(), config), brief = record_on_rig(short_steps(), config);
  const RecordingInfo& info = made.recording.info;
  const ClosedFormResult result = calibrated(made.recording, passes(8));
  expect_within(distance(result.parameters, made.truth, info), {1e-8, 1e-11, 1e-10, 1e-10}, "perfect table");
  const ClosedFormResult shorter = calibrated(brief.recording);
  EXPECT_TRUE(shorter.converged) << shorter.message;
  expect_within(distance(shorter.parameters, brief.truth, info), {1e-6, 1e-9, 1e-8, 1e-8}, "short dwells");
}

TEST(ClosedForm, IncrementsInRadAndMetresPerSecond) {
  CompressedRecording physical = short_recording();
  const double rad = 0.932920 * rad_per_arcsec, mps = physical.info.accel_pulse_mps;
  for (Block& block : physical.blocks) {
    block.gyro *= rad;
    block.gyro_time *= rad;
    block.coning *= rad * rad;
    block.accel *= mps;
    block.accel_time *= mps;
    block.sculling *= rad * mps;
  }
  physical.info.gyro_increment = physical.info.accel_increment = IncrementKind::physical;
  const Parameters in_pulses = calibrated(short_recording()).parameters;
  Parameters in_rad = calibrated(physical).parameters;
  EXPECT_NEAR(in_rad.n(0, 0), 1.0, 1e-3);
  in_rad.n *= 0.932920;
  expect_within(distance(in_rad, in_pulses, short_recording().info), {1e-8, 1e-10, 1e-10, 1e-10}, "rad against pulses");
}

TEST(ClosedForm, ARepeatedDwellIsPartOfTheWay) {
  const Sequence sequence = short_steps();
  const RigConfig config = unit_on_a_perfect_table();
  const RigRecording plain = record_on_rig(sequence, config);
  const auto dwells = int(
      std::ranges::count_if(plain.recording.segments, [](const Segment& s) { return s.kind != SegmentKind::rotate; }));
  for (const int which : {7, 21, dwells - 1}) {  // after a turn in step 2, in the middle, the 60 s of step 14
    RigRecorderOptions options;
    options.repeated_dwell = which;
    const RigRecording made = record_on_rig(sequence, config, options);
    EXPECT_EQ(made.recording.segments.size(), plain.recording.segments.size() + 2);
    const ClosedFormResult result = calibrated(made.recording);
    EXPECT_TRUE(result.converged);
    expect_within(distance(result.parameters, made.truth, made.recording.info), {1e-6, 1e-9, 1e-8, 1e-8},
                  "dwell " + std::to_string(which) + " repeated");
  }
}

// ---- convergence

TEST(ClosedForm, SaysHowItConverged) {
  const CompressedRecording& recording = short_recording();
  const ClosedFormResult result = calibrated(recording);
  EXPECT_TRUE(result.converged);
  EXPECT_LE(result.passes, 7);
  ASSERT_EQ(result.corrections.size(), std::size_t(result.passes));
  for (std::size_t k = 1; k < result.corrections.size(); ++k)
    EXPECT_LT(result.corrections[k].accel_matrix, 0.1 * result.corrections[k - 1].accel_matrix) << k;
  EXPECT_TRUE(result.message.starts_with("converged in ")) << result.message;
  const ClosedFormResult one = calibrated(recording, {.max_passes = 1});
  EXPECT_FALSE(one.converged);
  EXPECT_TRUE(one.message.starts_with("not converged in 1 pass,")) << one.message;
}

TEST(ClosedForm, DivergenceIsSaid) {
  const CompressedRecording& recording = short_recording();
  const auto diverge = [](const StepMeasurement& m, Parameters& p) { p.n(0, 0) /= m.step == 2 ? 0.0 : 1.0; };
  const ClosedFormResult result = calibrated(recording, {.correct = diverge});
  EXPECT_FALSE(result.converged);
  EXPECT_EQ(result.message, "diverged in pass 1");
}

// ---- a recording with noise, from another simulator

// Root-mean-square errors of the closed form over 200 runs of the rig with the noise of that recording
// (docs/estimator.md).
constexpr std::array<double, 24> expected_rms = {
    5.5e-3, 4.8e-3, 6.2e-3, 2.0e-6, 2.9e-6, 1.7e-6,                           // N0, A0
    5.2e-7, 4.5e-6, 2.9e-6, 4.4e-6, 5.5e-7, 2.9e-6, 5.7e-6, 3.7e-6, 5.7e-7,   // n
    5.6e-7, 3.6e-6, 4.2e-6, 0.0,    5.6e-7, 3.4e-6, 0.0,    0.0,    5.9e-7};  // a

TEST(ClosedForm, TheCleanRecordingWithinItsNoise) {
  const std::string folder = TURNCAL_SOURCE_DIR "/../shared/data/recordings/clean";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << folder << " is not here";
  const CompressedRecording recording = compress_folder(folder);
  const ClosedFormResult result = calibrated(recording);
  EXPECT_TRUE(result.converged) << result.message;

  const ParameterVector error = to_vector(result.parameters) - must(read_truth(folder + "/truth.conf"));
  double sum = 0.0;
  for (const int k : free_parameters()) {
    const double in_rms = error[k] / expected_rms[std::size_t(k)];
    EXPECT_LT(std::abs(in_rms), 3.5) << parameter_keys[std::size_t(k)];
    sum += in_rms * in_rms;
  }
  EXPECT_LT(std::sqrt(sum / 21.0), 1.4);  // chi-square of 21: one in a thousand is above
}

// ---- closed form input ----

// What does not fit the closed form gives one line that names step and place, never parameters.

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

// Of the segments of one step.
std::function<void(CompressedRecording&)> in_step(int step, std::function<void(Segment&)> alter) {
  return [=](CompressedRecording& r) {
    for (Segment& s : r.segments)
      if (s.step == step) alter(s);
  };
}

std::function<void(CompressedRecording&)> of_blocks(std::function<void(Block&)> alter) {
  return [=](CompressedRecording& r) { std::ranges::for_each(r.blocks, alter); };
}

TEST(ClosedFormInput, WhatDoesNotFitIsNamed) {
  using R = CompressedRecording;
  const struct {
    const char* name;
    std::function<void(CompressedRecording&)> alter;
    std::vector<const char*> says;
  } wrong[] = {
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
         std::ranges::find_if(r.blocks, in_dwell)->gyro.x() += 10.0 * 3600.0 / 0.93;
       },
       {"step 9,", "the unit turned by 10.0 deg, expected rest"}},
  };
  for (const auto& one : wrong) {
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
  expect_says(message_of(r), {"step 10: 7 samples missing near sample", "in a rotation: the angle turned is lost"});
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
