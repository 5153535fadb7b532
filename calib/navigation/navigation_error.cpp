#include "calib/navigation/navigation_error.h"

#include <cmath>

#include "calib/navigation/earth.h"

namespace turncal {

double RadialErrorRate::nm_per_h() const { return tt_ > 0.0 ? dt_ / tt_ * 3600.0 / metres_per_nautical_mile : 0.0; }

DriftOverRuns drift_over_runs(std::span<const double> rates_nm_per_h) {
  if (rates_nm_per_h.empty()) return {};
  double squares = 0.0;
  for (const double rate : rates_nm_per_h) squares += rate * rate;
  const double rms = std::sqrt(squares / static_cast<double>(rates_nm_per_h.size()));
  return {rms, std::sqrt(std::log(2.0)) * rms, std::sqrt(std::log(20.0)) * rms};
}

}  // namespace turncal
