// The queue of a batch: two text files that survive any crash.
//
//   QUEUE         one serial number a line, `#` begins a comment: the operator's, changed by `turncal queue` or any editor
//   QUEUE.state   outcome of each unit: "pass 2026-01-31T12:00:00Z SN1" a line, a reason after `#`; the batch's, replaced whole after each unit
//
// The batch reads QUEUE again before every unit, so units may be added and removed while it runs. A unit with a line in the
// state file is not measured again until `turncal queue --again`.
#pragma once

#include <string>
#include <vector>

#include "calib/types/status.h"
#include "imu_io/base/files.h"
#include "orchestrator/station/fields.h"

namespace turncal {

struct UnitOutcome {
  std::string unit;
  std::string outcome;  // outcome_of (orchestrator/jobs/run.h), or skipped; again: to be repeated
  std::string time_utc;
  std::string reason = {};  // why it did not pass
};

Fields fields_of(UnitOutcome& outcome);

bool holds(const std::vector<std::string>& list, const std::string& unit);

Result<std::vector<std::string>> read_queue(const std::string& path);
Result<std::vector<UnitOutcome>> read_outcomes(const std::string& path);  // from QUEUE.state; none when it is missing
const UnitOutcome* find_outcome(const std::vector<UnitOutcome>& outcomes, const std::string& unit);  // null: none yet
// What an outcome means; not_passed: somebody should look at the unit.
enum class Standing { waits, passed, unjudged, not_passed };
Standing standing_of(const UnitOutcome* outcome);
// Returns the first units of the queue, at most `most`, that have no outcome yet or are to be repeated.
std::vector<std::string> next_units(const std::vector<std::string>& queue, const std::vector<UnitOutcome>& outcomes,
                                    std::size_t most);

// Locks the queue while a batch works on it: a second batch is refused, changes are not.
Result<LockFile> hold_queue(const std::string& path);
// Returns the file with the serial number that a batch is waiting to have mounted, for displays; it is stale when nobody holds the queue.
std::string mounting_file(const std::string& path);

// Records an outcome, durable on success. A lock on QUEUE.lock excludes concurrent changes.
Status record_outcome(const std::string& path, const UnitOutcome& outcome);
struct QueueChange {
  std::vector<std::string> add, remove, again;
};
// Changes the queue. Adding a unit that is there, or removing one that is not, is an error and changes nothing. Comments and order stay.
Status change_queue(const std::string& path, const QueueChange& change);

}  // namespace turncal
