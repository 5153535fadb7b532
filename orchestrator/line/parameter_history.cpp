#include "orchestrator/line/parameter_history.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "calib/model/parameters.h"
#include "calib/statistics/distributions.h"

namespace turncal {

ParameterHistory parameter_history(const std::vector<StoredCalibration>& all, std::string_view key) {
  ParameterHistory history;
  history.key = key;
  for (const StoredCalibration& c : all) {
    for (const StoredValue& value : c.values) {
      if (value.key != key) continue;
      history.of.push_back(&c);
      history.units.push_back(c.unit);
      history.times.push_back(c.time_utc);
      history.values.push_back(value.value);
      history.sigmas.push_back(value.sigma);
      if (value.limit.min || value.limit.max) history.limit = value.limit;
    }
  }
  history.chart = control_chart(history.values, history.limit);
  return history;
}

std::vector<std::string_view> free_parameter_keys() {
  std::vector<std::string_view> keys;
  for (std::size_t i = 0; i < parameter_keys.size(); ++i) {
    if (parameter_is_free[i]) keys.push_back(parameter_keys[i]);
  }
  return keys;
}

namespace {

std::optional<Capability> capability(double mean, double sigma, double count, double freedom, const Limit& limit) {
  if ((!limit.min && !limit.max) || !(sigma > 0.0)) return std::nullopt;
  constexpr double far = std::numeric_limits<double>::infinity();
  const double value =
      std::min(limit.max ? *limit.max - mean : far, limit.min ? mean - *limit.min : far) / (3.0 * sigma);
  const double half = normal_95 * std::sqrt(1.0 / (9.0 * count) + value * value / (2.0 * freedom));
  return Capability{value, value - half, value + half};
}

}  // namespace

ControlChart control_chart(std::span<const double> values, const Limit& limit) {
  ControlChart chart;
  chart.count = values.size();
  if (values.empty()) return chart;
  const auto count = static_cast<double>(values.size());
  chart.mean = std::accumulate(values.begin(), values.end(), 0.0) / count;
  if (values.size() < 2) return chart;
  double ranges = 0.0, squares = 0.0;
  for (std::size_t i = 1; i < values.size(); ++i) ranges += std::abs(values[i] - values[i - 1]);
  for (const double value : values) squares += (value - chart.mean) * (value - chart.mean);
  constexpr double d2 = 1.128, efficiency = 0.62;  // of the moving range, against the variance
  constexpr double rounding = 1e-12;               // of values that are all the same
  const bool spread = ranges > rounding * count * std::abs(chart.mean);
  const double sigma = spread ? ranges / (count - 1.0) / d2 : 0.0;
  const double overall = spread ? std::sqrt(squares / (count - 1.0)) : 0.0;
  chart.sigma = sigma;
  chart.overall = overall;
  chart.lower = chart.mean - 3.0 * sigma;
  chart.upper = chart.mean + 3.0 * sigma;
  chart.cpk = capability(chart.mean, sigma, count, efficiency * (count - 1.0), limit);
  chart.ppk = capability(chart.mean, overall, count, count - 1.0, limit);
  if (!(sigma > 0.0)) return chart;
  std::vector<double> z;
  for (const double value : values) z.push_back((value - chart.mean) / sigma);
  chart.signals = run_signals(z);
  for (const RunSignal& signal : chart.signals) {
    if (signal.rule == 1) chart.outside.push_back(signal.point);
  }
  return chart;
}

}  // namespace turncal
