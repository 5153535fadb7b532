#include "orchestrator/station/due_date.h"

#include "imu_io/base/clock.h"

namespace turncal {

Status check_due(const StationConfig& station, double utc_s, const std::string& overdue_reason) {
  const std::string& due = station.table_calibration_due;
  const std::string today = format_utc(utc_s).substr(0, 10);
  if (due.empty() || today <= due) return {};  // days as 2026-12-31 sort as they follow each other
  if (!overdue_reason.empty()) return {};
  return input_error("the calibration of table '" + station.table_id + "' was due on " + due + ", today is " + today +
                     ": expected a calibrated table, or --override-due REASON, which goes on record");
}

}  // namespace turncal
