#include "calib/fleet/fleet_prior.h"

#include "tests/test.h"

namespace turncal {
namespace {

// Units about a mean, in units of 1 for every parameter: they scatter by `scatter`, change by `change`, and are known to 0.5.
struct Fleet {
  double scatter = 3.0, change = 0.5, sigma = 0.5;
  std::mt19937_64 random;
  std::normal_distribution<double> normal;

  explicit Fleet(std::uint64_t seed) : random(seed) {}
  ParameterVector drawn(double size) {
    ParameterVector v = ParameterVector::Zero();
    for (int k = 0; k < parameter_count; ++k)
      if (parameter_is_free[static_cast<std::size_t>(k)]) v[k] = size * normal(random);
    return v;
  }
  EarlierCalibration calibrated(int unit, int time, const ParameterVector& truth) {
    return {"U" + std::to_string(1000 + unit),
            std::to_string(time),
            truth + drawn(sigma),
            sigma * sigma * Eigen::MatrixXd::Identity(parameter_count, parameter_count),
            {}};
  }
  // Each unit calibrated twice; `truth` is that of unit 0 afterwards.
  std::vector<EarlierCalibration> history(int units, ParameterVector& truth, int times = 2) {
    std::vector<EarlierCalibration> all;
    for (int u = units; u >= 0; --u) {
      truth = drawn(scatter);
      for (int t = 0; t < times; ++t) {
        all.push_back(calibrated(u, t, truth));
        truth += drawn(change);
      }
    }
    return all;
  }
  JointResult estimate(const ParameterVector& truth, double estimate_sigma) {
    JointResult e;
    e.converged = true;
    for (int k = 0; k < parameter_count; ++k) {
      if (!parameter_is_free[static_cast<std::size_t>(k)]) continue;
      e.free.push_back(k);
      e.determined[static_cast<std::size_t>(k)] = true;
    }
    e.parameters = from_vector(truth + drawn(estimate_sigma));
    e.covariance = estimate_sigma * estimate_sigma * Eigen::MatrixXd::Identity(21, 21);
    e.last.gradient = Eigen::VectorXd::Zero(parameter_count);
    return e;
  }
};

// 21 values each, 60 fleets: the mean of chi-square / 21 is 1 +- 0.04 if the sigmas are true. The fleet's spread is taken a little too wide.
TEST(FleetPrior, CombinedEstimateKeepsToItsSigmasAndIsBetter) {
  double nees = 0.0, data = 0.0, both = 0.0;
  constexpr int fleets = 60;
  for (int seed = 1; seed <= fleets; ++seed) {
    Fleet fleet(static_cast<std::uint64_t>(seed));
    ParameterVector truth;
    const std::optional<FleetPrior> prior = fleet_prior(fleet.history(80, truth), "U1000");
    ASSERT_TRUE(prior);
    EXPECT_EQ(prior->units, 80U);
    EXPECT_EQ(prior->own, 2U);
    JointResult e = fleet.estimate(truth, 2.0);
    data += (to_vector(e.parameters) - truth).squaredNorm() / fleets;
    const PriorEffect effect = use_prior(*prior, e);
    if (!effect.changed.empty()) continue;
    const ParameterVector error = to_vector(e.parameters) - truth;
    both += error.squaredNorm() / fleets;
    for (const int k : e.free) nees += error[k] * error[k] / (e.sigma[k] * e.sigma[k]) / 21.0 / fleets;
    EXPECT_GT(effect.share[0], 0.7);  // 1 / (0.5^2 / 2 + 0.5^2) against 1 / 2^2, about 0.91
    EXPECT_LT(effect.share[0], 0.97);
  }
  EXPECT_NEAR(nees, 1.0, 0.15);
  EXPECT_LT(both, 0.2 * data);
}

TEST(FleetPrior, NamesWhatHasChangedAndIsThenNotUsed) {
  int alarms = 0, found = 0;
  for (int seed = 1; seed <= 100; ++seed) {
    Fleet fleet(static_cast<std::uint64_t>(1000 + seed));
    ParameterVector truth;
    const std::optional<FleetPrior> prior = fleet_prior(fleet.history(80, truth), "U1000");
    JointResult same = fleet.estimate(truth, 0.5);
    alarms += !use_prior(*prior, same).changed.empty();
    truth[8] += 10.0;
    JointResult e = fleet.estimate(truth, 0.5);
    const ParameterVector before = to_vector(e.parameters);
    found += use_prior(*prior, e).changed == std::vector<int>{8};
    EXPECT_EQ(to_vector(e.parameters), before);
  }
  EXPECT_LE(alarms, 5);  // 1 % of 100
  EXPECT_GE(found, 95);
}

TEST(FleetPrior, NeedsUnitsAndPairs) {
  Fleet fleet(7);
  ParameterVector truth;
  EXPECT_FALSE(fleet_prior(fleet.history(9, truth), "U1000"));
  EXPECT_TRUE(fleet_prior(fleet.history(10, truth), "U1000"));
  const std::optional<FleetPrior> once = fleet_prior(fleet.history(80, truth, 1), "U1000");
  ASSERT_TRUE(once);
  EXPECT_EQ(once->own, 0U);
  EXPECT_NEAR(once->covariance(0, 0), 9.25, 4.0);
}

}  // namespace
}  // namespace turncal
