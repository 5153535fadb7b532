// One run and everything made from it. begin_run() walks through these steps:
//
//   plan                       station, sequence and rig read, checked and hashed        run_request.h
//   record                     the table moved, every unit recorded                      record_run.cpp
//   estimate, judge, publish   each unit, from its recording to its verdict              run_results.cpp
//
// A run of one unit has everything in its own folder; a run of several has it in FOLDER/SERIAL (name_of_unit) each, with journal.tcj and
// run.log in FOLDER.
#pragma once

#include <memory>
#include <optional>
#include <ostream>
#include <string>
#include <string_view>
#include <vector>

#include "orchestrator/jobs/calibration_job.h"
#include "orchestrator/jobs/command_context.h"
#include "orchestrator/jobs/run_request.h"
#include "orchestrator/records/journal.h"
#include "orchestrator/records/results_database.h"
#include "orchestrator/report/verification_report.h"
#include "orchestrator/run/background_queue.h"
#include "orchestrator/watch/progress.h"

namespace turncal {

inline constexpr const char* log_name = "run.log";
inline constexpr const char* removed_by_prune = " is removed by turncal records prune";  // in the log
// Prefix of every line that a dry run prints or logs, so that none passes for a real one.
inline constexpr std::string_view dry_run_tag = "[dry run] ";
inline constexpr std::string_view simulated_tag = "[simulated] ";  // likewise for a live run with a twin
std::string_view tag_of(const RunPlan& run);
std::string_view tag_of(const JournalContents& journal);

// A unit's part of a run.
struct RunUnit {
  std::string serial, folder;
  RigConfig rig;  // in a dry run
  bool dropped = false;
  Status status{};  // how it ended

  double recorded_s = 0.0;
  int repeated_dwells = 0;
  std::uint64_t lost_samples = 0;
  std::optional<UnitClock> clock{};  // empty: not measured, as in a dry run
  double ended_utc_s = 0.0;          // 0: it did not begin

  std::optional<LoadedRecording> recording{};        // as sealed, or to be sealed
  std::optional<CalibrationOutput> output{};         // empty: only captured
  std::optional<DiagnosisOutput> diagnosis{};        // empty: not made
  std::optional<VerificationReport> verification{};  // empty: not asked for
  VerdictReport verdict{};

  std::string file(const std::string& name) const { return folder + "/" + name; }
  void drop(const Error& why) {
    dropped = true;
    status = Error{why.kind, dropout_words(serial, why)};
  }
};

struct Run : RunPlan {
  std::string folder;
  std::vector<RunUnit> units;
  int sessions = 1;                   // times it was begun or resumed
  std::optional<ResumePoint> resume;  // where this session resumes; empty: at the beginning
  std::optional<JournalFile> journal;
  std::optional<RunLog> log;  // open in a session with devices
  void say(const std::string& line) {
    if (log) log->line(line);
  }
};

// Returns a run without journal and log. folder: empty when there is none yet.
Run run_of(RunPlan plan, const std::string& folder);

// Returns the outcome of a unit in one word: its verdict; captured, dropped, fail (measured, but no parameters were estimated), refused
// (nothing was measured). Empty: no outcome yet, because a fault of the station stopped it.
std::string outcome_of(const Run& run, const RunUnit& unit);
// Returns the status of the whole run: success, or the worst kind of error and a line that names every unit with an error.
Status status_of(const Run& run);
// Returns what goes on record about a unit, without empty values: keys record.* of its parameter file, columns of its attempt. Nothing here
// may depend on how often the run was interrupted: the file is the same as for an uninterrupted one.
KeyTexts facts_of(const Run& run, const RunUnit& unit);
// Returns a row of the database; the caller adds the outcome and its time.
AttemptRecord attempt_record(const Run& run, const RunUnit& unit);

// Checks that recordings and journal hold what a run needs to go on after its last dwell. Changes nothing.
Status check_goes_on(const Run& run, const JournalContents& contents);
// Reads every recording once, before it is sealed, and returns the content hashes for the journal, by unit. An error when one is damaged.
Result<std::vector<std::string>> read_recordings(Run& run);

// Reads the recording of the run in `folder` and those of the runs that it continues, oldest first. An error when one is not as it was sealed.
Result<std::vector<LoadedRecording>> recordings_up_to(const std::string& folder);

// A run that failed before it moved the table leaves nothing; one that was interrupted, or failed later, leaves log and journal and can be resumed.
struct RunEnd {
  Status status;  // of the whole run; the command returns it
  struct Unit {
    std::string serial, folder;
    std::string outcome;  // outcome_of
    Status status;
    std::string reason;  // of the outcome; empty: a plain pass
  };
  std::vector<Unit> units;  // empty: refused before anything was made
  bool moved = false;       // the table was homed or sent somewhere, so there is something to report
  bool to_the_end = false;  // table and run are in order, whatever the outcome of single units

