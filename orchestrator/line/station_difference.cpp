#include "orchestrator/line/station_difference.h"

#include <map>
#include <numeric>
#include <set>

#include "imu_io/base/clock.h"
#include "orchestrator/line/parameter_history.h"

namespace turncal {

namespace {

struct Moments {
  double mean = 0.0, variance_of_mean = 0.0;
};

Moments moments(const std::vector<double>& values) {
  const auto n = static_cast<double>(values.size());
  const double mean = std::accumulate(values.begin(), values.end(), 0.0) / n;
  double squares = 0.0;
  for (const double value : values) squares += (value - mean) * (value - mean);
  return {mean, squares / (n - 1.0) / n};
}

struct AtStation {
  std::map<std::string, std::vector<double>> by_unit;
  std::vector<double> days, values;
};

std::vector<double> unit_means(const AtStation& at) {
  std::vector<double> means;
  for (const auto& [unit, values] : at.by_unit)
    means.push_back(std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size()));
  return means;
}

// Slope a day and its variance.
std::optional<std::pair<double, double>> slope(const AtStation& at) {
  const std::size_t n = at.days.size();
  if (n < least_units) return std::nullopt;
  const Moments t = moments(at.days), y = moments(at.values);
  double tt = 0.0, ty = 0.0, residual_square = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    tt += (at.days[i] - t.mean) * (at.days[i] - t.mean);
    ty += (at.days[i] - t.mean) * (at.values[i] - y.mean);
  }
  if (std::sqrt(tt / static_cast<double>(n)) < 1.0) return std::nullopt;
  const double k = ty / tt;
  for (std::size_t i = 0; i < n; ++i) {
    const double r = at.values[i] - y.mean - k * (at.days[i] - t.mean);
    residual_square += r * r;
  }
  return std::pair(k, residual_square / static_cast<double>(n - 2) / tt);
}

std::optional<StationDifference> compare(const AtStation& a, const AtStation& b) {
  StationDifference d;
  std::vector<double> differences;
  for (const auto& [unit, values] : a.by_unit) {
    const auto other = b.by_unit.find(unit);
    if (other == b.by_unit.end()) continue;
    differences.push_back(moments(other->second).mean - moments(values).mean);
  }
  if (differences.size() >= least_units) {
    const Moments m = moments(differences);
    d.of_the_same_units = true;
    d.count_a = d.count_b = differences.size();
    d.difference = m.mean;
    d.sigma = std::sqrt(m.variance_of_mean);
  } else {
    const std::vector<double> of_a = unit_means(a), of_b = unit_means(b);
    d.count_a = of_a.size();
    d.count_b = of_b.size();
    if (d.count_a < least_units || d.count_b < least_units) return std::nullopt;
    const Moments at_a = moments(of_a), at_b = moments(of_b);
    d.difference = at_b.mean - at_a.mean;
    d.sigma = std::sqrt(at_a.variance_of_mean + at_b.variance_of_mean);
  }
  const auto slope_a = slope(a), slope_b = slope(b);
  constexpr double month_days = 30.0;
  if (slope_a && slope_b) {
    d.drift = month_days * (slope_b->first - slope_a->first);
    d.drift_sigma = month_days * std::sqrt(slope_a->second + slope_b->second);
  }
  return d;
}

}  // namespace

std::vector<StationDifference> station_differences(const std::vector<StoredCalibration>& all) {
  constexpr double day_s = 86400.0;
  std::vector<StationDifference> found;
  for (const std::string_view key : free_parameter_keys()) {
    const ParameterHistory history = parameter_history(all, key);
    std::map<std::string, AtStation> stations;
    for (std::size_t i = 0; i < history.of.size(); ++i) {
      AtStation& at = stations[history.of[i]->station];
      at.by_unit[history.of[i]->unit].push_back(history.values[i]);
      at.days.push_back(parse_utc(history.of[i]->time_utc).value_or(0.0) / day_s);
      at.values.push_back(history.values[i]);
    }
    for (auto a = stations.begin(); a != stations.end(); ++a) {
      for (auto b = std::next(a); b != stations.end(); ++b) {
        std::optional<StationDifference> d = compare(a->second, b->second);
        if (!d) continue;
        d->a = a->first;
        d->b = b->first;
        d->key = key;
        found.push_back(std::move(*d));
      }
    }
  }
  return found;
}

}  // namespace turncal
