// Fleets whose scores are drawn from their distribution, s ~ N(Q x, Q), with the Q of one recording of the rig: what the algebra
// of calib/fleet makes of a fleet, apart from how well scores of real recordings keep to that distribution (study_fleet.cpp).
#pragma once

#include <cmath>
#include <functional>
#include <random>
#include <string>
#include <vector>

#include "calib/fleet/fleet_diagnosis.h"
#include "calib/statistics/numerics.h"
#include "tests/rig_recorder.h"

namespace turncal {

inline const UnitStatistics& statistics_of_one() {
  static const UnitStatistics one = [] {
    RigConfig config;
    const RigRecording made = record_on_rig(must_read_sequence("fourteen_step.seq"), config);
    return unit_statistics(made.recording, joint_estimate(made.recording));
  }();
  return one;
}

inline int column_of(const UnitStatistics& u, const std::string& key) {
  for (std::size_t k = 0; k < u.columns.size(); ++k)
    if (u.columns[k] == key) return int(k);
  return -1;
}

inline double sigma_of(const std::string& key) {
  const UnitStatistics& u = statistics_of_one();
  const int k = column_of(u, key);
  return 1.0 / std::sqrt(double(u.Q(k, k)));
}

struct DrawnUnit {
  std::size_t index;
  std::string station;
  double day;
  std::mt19937_64& random;
};

// `add`: what this unit truly has, (column, value). Station of unit i: i mod stations; day: 26 weeks, in order.
using DrawnEffects = std::vector<std::pair<std::string, double>>;
inline std::vector<FleetMember> drawn_fleet(std::uint64_t seed, std::size_t units, std::size_t stations,
                                            const std::function<DrawnEffects(const DrawnUnit&)>& add) {
  const UnitStatistics& one = statistics_of_one();
  static const Eigen::MatrixXd root = [&] {
    const SymmetricEigen eigen = symmetric_eigen(one.Q.cast<double>());
    return Eigen::MatrixXd(eigen.vectors * eigen.values.cwiseMax(0.0).cwiseSqrt().asDiagonal());
  }();
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  std::vector<FleetMember> members;
  for (std::size_t i = 0; i < units; ++i) {
    FleetMember m;
    m.unit = "U" + std::to_string(1000 + i);
    m.level = {"S" + std::to_string(1 + i % stations)};
    m.day = 182.0 * double(i) / double(units);
    m.statistics = one;
    m.statistics.s = root * Eigen::VectorXd::NullaryExpr(root.cols(), [&] { return normal(random); });
    for (int k = 0; k < parameter_count; ++k) m.statistics.value[k] += normal(random) * 30.0 * one.sigma[k];
    for (const auto& [key, value] : add({i, m.level[0], m.day, random})) {
      const int k = column_of(one, key);
      m.statistics.s += one.Q.col(k).cast<double>() * value;
      m.statistics.value -= one.moves.col(k).cast<double>() * value;  // what leaving it out does to the parameters
    }
    members.push_back(std::move(m));
  }
  return members;
}

}  // namespace turncal
