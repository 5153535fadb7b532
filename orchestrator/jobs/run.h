// One run and all that becomes of it. begin_run() walks through it:
//
//   plan                       station, sequence and rig read, checked and hashed        run_request.h
//   record                     the table moved, every unit recorded                      record_run.cpp
//   estimate, judge, publish   of each unit, from its recording to its verdict           run_results.cpp
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
// Before every line that a dry run prints or logs, so that none passes for a real one.
inline constexpr std::string_view dry_run_tag = "[dry run] ";
inline constexpr std::string_view simulated_tag = "[simulated] ";  // the same of a live run with a twin
std::string_view tag_of(const RunPlan& run);
std::string_view tag_of(const JournalContents& journal);

// A unit's part of a run.
struct RunUnit {
  std::string serial, folder;
  RigConfig rig;  // of a dry run
  bool dropped = false;
  Status status{};  // how it ended

  double recorded_s = 0.0;
  int repeated_dwells = 0;
  std::uint64_t lost_samples = 0;
  std::optional<UnitClock> clock{};  // empty: not measured, as in a dry run
  double ended_utc_s = 0.0;          // 0: it did not begin

  std::optional<LoadedRecording> recording{};        // as it was, or is, sealed
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
  int sessions = 1;                   // how often it was begun or taken up
  std::optional<ResumePoint> resume;  // where this session goes on; empty: at the beginning
  std::optional<JournalFile> journal;
  std::optional<RunLog> log;  // of a session with devices
  void say(const std::string& line) {
    if (log) log->line(line);
  }
};

// Without journal and log. folder: empty where there is none yet.
Run run_of(RunPlan plan, const std::string& folder);

// What became of a unit, in one word: its verdict; captured, dropped, fail (measured, but no parameters came of it), refused
// (nothing was measured). Empty: it has no outcome yet, a fault of the station stopped it.
std::string outcome_of(const Run& run, const RunUnit& unit);
// Of the whole run: success, or the worst kind and a line that names every unit that has something to say.
Status status_of(const Run& run);
// What is put on record of a unit, without what is empty: keys record.* of its parameter file, columns of its attempt. Nothing here may
// depend on how often the run was interrupted: the file is the same for an uninterrupted one.
KeyTexts facts_of(const Run& run, const RunUnit& unit);
// A row of the database; the caller says what became of it, and when.
AttemptRecord attempt_record(const Run& run, const RunUnit& unit);

// Whether recordings and journal hold what a run needs that goes on after its last dwell: an error says why not. Changes nothing.
Status check_goes_on(const Run& run, const JournalContents& contents);
// Reads every recording once, before it is sealed: what the journal keeps of its contents, by unit. An error when one is damaged.
Result<std::vector<std::string>> read_recordings(Run& run);

// What the run in `folder` recorded, and before it what that run continues: oldest first. An error when one is not as it was sealed.
Result<std::vector<LoadedRecording>> recordings_up_to(const std::string& folder);

// A run that failed before it moved the table leaves nothing; one that failed later leaves its log and journal, and can be taken up.
struct RunEnd {
  Status status;  // of the whole run: what the command returns
  struct Unit {
    std::string serial, folder;
    std::string outcome;  // in one word (outcome_of)
    Status status;
    std::string reason;  // of the outcome; empty: a plain pass
  };
  std::vector<Unit> units;  // none: refused before anything was made
  bool moved = false;       // the table was homed or sent somewhere: there is something to tell
  bool to_the_end = false;  // whatever became of single units, the table and the run are in order

  RunEnd(Status how, bool whole = false) : status(std::move(how)), to_the_end(whole) {}
  RunEnd(Error why) : status(std::move(why)) {}
};

// Every unit that is left has its verdict: nothing to resume.
bool is_over(const JournalContents& journal);

// That the station can run the sequence, and that what it is for can come of it; `otherwise`: what can be done instead. Part of begin_run; a
// batch asks before its first unit.
Status check_sequence(const RunPlan& run, const std::string& otherwise = "");

RunEnd begin_run(const RunRequest& request, const std::string& folder, CommandContext& context);

// `now`: where the files are now that the journal names (station, sequence, rig); empty: where they were; and listen and pace.
// The devices must be the same kind (simulated or not), the units and every hash those of the journal.
RunEnd resume_run(const std::string& folder, const RunRequest& now, CommandContext& context);

struct RunDevices;  // dry_run_devices.h
Result<RunDevices> make_devices(const RunPlan& run, CommandContext& context);

// A session, up to the verdicts. REQUIRES: journal and log of the run. Sets what is known of its units, and how they ended.
RunEnd record_run(Run& run, RunDevices& devices, CommandContext& context);

// From the sealed recording of a unit to what a run leaves behind: estimated, judged, and published in the order in which it becomes durable:
//
//   truth.conf (dry run) -> verification.conf -> diagnosis/ -> parameters.conf -> statistics.tcs -> journal `results` -> database
//   -> parameter store -> journal `verdict`
//
// Only then is a verdict printed. What cannot be written is a fault of the storage (kind device), whatever the reason. Every step can be done
// again: a run that was interrupted in between repeats them all with the same bytes.
inline constexpr const char* truth_name = "truth.conf";
inline constexpr const char* verification_name = "verification.conf";  // and beside it:
inline constexpr const char* verification_page = "verification.html";
inline constexpr const char* diagnosis_folder = "diagnosis";

// A recording of less says too little about what the 24 parameters lack: no diagnosis at the end of the run.
inline constexpr double least_diagnosed_s = 1800.0;

// Of every unit that is left. utc_s: when the recordings were sealed. An error when no unit can be calibrated, or of the storage.
Status make_results(Run& run, double utc_s, CommandContext& context);
// Prints the results and sets the status of every unit that is left and was calibrated.
void print_results(Run& run, double wall_s, std::ostream& out);

// A disk that hangs for good would hold up whoever waits for it: the table was left, so the program says so and ends at once.
// `then`: the command for when it answers again.
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
// "unit SN1: fail: reason"
std::string outcome_words(const std::string& unit, std::string_view outcome, const std::string& reason);
// The reason of an outcome beside which unit and outcome stand.
std::string reason_alone(const Status& status, const std::string& unit, std::string_view outcome,
                         const VerdictReport& verdict);

}  // namespace turncal