  RunEnd(Status how, bool whole = false) : status(std::move(how)), to_the_end(whole) {}
  RunEnd(Error why) : status(std::move(why)) {}
};

// Returns whether every unit still in the run has its verdict, so that there is nothing to resume.
bool is_over(const JournalContents& journal);

// Returns all that the station cannot do of the sequence, and why it does not serve its purpose; `otherwise`: what can be done instead.
std::vector<Error> sequence_refusals(const RunPlan& run, const std::string& otherwise);
inline constexpr const char* in_part = ", --partial to estimate what can be of the others, or --capture-only";
// Returns the first of them. Part of begin_run; a batch calls it before its first unit.
Status check_sequence(const RunPlan& run, const std::string& otherwise = "");

RunEnd begin_run(const RunRequest& request, const std::string& folder, CommandContext& context);

// Resumes a run. `now`: where the files that the journal names are now (station, sequence, rig; empty: where they were), and the session.
// The devices must be of the same kind (simulated or not); the units and every hash must be those of the journal.
RunEnd resume_run(const std::string& folder, const RunRequest& now, CommandContext& context);

struct RunDevices;  // dry_run_devices.h
Result<RunDevices> make_devices(const RunPlan& run, CommandContext& context);

// Runs a session, up to the verdicts. REQUIRES journal and log of the run. Sets the facts and the status of its units.
RunEnd record_run(Run& run, RunDevices& devices, CommandContext& context);

// Estimates, judges and publishes a unit from its sealed recording. The results become durable in this order:
//
//   truth.conf (dry run) -> verification.conf -> diagnosis/ -> parameters.conf -> statistics.tcs -> journal `results` -> database
//   -> parameter store -> journal `verdict`
//
// Only then is a verdict printed. What cannot be written is a fault of the storage (kind device), for whatever reason. Every step can be
// repeated: a run that was interrupted in between repeats them all, with the same bytes.
inline constexpr const char* truth_name = "truth.conf";
inline constexpr const char* verification_name = "verification.conf";  // the page beside it:
inline constexpr const char* verification_page = "verification.html";
inline constexpr const char* diagnosis_folder = "diagnosis";

// Least recording for a diagnosis at the end of a run; less says too little about effects beyond the 24 parameters.
inline constexpr double least_diagnosed_s = 1800.0;

// Makes the results of every unit still in the run. utc_s: when the recordings were sealed. An error when no unit calibrates, or of the storage.
Status make_results(Run& run, double utc_s, CommandContext& context);
// Prints the results and sets the status of every unit that is still in the run and was calibrated.
void print_results(Run& run, double wall_s, std::ostream& out);

// Returns what continues a run, after `turncal`, to be pasted.
inline std::string resuming(const std::string& folder) { return "resume " + shell_path(folder); }

// Ends the program at once when the disk hangs, because it would block whoever waits for it; the table has been left before.
// `then`: the command to use when the disk answers again.
[[noreturn]] void end_without_storage(const std::string& why, const std::string& path, const std::string& then,
                                      CommandContext& context);
// Limits the time of writes while no table moves: end_without_storage() when the disk hangs during the lifetime of the result.
std::unique_ptr<StorageLimit> limit_storage(const std::string& path, const std::string& then, CommandContext& context);

// Turns a failed write into an error of kind device: it is never the unit's, nor the operator's mistake.
Status stored(Status status);
// Returns the reason of the verdict; empty: a plain pass.
std::string reason_of(const RunPlan& run, const VerdictReport& verdict);
// Returns an error of kind unit_failed, with verdict and reason, when the verdict is not accepted.
Status verdict_status(const std::string& unit, const VerdictReport& report);
// "unit SN1: fail: reason"
std::string outcome_words(const std::string& unit, std::string_view outcome, const std::string& reason);
// Returns the reason of an outcome without the unit and the outcome, which stand beside it.
std::string reason_alone(const Status& status, const std::string& unit, std::string_view outcome,
                         const VerdictReport& verdict);

}  // namespace turncal
