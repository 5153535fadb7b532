// A model without one of its effects, beside the least squares that leave it out.
#include <gtest/gtest.h>

#include <random>

#include "orchestrator/jobs/navigation/navigation_job.h"

namespace turncal {
namespace {

TEST(EffectWorth, WithoutAnEffectIsTheFitThatNeverHadIt) {
  // 40 equations for N01, n11 and three components: two of K2, one of the drift.
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  Eigen::MatrixXd A(40, 5);
  Eigen::VectorXd b(40);
  for (Eigen::Index i = 0; i < A.size(); ++i) A(i) = normal(random);
  for (Eigen::Index i = 0; i < b.size(); ++i) b(i) = normal(random);
  const Eigen::VectorXd all = (A.transpose() * A).ldlt().solve(A.transpose() * b);
  JointResult fit;
  ParameterVector parameters = ParameterVector::Zero();
  const int n11 = 6;
  parameters[0] = all[0];
  parameters[n11] = all[1];
  fit.parameters = from_vector(parameters);
  const EffectEntry *k2 = find_effect("accel_second_order"), *drift = find_effect("gyro_bias_drift");
  fit.effects = {{{k2, 0, 0.0}, all[2], 1.0}, {{drift, 1, 0.0}, all[3], 1.0}, {{k2, 2, 0.0}, all[4], 1.0}};
  fit.free = {0, n11, parameter_count, parameter_count + 1, parameter_count + 2};
  const Eigen::MatrixXd covariance = (A.transpose() * A).inverse();

  const Eigen::MatrixXd left = A(Eigen::all, std::vector<int>{0, 1, 3});
  const Eigen::VectorXd without = (left.transpose() * left).ldlt().solve(left.transpose() * b);
  const ModelWithout model = model_without(fit, covariance, "accel_second_order");
  EXPECT_NEAR(model.parameters[0], without[0], 1e-12);
  EXPECT_NEAR(model.parameters[n11], without[1], 1e-12);
  ASSERT_EQ(model.effects.size(), 3u);
  EXPECT_EQ(model.effects[0], 0.0);
  EXPECT_NEAR(model.effects[1], without[2], 1e-12);
  EXPECT_EQ(model.effects[2], 0.0);
}

}  // namespace
}  // namespace turncal
