// The queue of a batch: two text files that survive whatever happens.
//
//   QUEUE         one serial number a line, `#` begins a comment: the operator's, changed by `turncal queue` or any editor
//   QUEUE.state   what became of units: "pass 2026-01-31T12:00:00Z SN1" a line, a reason after `#`; the batch's, replaced whole after each unit
//
// The batch reads QUEUE again before every unit, so units may be added and removed while it runs. A unit with a line in the
// state file is not done again until `turncal queue --again`.
#pragma once

#include <string>
#include <vector>

#include "calib/types/status.h"
#include "imu_io/base/files.h"
#include "orchestrator/station/fields.h"

namespace turncal {

struct UnitOutcome {
  std::string unit;
  std::string outcome;  // outcome_of (orchestrator/jobs/run.h), skipped; again: to be done once more
  std::string time_utc;
  std::string reason = {};  // why it did not pass
};

Fields fields_of(UnitOutcome& outcome);

bool holds(const std::vector<std::string>& list, const std::string& unit);

Result<std::vector<std::string>> read_queue(const std::string& path);
Result<std::vector<UnitOutcome>> read_outcomes(const std::string& path);  // of QUEUE.state; none when it is not there
const UnitOutcome* find_outcome(const std::vector<UnitOutcome>& outcomes, const std::string& unit);  // null: none yet
// What an outcome comes to; not_passed: somebody should look at the unit.
enum class Standing { waits, passed, unjudged, not_passed };
Standing standing_of(const UnitOutcome* outcome);
// The first units of the queue, `most` at most, that have no outcome yet or are to be done again.
std::vector<std::string> next_units(const std::vector<std::string>& queue, const std::vector<UnitOutcome>& outcomes,
                                    std::size_t most);

// Held by a batch for as long as it works on the queue: a second one is refused. Changes are not.
Result<LockFile> hold_queue(const std::string& path);
// Holds the serial number that a batch waits for while it is mounted, for whoever looks on; means nothing when nobody holds the queue.
std::string mounting_file(const std::string& path);

// Durable on success. Two changes at a time exclude each other by a lock on QUEUE.lock.
Status record_outcome(const std::string& path, const UnitOutcome& outcome);
struct QueueChange {
  std::vector<std::string> add, remove, again;
};
// Adding what is there, or removing what is not, is an error: nothing is changed then. Comments and order stay.
Status change_queue(const std::string& path, const QueueChange& change);

}  // namespace turncal
