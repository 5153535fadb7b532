// What an operator may do to a station by the page. Each is written down, with the name, before it is done: a line of
// QUEUE.actions, on disk: "2026-01-31T12:00:00Z NAME pause SN1"; what then fails has a second line, "NAME not done: remove SN1".
//
//   add, remove, again   of the queue (orchestrator/records/unit_queue.h)
//   mounted              the unit is on the table, and everybody is away from it: what hook.mount waits for is written, with the
//                        serial number in it. Only while that unit is waited for
//   pause                the run's first Ctrl-C: it stops at the end of the move or dwell, and can be resumed; once
//   stop                 the run stops now, verified, and can be resumed
//
// The last two go to the process that holds the run's lock at that moment, which the system names; no run, no signal.
#pragma once

#include <string>

#include "calib/types/status.h"
#include "orchestrator/service/service_config.h"

namespace turncal {

struct StationAction {
  std::string action, unit;
};

// What was done, in a sentence.
Result<std::string> act(const ServedStation& station, const StationAction& wanted, const std::string& operator_name,
                        double now_utc_s);

}  // namespace turncal
