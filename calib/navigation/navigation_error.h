// What a free navigation is off by, in the numbers that navigators use.
//
// Radial error rate of one run: the slope of the straight line through the origin that fits the radial position error d(t) best,
//   r = sum d t / sum t^2   (nautical miles per hour).
// Over runs (branches): the root mean square of the rates, and what holds half and 95 % of them when north and east errors are
// normal and alike: CEP = sqrt(ln 2) rms = 0.8326 rms, R95 = sqrt(ln 20) rms = 1.7308 rms (STANAG 4278). From a few runs
// these are better than counted quantiles; with one axis much worse than the other the true CEP is up to 19 % lower.
#pragma once

#include <span>

#include <Eigen/Core>

namespace turncal {

class RadialErrorRate {
 public:
  void add(double time_s, double radial_m) {
    dt_ += radial_m * time_s;
    tt_ += time_s * time_s;
  }
  double nm_per_h() const;  // 0 before anything was added

 private:
  double dt_ = 0.0, tt_ = 0.0;
};

struct DriftOverRuns {
  double rms_nm_per_h = 0.0;
  double cep_nm_per_h = 0.0;
  double r95_nm_per_h = 0.0;
};
DriftOverRuns drift_over_runs(std::span<const double> rates_nm_per_h);

}  // namespace turncal
