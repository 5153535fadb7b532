// Do two stations give the same? Every parameter of units calibrated at both, or else of the units of each; and whether they drift apart.
//
//   both     d_u = mean of unit u at b - mean at a; difference = mean d_u, sigma = s(d) / sqrt(n)
//   each     difference = mean of b - mean of a, sigma = sqrt(s_a^2 / n_a + s_b^2 / n_b) (Welch): the units' own spread is in it
//   drift    slope of a straight line over time at b, less that at a, for 30 days
//
// `stands_out` takes into account that 21 parameters are looked at: 0.05 / 21, two-sided.
#pragma once

#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "orchestrator/records/results_database.h"

namespace turncal {

struct StationDifference {
  std::string a, b, key;
  bool of_the_same_units = false;
  std::size_t count_a = 0, count_b = 0;  // units at both: the same number twice
  double difference = 0.0, sigma = 0.0;
  std::optional<double> drift, drift_sigma;  // for 30 days; empty: less than a day, or too few
  static constexpr double limit_sigmas = 3.04;
  bool stands_out() const { return std::abs(difference) > limit_sigmas * sigma; }
  bool drifts() const { return drift && std::abs(*drift) > limit_sigmas * *drift_sigma; }
};

inline constexpr std::size_t least_units = 5;  // at both, or at each

// Of every pair of stations and every parameter that is estimated; none where there are too few units.
std::vector<StationDifference> station_differences(const std::vector<StoredCalibration>& all);

}  // namespace turncal
