// Documents of what is in a results database: the report of a shift, control charts, all there is of a unit.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "imu_io/base/data_text.h"
#include "orchestrator/line/parameter_history.h"
#include "orchestrator/line/shift_report.h"
#include "orchestrator/records/results_database.h"
#include "orchestrator/report/document.h"

namespace turncal {

Document shift_document(const ShiftReport& report);
std::string shift_csv(const ShiftReport& report);  // table,item,quantity,value: what stands in the document's tables
std::string signals_csv(const ShiftReport& report);

// Mean, limits and capability, a row each; none of a quantity without values.
void add_control_table(const std::vector<ChartedQuantity>& quantities, Document& document);
// That table, and charts in groups of one unit, three to a row: every point with its sigma, the control limits, the limits in force, and
// what the run rules say. A quantity in no group has no chart.
void add_control_charts(const std::vector<ChartedQuantity>& quantities, Document& document);

// Every parameter over the calibrations. `all`: oldest first, either real or simulated. `source`: where they come from, in words.
Document history_document(const std::vector<StoredCalibration>& all, const std::string& source);

// Everything of a serial number.
struct UnitRecord {
  std::string unit;
  std::vector<AttemptRecord> attempts;          // oldest first
  std::vector<StoredCalibration> calibrations;  // oldest first, with all values
  // Where a file of a run is served; empty: nowhere.
  std::function<std::string(const std::string& folder, const std::string& file)> link;
};
// Its runs, its parameters now and over time, its certificates. Real and simulated ones are not mixed: those of the newest count.
Document unit_document(const UnitRecord& record);

}  // namespace turncal
