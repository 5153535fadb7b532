// How well a unit has to be known before its run may end: `turncal run --until-sigma`.
//
// A parameter is known well enough when its standard deviation is not above the least of
//   stop.sigma.<key>        of the station file
//   limit.<key>.sigma_max   the same
//   m / (2 guard_factor)    m: distance of the value from the nearer of limit.<key>.min, .max; there the guard band ends (verdict.h)
// Units of the parameter file. Parameters that none of them names are free to be anything.
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "imu_io/base/key_value.h"
#include "imu_io/recordings/parameter_file.h"
#include "orchestrator/station/verdict.h"

namespace turncal {

using StopSigmas = std::array<std::optional<double>, parameter_count>;

// Keys stop.sigma.<key>, above zero.
StopSigmas read_stop_sigmas(KeyValueFile& file);

// Whether anything says when it is enough.
bool says_when(const StopSigmas& stop, const VerdictLimits& limits);

struct NeededSigma {
  std::size_t parameter = 0;  // parameter_keys[parameter]
  double sigma = 0.0;         // as estimated
  double needed = 0.0;        // 0: no sigma is small enough, its value lies beyond a limit
  double ratio() const;       // sigma / needed; infinite where nothing is enough
};

// Of an estimate with a sigma for every free parameter.
std::vector<NeededSigma> needed_sigmas(const ParameterFile& file, const StopSigmas& stop, const VerdictLimits& limits);

}  // namespace turncal
