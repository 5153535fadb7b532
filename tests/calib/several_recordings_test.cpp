// One unit switched on several times: rig recordings with the same scale factors and misalignments and other biases.
#include "calib/joint/several_recordings.h"

#include "tests/rig_recorder.h"
#include "tests/test.h"

namespace turncal {
namespace {

RigConfig quiet() {
  RigConfig config = default_rig_config();
  config.seed = 77;
  config.noise.gyro_bias_instability_degph = config.noise.accel_bias_instability_ug = 0.0;
  return config;
}

RigRecording switched_on(const RigConfig& config, std::uint64_t noise_seed, const char* sequence) {
  RigConfig c = config;
  c.noise_seed = noise_seed;
  return record_on_rig(must_read_sequence(sequence), c);
}

// An estimate as if the unit had had other biases: exact, since what the estimate says of them is linear.
JointResult with_biases(JointResult estimate, double sign) {
  estimate.parameters.N0_degph.array() += sign * gyro_turn_on_degph;
  estimate.parameters.A0_g.array() += sign * accel_turn_on_g;
  return estimate;
}

TEST(SeveralRecordings, CommonParametersGainAndBiasesAreOfEach) {
  std::vector<JointResult> estimates;
  Parameters truth;
  for (const double sign : {1.0, -1.0, 0.0}) {
    const RigRecording made = switched_on(quiet(), 501 + estimates.size(), "fourteen_step.seq");
    truth = made.truth;
    estimates.push_back(with_biases(joint_estimate(made.recording), sign));
  }
  const SeveralRecordings r = combine_recordings(estimates);
  EXPECT_EQ(r.degrees, 30);
  EXPECT_TRUE(r.agree) << r.disagreement;
  EXPECT_GT(r.p_value, 0.001);
  EXPECT_LT(nees(r.unit, truth), chi_square_21_one_in_1000);
  for (int k = 6; k < parameter_count; ++k) {
    if (!parameter_is_free[k]) continue;
    EXPECT_NEAR(r.unit.sigma[k] / estimates[0].sigma[k], 1.0 / std::sqrt(3.0), 0.06) << k;
  }
  for (int k = 0; k < 6; ++k) {
    const double step = k < 3 ? gyro_turn_on_degph : accel_turn_on_g;
    EXPECT_NEAR((r.turn_ons.biases[0][k] - r.turn_ons.biases[1][k]) / (2.0 * step), 1.0, 0.1) << k;
    EXPECT_NEAR(r.turn_ons.repeatability[k] / step, 1.0, 0.1) << k;  // of +1, -1 and 0
    EXPECT_GT(r.unit.sigma[k], 0.9 * step / std::sqrt(3.0)) << k;
  }
}

// A short recording that determines little leans on one that does.
TEST(SeveralRecordings, WhatOneDoesNotDetermineTheOtherMay) {
  const RigRecording whole = switched_on(quiet(), 511, "fourteen_step.seq");
  JointResult little = joint_estimate(switched_on(quiet(), 512, "short_demo.seq").recording);
  const JointResult alone = joint_estimate(whole.recording);
  const SeveralRecordings r = combine_recordings({alone, little});
  for (const int k : r.unit.free) {
    EXPECT_TRUE(r.unit.determined[k]) << k;
    if (k < 6) continue;
    EXPECT_LT(r.unit.sigma[k], 1.001 * alone.sigma[k]) << k;
  }
  EXPECT_TRUE(r.agree) << r.disagreement << " of " << r.degrees;
}

// At four headings of a level table nothing tells a scale factor from its bias: where its own fit ends along that is no contradiction.
TEST(SeveralRecordings, ALevelTableContradictsNothing) {
  const RigRecording whole = switched_on(quiet(), 531, "fourteen_step.seq");
  const JointResult alone = joint_estimate(whole.recording);
  for (const std::uint64_t seed : {532u, 533u, 534u, 535u, 536u, 537u}) {
    const RigRecording turned = switched_on(quiet(), seed, "verify.seq");
    const JointResult level = estimate_beside(turned.recording, alone.parameters);
    ASSERT_TRUE(level.converged) << level.message;
    EXPECT_FALSE(level.undetermined.empty());
    const SeveralRecordings r = combine_recordings({alone, level});
    EXPECT_TRUE(r.agree) << seed << ": " << r.disagreement << " of " << r.degrees;
    EXPECT_LT(nees(r.unit, whole.truth), chi_square_21_one_in_1000) << seed;
  }
}

TEST(SeveralRecordings, AScaleFactorThatChangedIsSaid) {
  const JointResult first = joint_estimate(switched_on(quiet(), 521, "fourteen_step.seq").recording);
  JointResult second = joint_estimate(switched_on(quiet(), 522, "fourteen_step.seq").recording);
  second.parameters.n(0, 0) += 12.0 * second.sigma[6];
  const SeveralRecordings r = combine_recordings({first, second});
  EXPECT_FALSE(r.agree);
  EXPECT_LT(r.p_value, 1e-6);
  EXPECT_GT(r.unit.sigma[6], 1.2 * first.sigma[6]);
}

}  // namespace
}  // namespace turncal
