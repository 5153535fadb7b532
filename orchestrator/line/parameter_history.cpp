#include "orchestrator/line/parameter_history.h"

#include <cmath>
#include <limits>
#include <numeric>

#include "calib/model/parameters.h"
#include "calib/statistics/numerics.h"
#include "orchestrator/station/number_text.h"

namespace turncal {

namespace {

using Stretch = std::span<const double>;

// Returns whether at least `least` values lie beyond `level` on one side.
bool on_one_side(Stretch z, double level, std::ptrdiff_t least) {
  return std::ranges::count_if(z, [level](double v) { return v > level; }) >= least ||
         std::ranges::count_if(z, [level](double v) { return v < -level; }) >= least;
}

bool goes_one_way(Stretch z) {
  const auto not_rising = [](double a, double b) { return a >= b; };
  const auto not_falling = [](double a, double b) { return a <= b; };
  return std::ranges::adjacent_find(z, not_rising) == z.end() || std::ranges::adjacent_find(z, not_falling) == z.end();
}

bool goes_up_and_down(Stretch z) {
  for (std::size_t i = 2; i < z.size(); ++i)
    if (!((z[i] - z[i - 1]) * (z[i - 1] - z[i - 2]) < 0.0)) return false;
  return true;
}

bool all_within(Stretch z) {
  return std::ranges::all_of(z, [](double v) { return std::abs(v) < 1.0; });
}

bool none_within_on_both_sides(Stretch z) {
  return std::ranges::all_of(z, [](double v) { return std::abs(v) > 1.0; }) &&
         std::ranges::any_of(z, [](double v) { return v > 0.0; }) &&
         std::ranges::any_of(z, [](double v) { return v < 0.0; });
}

bool meets(std::size_t rule, Stretch z) {
  switch (rule) {
    case 1: return std::abs(z.front()) > 3.0;
    case 2: return on_one_side(z, 0.0, 9);
    case 3: return goes_one_way(z);
    case 4: return goes_up_and_down(z);
    case 5: return on_one_side(z, 2.0, 2);
    case 6: return on_one_side(z, 1.0, 4);
    case 7: return all_within(z);
    default: return none_within_on_both_sides(z);
  }
}

std::optional<Capability> capability(double mean, double sigma, double count, double freedom, const Limit& limit) {
  if ((!limit.min && !limit.max) || !(sigma > 0.0)) return std::nullopt;
  constexpr double far = std::numeric_limits<double>::infinity();
  const double value =
      std::min(limit.max ? *limit.max - mean : far, limit.min ? mean - *limit.min : far) / (3.0 * sigma);
  const double half = normal_95 * std::sqrt(1.0 / (9.0 * count) + value * value / (2.0 * freedom));
  return Capability{value, value - half, value + half};
}

}  // namespace

std::vector<RunSignal> run_signals(std::span<const double> z) {
  std::vector<RunSignal> signals;
  for (std::size_t i = 0; i < z.size(); ++i) {
    for (std::size_t rule = 1; rule <= run_rules.size(); ++rule) {
      const std::size_t length = run_rules[rule - 1].stretch;
      if (i + 1 >= length && meets(rule, z.subspan(i + 1 - length, length))) signals.push_back({rule, i});
    }
  }
  return signals;
}

ParameterHistory parameter_history(const std::vector<StoredCalibration>& all, const std::string& key) {
  ParameterHistory found;
  auto& [history, of] = found;
  history.key = key;
  for (const StoredCalibration& c : all) {
    for (const StoredValue& value : c.values) {
      if (value.key != key) continue;
      history.unit = parameter_unit(key, c.gyro_increment);
      of.push_back(&c);
      history.units.push_back(c.unit);
      history.times.push_back(c.time_utc);
      history.values.push_back(value.value);
      history.sigmas.push_back(value.sigma);
      if (value.limit.min || value.limit.max) history.limit = value.limit;
    }
  }
  history.chart = control_chart(history.values, history.limit);
  return found;
}

constexpr std::size_t fewest_for_capability = 5;  // with fewer the interval is too wide to be useful

ControlChart control_chart(std::span<const double> values, const Limit& limit) {
  ControlChart chart;
  chart.count = values.size();
  if (values.empty()) return chart;
  const auto count = double(values.size());
  chart.mean = std::accumulate(values.begin(), values.end(), 0.0) / count;
  if (values.size() < 2) return chart;
  double ranges = 0.0, squares = 0.0;
  for (std::size_t i = 1; i < values.size(); ++i) ranges += std::abs(values[i] - values[i - 1]);
  for (const double value : values) squares += (value - chart.mean) * (value - chart.mean);
  constexpr double d2 = 1.128, efficiency = 0.62;  // of the moving range, against the variance
  constexpr double rounding = 1e-12;               // for values that are all equal
  const bool spread = ranges > rounding * count * std::abs(chart.mean);
  const double sigma = spread ? ranges / (count - 1.0) / d2 : 0.0;
  const double overall = spread ? std::sqrt(squares / (count - 1.0)) : 0.0;
  chart.sigma = sigma;
  chart.overall = overall;
  chart.lower = chart.mean - 3.0 * sigma;
  chart.upper = chart.mean + 3.0 * sigma;
  if (values.size() >= fewest_for_capability) {
    chart.cpk = capability(chart.mean, sigma, count, efficiency * (count - 1.0), limit);
    chart.ppk = capability(chart.mean, overall, count, count - 1.0, limit);
  }
  if (!(sigma > 0.0)) return chart;
  std::vector<double> z;
  for (const double value : values) z.push_back((value - chart.mean) / sigma);
  chart.signals = run_signals(z);
  for (const RunSignal& signal : chart.signals)
    if (signal.rule == 1) chart.outside.push_back(signal.point);
  return chart;
}

}  // namespace turncal
