// From legs, recordings of one unit at several temperatures or what was calibrated from them, to parameters as functions of temperature.
//
// A leg is a recording, a parameter file, or the folder of a run or a calibration, whose parameter file is taken as it is where it holds the
// covariance of its parameters. What is known of its temperature, the first that there is:
//   LEG=VALUE of the request; leg.conf in its folder, keys temperature_c, rate_c_per_h, direction = up | down | unknown, switch_on; the
//   thermometer of its recording (mean, slope of a straight line); reference_temperature_c of its parameter file
// Without a direction: from the temperature of the leg before, in the order of measured time, or else of the request. Without switch_on
// each leg has its own.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "calib/types/status.h"
#include "imu_io/recordings/parameter_file.h"
#include "orchestrator/report/thermal_report.h"

namespace turncal {

struct ThermalRequest {
  std::vector<std::string> legs;
  std::vector<std::string> temperatures;  // LEG=VALUE
  std::optional<double> reference_c;
  std::string time_utc;
  std::function<void(const std::string&)> phase = [](const std::string&) {};
};

struct ThermalOutput {
  ThermalReport report;
  ParameterFile file;
};

Result<ThermalOutput> thermal_calibration(const ThermalRequest& request);

}  // namespace turncal
