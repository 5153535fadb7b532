// The Allan analysis of a unit at rest, from a recording to the report (docs/allan.md).
//
// Reads a recording without segments as a whole, or the rests of a recording with segments. Samples that are marked as bad, stand out from
// their neighbours (data_screen.h) or are physically impossible are left out and counted. Errors: less than 10 s at rest; a unit that moves
// (the mean of a second differs from the first one's by 0.02 rad/s or 0.5 m/s^2); a channel that senses nothing.
#pragma once

#include <string>

#include "calib/types/status.h"
#include "imu_io/recordings/recording_source.h"
#include "orchestrator/report/allan_report.h"

namespace turncal {

struct AllanRequest {
  std::string source;   // a recording or, with a map, any table of numbers
  std::string map;      // file (csv_map_import.h); empty: none
  std::string against;  // another source, or a parameter file (.conf), shown beside it; empty: nothing
};
Result<AllanReport> allan_report(const AllanRequest& request);
Result<AllanReport> allan_report(RecordingSource& source, const std::string& name);

}  // namespace turncal
