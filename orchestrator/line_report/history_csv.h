// Rows of a results database as CSV (RFC 4180). A text that a spreadsheet would take for a formula gets an apostrophe in front.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "orchestrator/records/results_database.h"

namespace turncal {

std::string calibrations_csv(const std::vector<StoredCalibration>& all);  // with their 24 values and sigmas
std::string attempts_csv(const std::vector<AttemptRecord>& all);
// Of text and number cells alike.
std::string csv_row(const std::vector<std::string>& cells);

}  // namespace turncal
