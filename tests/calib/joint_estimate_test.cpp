// The joint estimate against the truth of two simulators that share no code with it, and against what it should refuse.
// The long statistics (200 runs, normalised error parameter by parameter) are scripts/study-joint; docs/accuracy.md.
#include "calib/joint/joint_estimate.h"

#include "imu_io/base/key_value.h"
#include "tests/rig_recorder.h"
#include "tests/test.h"

namespace turncal {
namespace {

RigRecording run_of(std::uint64_t seed) {
  RigConfig config = default_rig_config();
  config.seed = 5000 + seed;
  config.noise_seed = 6000 + seed;
  return record_on_rig(fourteen_steps(), config);
}

// Twelve units: the mean of 12 chi-squares of 21 degrees of freedom lies within 21 +- 2.58 sqrt(42/12), 99 of 100 times.
// The estimate starts from the values of Wang (2020); scale factors of gyros and accelerometers are per cents off.
TEST(JointEstimate, ErrorsAreWhatSigmaSays) {
  double sum = 0.0;
  constexpr int runs = 12;
  for (int seed = 1; seed <= runs; ++seed) {
    const RigRecording made = run_of(static_cast<std::uint64_t>(seed));
    const JointResult r = joint_estimate(made.recording);
    ASSERT_TRUE(r.converged) << r.message;
    ASSERT_EQ(r.free.size(), 21u);
    EXPECT_TRUE(r.undetermined.empty());
    EXPECT_TRUE(r.faults.empty()) << r.faults.front().what;
    EXPECT_TRUE(r.whiteness.white) << r.whiteness.message;
    sum += nees(r, made.truth);
  }
  EXPECT_NEAR(sum / runs, 21.0, 2.58 * std::sqrt(42.0 / runs));
}

// The noise that the rig was given: 0.002 deg/sqrt(h), 8 ug/sqrt(Hz). The fit knows its own uncertainty.
TEST(JointEstimate, MeasuresTheNoise) {
  for (const double times : {1.0, 3.0}) {
    RigConfig config = default_rig_config();
    config.noise.gyro_random_walk_deg_per_rt_h *= times;
    config.noise.accel_random_walk_ug_per_rt_hz *= times;
    config.noise.gyro_bias_instability_degph = config.noise.accel_bias_instability_ug = 0.0;
    const JointResult r = joint_estimate(record_on_rig(fourteen_steps(), config).recording);
    ASSERT_TRUE(r.noise_fit.has_value());
    EXPECT_TRUE(r.noise_fit->converged);
    EXPECT_LE(r.noise_fit->evaluations, 30);  // an instability that promises nothing is not looked for
    const double arw = config.noise.gyro_random_walk_deg_per_rt_h * radprs_per_degprh;
    const double vrw = config.noise.accel_random_walk_ug_per_rt_hz * mpsprs_per_ugprHz;
    EXPECT_NEAR(r.noise.angle_random_walk.x(), arw, 3.5 * r.noise_fit->sigma_angle_random_walk.x());
    EXPECT_LT(r.noise_fit->sigma_angle_random_walk.x(), 0.08 * arw);
    EXPECT_NEAR(r.noise.velocity_random_walk.x(), vrw, 0.04 * vrw);  // what is left of the quantisation included
  }
}

// A noise model three times too small is not believed: the result says that the innovations are not white at it.
TEST(JointEstimate, SaysWhenTheGivenNoiseDoesNotFit) {
  const RigRecording made = run_of(31);
  const JointResult fitted = joint_estimate(made.recording);
  JointOptions options;
  options.noise = fitted.noise;
  EXPECT_TRUE(joint_estimate(made.recording, options).whiteness.white);
  options.noise->angle_random_walk /= 3.0;
  options.noise->velocity_random_walk /= 3.0;
  options.noise->accel_pulse_mps /= 3.0;
  const JointResult r = joint_estimate(made.recording, options);
  EXPECT_FALSE(r.whiteness.white);
  EXPECT_GT(r.whiteness.level, 4.0);
}

// Step 1 alone turns about two axes, and by half turns at most.
TEST(JointEstimate, NamesWhatIsNotDetermined) {
  Sequence one = fourteen_steps();
  one.steps.resize(1);
  const JointResult r = joint_estimate(record_on_rig(one, default_rig_config()).recording);
  ASSERT_FALSE(r.undetermined.empty());
  int lost = 0;
  for (int k = 0; k < parameter_count; ++k)
    if (parameter_is_free[k] && !r.determined[k]) {
      ++lost;
      EXPECT_EQ(r.sigma[k], 0.0) << parameter_keys[k] << " has no sigma to print";
    }
  EXPECT_GE(lost, 2);
  for (const Undetermined& u : r.undetermined) EXPECT_FALSE(u.combination.empty());
}

struct Bound {
  const char* key;
  double sigma;
};
// The sigmas that another implementation of the same estimate reached on this recording, rounded up.
constexpr Bound bounds[] = {{"N01", 0.0021}, {"N02", 0.0030}, {"N03", 0.0021}, {"n11", 3.6e-7}, {"n12", 1.1e-6},
                            {"n13", 1.0e-6}, {"n21", 1.2e-6}, {"n22", 5.2e-7}, {"n23", 7.5e-7}, {"n31", 1.9e-6},
                            {"n32", 8.2e-7}, {"n33", 3.7e-7}, {"A01", 3.0e-7}, {"A02", 2.3e-7}, {"A03", 2.9e-7},
                            {"a11", 3.1e-7}, {"a12", 1.1e-6}, {"a13", 1.9e-6}, {"a22", 2.3e-7}, {"a23", 9.7e-7},
                            {"a33", 2.9e-7}};

TEST(JointEstimateShared, CleanRecordingOfAnotherSimulator) {
  const std::filesystem::path folder = std::filesystem::path(TURNCAL_SOURCE_DIR) / "../shared/data/recordings/clean";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "no recordings beside the project (../shared)";
  const CompressedRecording recording = compress_folder(folder.string());
  KeyValueFile truth = must(KeyValueFile::read((folder / "truth.conf").string()));
  const JointResult r = joint_estimate(recording);
  ASSERT_TRUE(r.converged) << r.message;
  const ParameterVector values = to_vector(r.parameters);
  for (const Bound& bound : bounds) {
    const auto k = std::find(parameter_keys.begin(), parameter_keys.end(), bound.key) - parameter_keys.begin();
    EXPECT_LE(r.sigma[k], bound.sigma) << bound.key;
    EXPECT_GT(r.sigma[k], 0.7 * bound.sigma) << bound.key << ": too good to be true";
    EXPECT_LT(std::abs(values[k] - truth.number(bound.key)), 3.5 * r.sigma[k]) << bound.key;
  }
  EXPECT_TRUE(r.faults.empty());
  EXPECT_TRUE(r.whiteness.white) << r.whiteness.message;
}

}  // namespace
}  // namespace turncal
