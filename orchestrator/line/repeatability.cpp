#include "orchestrator/line/repeatability.h"

#include <cmath>
#include <map>

#include "imu_io/base/clock.h"
#include "orchestrator/line/parameter_history.h"

namespace turncal {

namespace {

// Wilson and Hilferty 1931.
double chi_square(double degrees, double z) {
  const double part = 2.0 / (9.0 * degrees), root = 1.0 - part + z * std::sqrt(part);
  return degrees * root * root * root;
}

}  // namespace

std::optional<double> Repeatability::of_unit() const {
  const double left = spread * spread - calibration_sigma * calibration_sigma;
  return left > 0.0 ? std::optional(std::sqrt(left)) : std::nullopt;
}

std::vector<Repeatability> repeatability(const std::vector<StoredCalibration>& all, double from_days, double to_days) {
  constexpr double day_s = 86400.0, normal_95 = 1.959964;
  std::vector<Repeatability> found;
  for (const std::string_view key : free_parameter_keys()) {
    const ParameterHistory history = parameter_history(all, key);
    Repeatability r{.key = std::string(key)};
    std::map<std::string, std::size_t> before;  // by unit and station
    double squares = 0.0, variances = 0.0;
    for (std::size_t i = 0; i < history.of.size(); ++i) {
      const StoredCalibration& c = *history.of[i];
      const auto [last, first] = before.try_emplace(c.unit + "\n" + c.station, i);
      if (first) continue;
      const StoredCalibration& former = *history.of[last->second];
      const std::optional<double> now_s = parse_utc(c.time_utc), then_s = parse_utc(former.time_utc);
      const double days = now_s && then_s ? (*now_s - *then_s) / day_s : -1.0;
      if (days >= from_days && days <= to_days) {
        const double d = history.values[i] - history.values[last->second];
        ++r.pairs;
        squares += d * d;
        const double a = history.sigmas[i].value_or(0.0), b = history.sigmas[last->second].value_or(0.0);
        variances += (a * a + b * b) / 2.0;
      }
      last->second = i;
    }
    if (r.pairs == 0) continue;
    const auto pairs = static_cast<double>(r.pairs);
    r.spread = std::sqrt(squares / pairs / 2.0);
    r.calibration_sigma = std::sqrt(variances / pairs);
    r.low = r.spread * std::sqrt(pairs / chi_square(pairs, normal_95));
    const double lower = chi_square(pairs, -normal_95);
    r.high = lower > 0.0 ? r.spread * std::sqrt(pairs / lower) : HUGE_VAL;
    found.push_back(r);
  }
  return found;
}

}  // namespace turncal
