// The Allan deviation of a unit at rest as people read it: table, figure, page, JSON, and what users of ROS put into their files.
//
// The document of `turncal allan` is docs/allan.md's. The units of a coefficient are here alone; whoever prints one asks for its cell.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "calib/model/parameters.h"
#include "calib/statistics/allan.h"
#include "orchestrator/report/document.h"

namespace turncal {

struct AllanUnit {
  const char* name;  // of a key: angle_random_walk
  const char* unit;  // of a key: deg_per_rt_h
  const char* shown;
  double si;
};
const AllanUnit& allan_unit(bool gyro, std::size_t term);

// "0.300 ± 0.001", or "< 0.0092" where it is not seen; "-" where nothing was fitted.
Cell allan_cell(const AllanFit& fit, bool gyro, std::size_t term);

struct AllanReport {
  std::string source;   // what was read
  std::string against;  // and beside it; empty: nothing
  AllanResult result = {};
  double sample_s = 0.0;
  std::size_t rests = 0;
  Eigen::Vector3d mean_force_mps2 = Eigen::Vector3d::Zero();
  std::vector<std::string> notes = {};
  std::optional<AllanResult> other = {};
  std::optional<NoiseModel> file = {};  // of a parameter file
};
Document allan_document(const AllanReport& report);
// axis, tau_s, deviation, low, high, degrees, model; SI.
std::string format_allan_points(const AllanResult& result);
// For Kalibr: one value for the three axes of a triad, their root mean square.
std::string format_imu_yaml(const AllanResult& result, double sample_s);

}  // namespace turncal
