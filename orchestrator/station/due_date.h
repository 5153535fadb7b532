// A table whose calibration is overdue is used only with a reason, which goes on record.
#pragma once

#include <string>

#include "calib/types/status.h"
#include "orchestrator/station/station_config.h"

namespace turncal {

// utc_s: now. An error of kind input after the day of table.calibration_due, unless there is a reason.
Status check_due(const StationConfig& station, double utc_s, const std::string& overdue_reason);

}  // namespace turncal
