#include "orchestrator/station/needed_sigma.h"

#include <algorithm>
#include <limits>

#include "imu_io/base/key_table.h"

namespace turncal {

namespace {

constexpr double infinite = std::numeric_limits<double>::infinity();

// The sigma at which the guard band ends at the nearer limit.
double clear_of(const Limit& limit, double guard_factor, double value) {
  if (!limit.min && !limit.max) return infinite;
  const double margin = std::min(limit.min ? value - *limit.min : infinite, limit.max ? *limit.max - value : infinite);
  if (margin < 0.0) return 0.0;
  return guard_factor > 0.0 ? margin / (2.0 * guard_factor) : infinite;
}

}  // namespace

StopSigmas read_stop_sigmas(KeyValueFile& file) {
  StopSigmas stop{};
  KeyTable keys(file);
  for (std::size_t i = 0; i < parameter_count; ++i)
    if (parameter_is_free[i]) keys.number("stop.sigma." + std::string(parameter_keys[i]), stop[i], limit_range);
  return stop;
}

bool says_when(const StopSigmas& stop, const VerdictLimits& limits) {
  for (std::size_t i = 0; i < parameter_count; ++i)
    if (stop[i] || limits.sigma_max[i] || limits.parameter[i].min || limits.parameter[i].max) return true;
  return false;
}

double NeededSigma::ratio() const { return needed > 0.0 ? sigma / needed : infinite; }

std::vector<NeededSigma> needed_sigmas(const ParameterFile& file, const StopSigmas& stop, const VerdictLimits& limits) {
  std::vector<NeededSigma> sigmas;
  for (std::size_t i = 0; i < parameter_count; ++i) {
    if (!parameter_is_free[i]) continue;
    const double value = file.parameters(static_cast<Eigen::Index>(i));
    const double needed = std::min({stop[i].value_or(infinite), limits.sigma_max[i].value_or(infinite),
                                    clear_of(limits.parameter[i], limits.guard_factor, value)});
    if (needed < infinite) sigmas.push_back({i, file.sigma[i].value_or(infinite), needed});
  }
  return sigmas;
}

}  // namespace turncal
