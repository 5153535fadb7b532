// One parameter over the calibrations of a results database, in the order of time, with its control chart.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "orchestrator/line/control_chart.h"
#include "orchestrator/records/results_database.h"

namespace turncal {

struct ChartedQuantity {
  std::string key;
  std::vector<std::string> units, times;  // of whom and when
  std::vector<double> values;
  std::vector<std::optional<double>> sigmas;
  Limit limit;  // of the newest calibration that was judged by one
  ControlChart chart;
};

struct ParameterHistory : ChartedQuantity {
  std::vector<const StoredCalibration*> of;  // those that have the parameter; point into the list given
};

ParameterHistory parameter_history(const std::vector<StoredCalibration>& all, std::string_view key);

// Parameters that are estimated; the others are zero by the choice of the body frame.
std::vector<std::string_view> free_parameter_keys();

}  // namespace turncal
