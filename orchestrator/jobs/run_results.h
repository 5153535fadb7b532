// From the sealed recording of a unit to what a run leaves behind: estimated, judged, and published in the order in which it becomes durable:
//
//   truth.conf (dry run) -> verification.conf -> diagnosis/ -> parameters.conf -> statistics.tcs -> journal `results` -> database
//   -> parameter store -> journal `verdict`
//
// Only then is a verdict printed. What cannot be written is a fault of the storage (kind device), whatever the reason. Every step can be done
// again: a run that was interrupted in between repeats them all with the same bytes.
#pragma once

#include <memory>
#include <ostream>
#include <string>

#include "orchestrator/jobs/command_context.h"
#include "orchestrator/jobs/run.h"
#include "orchestrator/run/background_queue.h"

namespace turncal {

inline constexpr const char* truth_name = "truth.conf";
inline constexpr const char* verification_name = "verification.conf";
inline constexpr const char* diagnosis_folder = "diagnosis";

// A recording of less says too little about what the 24 parameters lack: no diagnosis at the end of the run.
inline constexpr double least_diagnosed_s = 1800.0;

// Of every unit that is left. utc_s: when the recordings were sealed. A unit that cannot be calibrated leaves the others running: an error
// when there is none that can be, or of the storage.
Status make_results(Run& run, double utc_s, CommandContext& context);
// Prints the results and sets the status of every unit that is left and was calibrated.
void print_results(Run& run, double wall_s, std::ostream& out);

// A disk that hangs for good would hold up whoever waits for it: the table was left, so the program says so and ends at once. `then`: the
// command for when it answers again.
[[noreturn]] void end_without_storage(const std::string& why, const std::string& path, const std::string& then,
                                      CommandContext& context);
// Of what is written while no table moves: the same, where the disk hangs before this goes.
std::unique_ptr<StorageLimit> limit_storage(const std::string& path, const std::string& then, CommandContext& context);

// A failure to keep something is never the unit's, nor a mistake of the operator's: of kind device.
Status stored(Status status);
// Why the verdict is what it is; empty: a plain pass.
std::string reason_of(const RunPlan& run, const VerdictReport& verdict);
// An error of kind unit_failed, with verdict and reason, when the verdict is not one to accept.
Status verdict_status(const std::string& unit, const VerdictReport& report);

}  // namespace turncal
