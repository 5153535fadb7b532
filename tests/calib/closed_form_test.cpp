// The closed form on what the rig makes and on a recording with noise: accuracy and convergence.

#include "imu_io/base/key_value.h"
#include "tests/calib/closed_form_fixture.h"

namespace turncal {
namespace {

// ---- accuracy

TEST(ClosedForm, ThreePassesRecoverThePapersUnit) {
  const RigRecording made = record_on_rig(fourteen_steps(), paper_unit());
  EXPECT_EQ(made.recording.samples, 1268400);
  const RecordingInfo& info = made.recording.info;
  const ClosedFormResult result = calibrated(made.recording, passes(3));
  EXPECT_EQ(result.passes, 3);
  expect_within(distance(result.parameters, made.truth, info), demanded, "three passes");
  // a21, a31, a32 are not parameters
  EXPECT_EQ(result.parameters.a(1, 0), 0.0);
  EXPECT_EQ(result.parameters.a(2, 0), 0.0);
  EXPECT_EQ(result.parameters.a(2, 1), 0.0);
}

TEST(ClosedForm, ThreePassesRecoverDrawnUnitsOnDrawnTables) {  // level, north, orthogonality, mounting, encoders
  for (const std::uint64_t seed : {2u, 7u, 11u}) {
    RigConfig config = noise_free(default_rig_config());
    config.seed = seed;
    const RigRecording made = record_on_rig(fourteen_steps(), config);
    const RecordingInfo& info = made.recording.info;
    const ClosedFormResult result = calibrated(made.recording, passes(3));
    expect_within(distance(result.parameters, made.truth, info), demanded, "seed " + std::to_string(seed));
  }
}

// On a perfect table nothing but rounding is left: the method has no bias of its own. Lengths and rates are free.
TEST(ClosedForm, OnAPerfectTableItIsExact) {
  RigConfig config = paper_unit();
  config.table_errors = {};
  config.table_errors.random_arcmin = 0.0;
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
  RigConfig config = paper_unit();
  config.table_errors = {};
  config.table_errors.random_arcmin = 0.0;
  const RigRecording plain = record_on_rig(sequence, config);
  const auto dwells = static_cast<int>(std::count_if(plain.recording.segments.begin(), plain.recording.segments.end(),
                                                     [](const Segment& s) { return s.kind != SegmentKind::rotate; }));
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
  ASSERT_EQ(result.corrections.size(), static_cast<std::size_t>(result.passes));
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
// (docs/closed-form.md).
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

  KeyValueFile truth = must(KeyValueFile::read(folder + "/truth.conf"));
  const ParameterVector found = to_vector(result.parameters);
  double sum = 0.0;
  for (std::size_t k = 0; k < 24; ++k) {
    const double error = found[k] - truth.number(parameter_keys[k]);
    if (!parameter_is_free[k]) continue;
    std::printf("%s %9.1e  %5.1f rms\n", std::string(parameter_keys[k]).c_str(), error, error / expected_rms[k]);
    EXPECT_LT(std::abs(error), 3.5 * expected_rms[k]) << parameter_keys[k];
    sum += std::pow(error / expected_rms[k], 2);
  }
  must(truth.check_all_used());
  EXPECT_LT(std::sqrt(sum / 21.0), 1.4);  // chi-square of 21: one in a thousand is above
}

}  // namespace
}  // namespace turncal
