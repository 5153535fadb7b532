// Rows of a results database as tables for other programs (CSV, JSON).
#pragma once

#include <vector>

#include "imu_io/base/data_text.h"
#include "orchestrator/records/results_database.h"

namespace turncal {

DataTable calibrations_table(const std::vector<StoredCalibration>& all);  // with their 24 values and sigmas
DataTable attempts_table(const std::vector<AttemptRecord>& all);

}  // namespace turncal
