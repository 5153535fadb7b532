#include "calib/fleet/component_model.h"

#include "calib/statistics/linear_algebra.h"
#include "tests/test.h"

namespace turncal {
namespace {

constexpr double unit_sigma = 2.0, station_sigma = 3.0, noise_sigma = 1.0;

// `each`: recordings of a unit.
ComponentData drawn(std::uint64_t seed, int units, int each, const std::vector<int>& station_of,
                    std::vector<int>& station) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  std::vector<double> at_station(20);
  for (double& s : at_station) s = station_sigma * normal(random);
  ComponentData d{
      Eigen::VectorXd(units * each), Eigen::VectorXd::Constant(units * each, noise_sigma * noise_sigma), {}};
  station.clear();
  for (int u = 0; u < units; ++u) {
    const double own = unit_sigma * normal(random);
    for (int k = 0; k < each; ++k) {
      const int s = station_of[static_cast<std::size_t>(u) % station_of.size()];
      d.y[u * each + k] =
          own + (station_of.size() > 1 ? at_station[static_cast<std::size_t>(s)] : 0.0) + noise_sigma * normal(random);
      d.unit.push_back(u);
      station.push_back(s);
    }
  }
  return d;
}

// 200 units with two recordings each: relative error of a variance is about sqrt(2 / 200) = 0.1.
TEST(ComponentModel, FindsTheScatterOfUnits) {
  double sum = 0.0;
  constexpr int seeds = 20;
  for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
    std::vector<int> station;
    const ComponentData d = drawn(seed, 200, 2, {0}, station);
    sum += unit_variance(d, Eigen::MatrixXd::Ones(400, 1));
  }
  EXPECT_NEAR(sum / seeds, unit_sigma * unit_sigma, 0.1 * unit_sigma * unit_sigma);
}

// 100 units with two recordings each, that change by 5 in between where noise is 1: relative error of the variance sqrt(2 / 100) = 0.14.
TEST(ComponentModel, FindsWhatUnitsChangeBy) {
  double sum = 0.0, none = 0.0;
  constexpr int seeds = 20;
  for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
    std::vector<int> station;
    ComponentData d = drawn(seed, 100, 2, {0}, station);
    none += recording_variance(d);
    std::mt19937_64 random(seed + 100);
    std::normal_distribution<double> change(0.0, 5.0);
    for (double& y : d.y) y += change(random);
    sum += recording_variance(d);
  }
  EXPECT_NEAR(sum / seeds, 25.0, 0.1 * 25.0);
  EXPECT_LT(none / seeds, 0.15);
  std::vector<int> station;
  EXPECT_EQ(recording_variance(drawn(1, 100, 1, {0}, station)), 0.0);
}

// The mean of 100 units with two recordings each: variance (4 + 1 / 2) / 100, though there are 200 numbers.
TEST(ComponentModel, RecordingsOfOneUnitAreNotIndependent) {
  std::vector<int> station;
  const ComponentData d = drawn(7, 100, 2, {0}, station);
  const double information = UnitWeights(d, unit_sigma * unit_sigma).diagonal(Eigen::MatrixXd::Ones(200, 1))[0];
  EXPECT_NEAR(1.0 / information, (unit_sigma * unit_sigma + 0.5) / 100.0, 1e-9);
}

TEST(ComponentModel, ProductIsThatOfTheInverse) {
  std::vector<int> station;
  ComponentData d = drawn(3, 5, 3, {0}, station);
  for (Eigen::Index i = 0; i < d.v.size(); ++i) d.v[i] = 0.5 + 0.1 * static_cast<double>(i);
  d.v[4] = std::numeric_limits<double>::infinity();
  Eigen::MatrixXd V = d.v.asDiagonal();
  V(4, 4) = 1e12;
  for (Eigen::Index i = 0; i < V.rows(); ++i)
    for (Eigen::Index j = 0; j < V.cols(); ++j)
      if (d.unit[static_cast<std::size_t>(i)] == d.unit[static_cast<std::size_t>(j)]) V(i, j) += 4.0;
  const Eigen::MatrixXd X = Eigen::MatrixXd::Random(15, 3);
  const Eigen::MatrixXd expected = X.transpose() * inverse(V) * X;
  const UnitWeights weights(d, 4.0);
  EXPECT_LT((weights.product(X, X) - expected).cwiseAbs().maxCoeff(), 1e-8);
  EXPECT_LT((weights.diagonal(X) - expected.diagonal()).cwiseAbs().maxCoeff(), 1e-8);
}

// 20 stations say their scatter to a third; over 20 seeds to 7 %.
TEST(ComponentModel, TellsStationsFromUnits) {
  double of_unit = 0.0, of_station = 0.0;
  std::vector<int> stations;
  for (int s = 0; s < 20; ++s) stations.push_back(s);
  constexpr int seeds = 20;
  for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
    std::vector<int> station;
    const ComponentData d = drawn(seed, 200, 1, stations, station);
    const std::vector<double> v = variance_components(d, {station});
    of_unit += v[0] / seeds, of_station += v[1] / seeds;
  }
  EXPECT_NEAR(of_unit, unit_sigma * unit_sigma, 0.1 * unit_sigma * unit_sigma);
  EXPECT_NEAR(of_station, station_sigma * station_sigma, 3.0 * 0.33 / std::sqrt(20.0) * station_sigma * station_sigma);
}

}  // namespace
}  // namespace turncal
