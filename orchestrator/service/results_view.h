// What the stations of a results database did in the last 24 hours: all that write to it, those on other machines too.
//
// An attempt counts when it says something of its unit (orchestrator/line/line_yield.h); others are in `attempts` alone. Simulated attempts are counted
// apart. A database that cannot be read is said, and is nobody's fault but its own: whoever asks goes on.
#pragma once

#include <string>
#include <vector>

#include "orchestrator/records/attempt_record.h"

namespace turncal {

struct StationResults {
  std::string station;
  bool simulated = false;
  std::size_t attempts = 0, judged = 0, passed = 0;
  std::string last_unit, last_outcome, last_time_utc;
};

struct ResultsView {
  std::string defect;  // why there are none
  std::vector<StationResults> stations;
};

// attempts: of any order. By station, in the order of their names.
std::vector<StationResults> results_by_station(const std::vector<AttemptRecord>& attempts);

// database: as results_database.h has it. Waits a few seconds for it at the most.
ResultsView look_at_results(const std::string& database, double now_utc_s);

std::string json_of(const ResultsView& view);

}  // namespace turncal
