// The noise of a unit at rest: from what was recorded to what is said of it (docs/allan.md).
//
// Read are a recording without segments, whole, or the rests of one that has them; samples that are marked as bad, that stand
// out from their neighbours (data_screen.h) or that no unit can have felt are left out and counted. Errors: less than 10 s at rest, a unit that moves (0.02 rad/s, 0.5 m/s^2 between the means of two seconds), a channel
// that feels nothing.
#pragma once

#include <string>

#include "calib/types/status.h"
#include "imu_io/recordings/recording_source.h"
#include "orchestrator/report/allan_report.h"

namespace turncal {

struct AllanRequest {
  std::string source;   // a recording; with a map any table of numbers
  std::string map;      // file (csv_map_import.h); empty: none
  std::string against;  // another source, or a parameter file (.conf), shown beside it; empty: nothing
};
Result<AllanReport> allan_report(const AllanRequest& request);
Result<AllanReport> allan_report(RecordingSource& source, const std::string& name);

}  // namespace turncal
