// Control charts: a quantity over the calibrations of a results database in order of time, its control limits, run rules and capability.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "orchestrator/records/results_database.h"
#include "orchestrator/station/verdict.h"

namespace turncal {

// The eight tests for special causes on a chart of individuals.
//
//   z_i = (x_i - mean) / sigma; a test gives a signal at the last point of the stretch that meets it
//
// L. S. Nelson, "The Shewhart Control Chart: Tests for Special Causes", Journal of Quality Technology 16 (4), 1984, 237-239. The
// false alarm rates are exact for independent normal values of known mean and sigma, at each point with enough points before it. With mean
// and sigma estimated from few values they are higher, above all for test 1.
struct RunRule {
  const char* words;
  std::size_t stretch;  // points
  double false_alarm;   // a point
};
// Numbered from 1 in the paper.
inline constexpr std::array<RunRule, 8> run_rules = {{
    {"one point beyond 3 sigma", 1, 0.00270},                                // 2 (1 - Phi(3))
    {"nine in a row on one side of the mean", 9, 0.00391},                   // 2 / 2^9
    {"six in a row rising, or falling", 6, 0.00278},                         // 2 / 6!
    {"fourteen in a row, alternating up and down", 14, 0.00457},             // 2 E_14 / 14!, E_14 = 199360981
    {"two of three beyond 2 sigma on one side", 3, 0.00306},                 // 2 (3 p^2 - 2 p^3), p = 1 - Phi(2)
    {"four of five beyond 1 sigma on one side", 5, 0.00553},                 // 2 (5 p^4 - 4 p^5), p = 1 - Phi(1)
    {"fifteen in a row within 1 sigma", 15, 0.00326},                        // (1 - 2 p)^15
    {"eight in a row on both sides with none within 1 sigma", 8, 0.000102},  // (2 p)^8 - 2 p^8
}};

struct RunSignal {
  std::size_t rule = 1;   // number in the paper
  std::size_t point = 0;  // last point of the stretch
  bool operator==(const RunSignal&) const = default;
};

// Returns the signals sorted by point, then by rule.
std::vector<RunSignal> run_signals(std::span<const double> z);

// One quantity over many calibrations: control limits of individuals, run rules and capability.
//
//   short-term sigma s = mean |x_i - x_(i-1)| / 1.128        (moving range of two, d2 = 1.128; ISO 7870-2)
//   control limits    mean -+ 3 s
//   Cpk = min(max - mean, mean - min) / (3 s), over the limits there are; Ppk: with the standard deviation of all values in place of s
//
// The interval of both is Bissell's: C -+ 1.96 sqrt(1 / (9 n) + C^2 / (2 nu)), nu the degrees of freedom of the sigma: n - 1 of all,
// 0.62 (n - 1) of the moving range (A. F. Bissell, "How reliable is your capability index?", Applied Statistics 39 (3), 1990, 331-340).
// Values are in order of time. Fewer than two give no limits; few values are not refused.
struct Capability {
  double value = 0.0;
  double low = 0.0, high = 0.0;  // 95 %
};

struct ControlChart {
  std::size_t count = 0;
  double mean = 0.0;
  std::optional<double> sigma;    // short-term; empty for fewer than two values
  std::optional<double> overall;  // standard deviation of all
  std::optional<double> lower, upper;
  std::vector<std::size_t> outside;    // test 1 of the run rules
  std::vector<RunSignal> signals;      // of all tests
  std::optional<Capability> cpk, ppk;  // empty without limits or without spread
};

ControlChart control_chart(std::span<const double> values, const Limit& limit);

struct ChartedQuantity {
  std::string key, unit;                  // of the values: deg/h, arcsec/pulse; -, or empty: none
  std::vector<std::string> units, times;  // serial numbers and times
  std::vector<double> values;
  std::vector<std::optional<double>> sigmas;
  double largest_sigma() const { return sigmas.empty() ? 0.0 : std::ranges::max(sigmas).value_or(0.0); }
  Limit limit;  // of the newest calibration judged by a limit
  ControlChart chart;
};

struct ParameterHistory {
  ChartedQuantity charted;
  std::vector<const StoredCalibration*> of;  // calibrations with the parameter; point into the given list
};

ParameterHistory parameter_history(const std::vector<StoredCalibration>& all, const std::string& key);

}  // namespace turncal
