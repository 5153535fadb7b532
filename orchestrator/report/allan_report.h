// The Allan deviation of a unit at rest for people: table, figure, page, JSON, and the forms that ROS users put into their files.
//
// docs/allan.md shows the document of `turncal allan`. The units of the coefficients are defined here alone; other documents use allan_cell.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "calib/model/parameters.h"
#include "calib/statistics/allan.h"
#include "orchestrator/report/document.h"

namespace turncal {

struct AllanUnit {
  const char* name;  // in keys: angle_random_walk
  const char* unit;  // in keys: deg_per_rt_h
  const char* shown;
  double si;
};
const AllanUnit& allan_unit(bool gyro, std::size_t term);

// Returns "0.300 ± 0.001", or "< 0.0092" for a coefficient that is not seen; "-" without a fit.
Cell allan_cell(const AllanFit& fit, bool gyro, std::size_t term);

struct AllanReport {
  std::string source;   // what was analysed
  std::string against;  // for comparison; empty: nothing
  AllanResult result = {};
  double sample_s = 0.0;
  std::size_t rests = 0;
  Eigen::Vector3d mean_force_mps2 = Eigen::Vector3d::Zero();
  std::vector<std::string> notes = {};
  std::optional<AllanResult> other = {};
  std::optional<NoiseModel> file = {};  // from a parameter file
};
Document allan_document(const AllanReport& report);
// Returns a CSV with axis, tau_s, deviation, low, high, degrees, model; SI.
std::string format_allan_points(const AllanResult& result);
// Returns a file for Kalibr: one value for the three axes of a triad, their root mean square.
std::string format_imu_yaml(const AllanResult& result, double sample_s);

}  // namespace turncal
