// What would stop a run later, looked for before anything moves: `run` refuses to begin, and `check` tells all of it.
//
// Output folder, results database and parameter store can be written; there is room for the recordings; names are short enough for
// the file system; the commands of the hooks exist and the shell can read them; the table's own file believes the positions of the plan; the table's calibration is not overdue. What is made for a try is removed again.
#pragma once

#include <string>
#include <vector>

#include "calib/types/status.h"
#include "orchestrator/station/station_config.h"
#include "sequences/plan.h"

namespace turncal {

struct Preflight {
  const StationConfig& station;
  const Plan& plan;
  std::string folder = {};              // of the run; empty: not looked at
  std::vector<std::string> units = {};  // serial numbers
  double utc_s = 0.0;                   // now
  bool simulated = false;
  std::string overdue_reason = {};  // why a table whose calibration is overdue is used all the same
};

// Kind device for what the storage cannot do, input for what has to be written otherwise.
std::vector<Error> preflight(const Preflight& run);

// A table whose calibration is overdue is used only with a reason, which goes on record.
// utc_s: now. An error of kind input after the day of table.calibration_due, unless there is a reason.
Status check_due(const StationConfig& station, double utc_s, const std::string& overdue_reason);

}  // namespace turncal
