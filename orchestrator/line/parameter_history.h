// One parameter over the calibrations of a results database, in the order of time, with its control chart.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "orchestrator/line/run_rules.h"
#include "orchestrator/records/results_database.h"
#include "orchestrator/station/verdict.h"

namespace turncal {

// One quantity over many calibrations: control limits of individuals, run rules and capability.
//
//   short-term sigma s = mean |x_i - x_(i-1)| / 1.128        (moving range of two, d2 = 1.128; ISO 7870-2)
//   control limits    mean -+ 3 s
//   Cpk = min(max - mean, mean - min) / (3 s), over the limits there are; Ppk: with the standard deviation of all in place of s
//
// The interval of both is Bissell's: C -+ 1.96 sqrt(1 / (9 n) + C^2 / (2 nu)), nu the degrees of freedom of the sigma: n - 1 of all,
// 0.62 (n - 1) of the moving range (A. F. Bissell, "How reliable is your capability index?", Applied Statistics 39 (3), 1990, 331-340).
// In the order of time. At least two values, or there are no limits; not enough of them to say much are not refused.
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
  std::string key;
  std::vector<std::string> units, times;  // of whom and when
  std::vector<double> values;
  std::vector<std::optional<double>> sigmas;
  Limit limit;  // of the newest calibration that was judged by one
  ControlChart chart;
};

struct ParameterHistory : ChartedQuantity {
  std::vector<const StoredCalibration*> of;  // those that have the parameter; point into the list given
};

ParameterHistory parameter_history(const std::vector<StoredCalibration>& all, std::string_view key);

// Parameters that are estimated; the others are zero by the choice of the body frame.
std::vector<std::string_view> free_parameter_keys();

}  // namespace turncal
