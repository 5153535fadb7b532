// What is in a results database: its control charts as a document, its rows as tables for other programs.
#pragma once

#include <string>
#include <vector>

#include "imu_io/base/data_text.h"
#include "orchestrator/records/results_database.h"
#include "orchestrator/report/document.h"

namespace turncal {

// Every parameter over the calibrations. `all`: oldest first, either real or simulated. `source`: where they come from, in words.
Document history_document(const std::vector<StoredCalibration>& all, const std::string& source);

DataTable calibrations_table(const std::vector<StoredCalibration>& all);  // with their 24 values and sigmas
DataTable attempts_table(const std::vector<AttemptRecord>& all);

}  // namespace turncal
