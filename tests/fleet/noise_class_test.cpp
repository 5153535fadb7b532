#include "calib/fleet/fleet_prior.h"

#include "tests/rig_recorder.h"
#include "tests/test.h"

namespace turncal {
namespace {

// A part whose units scatter by 10 %, each measured to 3 %; a recording of another unit measures its own to 20 %.
struct Part {
  std::mt19937_64 random;
  std::normal_distribution<double> normal;
  explicit Part(std::uint64_t seed) : random(seed) {}
  double drawn(double sigma) { return std::exp(sigma * normal(random)); }

  NoiseModel unit(double angle, double velocity) const {
    NoiseModel noise;
    noise.angle_random_walk.setConstant(angle);
    noise.velocity_random_walk.setConstant(velocity);
    return noise;
  }
  std::vector<NoiseModel> units(int count) {
    std::vector<NoiseModel> all;
    for (int u = 0; u < count; ++u) all.push_back(unit(2.0 * drawn(0.1) * drawn(0.03), 5.0 * drawn(0.1) * drawn(0.03)));
    return all;
  }
  NoiseFit measured(double angle, double velocity) {
    NoiseFit fit;
    fit.noise = unit(angle * drawn(0.2), velocity * drawn(0.2));
    fit.sigma_angle_random_walk = 0.2 * fit.noise.angle_random_walk;
    fit.sigma_velocity_random_walk = 0.2 * fit.noise.velocity_random_walk;
    return fit;
  }
};

// 0.79 of the information is the class's: 0.2^2 against 0.1^2 + 0.03^2. Errors fall to 0.46 of the recording's own; 400 units: +- 4 %.
TEST(NoiseClass, HalvesTheErrorOfWhatARecordingMeasures) {
  double own = 0.0, with = 0.0;
  int changed = 0;
  for (int seed = 1; seed <= 400; ++seed) {
    Part part(static_cast<std::uint64_t>(seed));
    const std::optional<NoiseClass> of_part = noise_class(part.units(100));
    ASSERT_TRUE(of_part);
    const double truth = 2.0 * part.drawn(0.1);
    const NoiseFit fit = part.measured(truth, 5.0);
    const NoiseOfClass noise = noise_of_class(*of_part, fit);
    changed += !noise.changed.empty();
    own += std::pow(std::log(fit.noise.angle_random_walk[1] / truth), 2);
    with += std::pow(std::log(noise.noise.angle_random_walk[1] / truth), 2);
    if (noise.changed.empty()) {
      EXPECT_NEAR(noise.share[0], 0.79, 0.08);
    }
  }
  EXPECT_NEAR(std::sqrt(with / own), 0.46, 0.05);
  EXPECT_LE(changed, 12);  // 1 % of 400, and 3.5 sigma of it
}

TEST(NoiseClass, NamesARecordingThatIsLouderAndLeavesItsNoise) {
  int named = 0;
  for (int seed = 1; seed <= 100; ++seed) {
    Part part(std::uint64_t(1000 + seed));
    const std::optional<NoiseClass> of_part = noise_class(part.units(50));
    const NoiseFit fit = part.measured(2.0, 25.0);  // 1.6 in the logarithm: 7 sigma
    const NoiseOfClass noise = noise_of_class(*of_part, fit);
    named += noise.changed == std::vector<int>{1} && noise.z[1] > 0.0;
    if (!noise.changed.empty()) {
      EXPECT_EQ(noise.noise.velocity_random_walk, fit.noise.velocity_random_walk);
    }
  }
  EXPECT_GE(named, 95);
}

TEST(NoiseClass, HasAnInstabilityOnlyWhereMostUnitsHaveOne) {
  Part part(7);
  EXPECT_FALSE(noise_class(part.units(9)));
  std::vector<NoiseModel> units = part.units(20);
  for (std::size_t k = 0; k < 9; ++k) units[k].gyro_bias_instability_radps = 3e-9;
  for (std::size_t k = 0; k < 12; ++k) units[k].accel_bias_instability_mps2 = 2e-6;
  const NoiseOfClass noise = noise_of_class(*noise_class(units), part.measured(2.0, 5.0));
  EXPECT_EQ(noise.noise.gyro_bias_instability_radps, 0.0);
  EXPECT_EQ(noise.noise.accel_bias_instability_mps2, 2e-6);
}

// With the noise that was fitted the estimate is what it was, and so are its sigmas; with twice of it the sigmas are twice as large.
TEST(NoiseClass, IsWhatTheEstimateIsWeighedBy) {
  const RigRecording made = record_on_rig(must_read_sequence("forty_minutes.seq"), RigConfig{});
  const JointResult alone = joint_estimate(made.recording);
  ASSERT_TRUE(alone.converged);
  const JointResult same = estimate_with_noise(made.recording, alone, alone.noise);
  ASSERT_TRUE(same.converged);
  NoiseModel louder = alone.noise;
  louder.angle_random_walk *= 2.0;
  louder.velocity_random_walk *= 2.0;
  const JointResult twice = estimate_with_noise(made.recording, alone, louder);
  for (const int k : alone.free) {
    EXPECT_NEAR(to_vector(same.parameters)[k], to_vector(alone.parameters)[k], 0.05 * alone.sigma[k]) << k;
    EXPECT_NEAR(same.sigma[k] / alone.sigma[k], 1.0, 0.01) << k;
    EXPECT_GT(twice.sigma[k] / alone.sigma[k], 1.2) << k;
    EXPECT_LT(twice.sigma[k] / alone.sigma[k], 2.05) << k;
  }
}

}  // namespace
}  // namespace turncal
