// One run and all that becomes of it. begin_run() (run_job.h) walks through it:
//
//   plan                       station, sequence and rig read, checked and hashed        run_request.h
//   record                     the table moved, every unit recorded                      record_run.h
//   estimate, judge, publish   of each unit, from its recording to its verdict           run_results.h
//
// A run of one unit has everything in its own folder; a run of several has it in FOLDER/SERIAL (name_of_unit) each, with journal.tcj and
// run.log in FOLDER.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "orchestrator/jobs/calibration_job.h"
#include "orchestrator/jobs/run_request.h"
#include "orchestrator/records/attempt_record.h"
#include "orchestrator/records/journal.h"
#include "orchestrator/report/verification_report.h"
#include "orchestrator/watch/progress.h"

namespace turncal {

inline constexpr const char* log_name = "run.log";
inline constexpr const char* removed_by_prune = " is removed by turncal prune";  // in the log
// Before every line that a dry run prints or logs, so that none passes for a real one.
inline constexpr std::string_view dry_run_tag = "[dry run] ";
inline constexpr std::string_view simulated_tag = "[simulated] ";  // the same of a live run with a twin
std::string_view tag_of(const RunPlan& run);
std::string_view tag_of(const JournalContents& journal);

// A unit's part of a run.
struct RunUnit {
  std::string serial, folder;
  RigConfig rig;       // of a dry run
  JournalFields mark;  // "unit", of a run of several: which unit a record of the journal is about
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
// A row of the database; the caller says what became of it, and when.
AttemptRecord attempt_record(const Run& run, const RunUnit& unit);

// Recordings that were complete when the run was interrupted, one that had no time to be finished among them. False: they are
// not, and the run has to go on with devices.
Result<bool> sealed_recordings(const Run& run);
// Whether recordings and journal hold what a run needs that goes on after its last dwell: an error says why not. Changes nothing.
Status check_goes_on(const Run& run, const JournalContents& contents);
// Reads every recording once, before it is sealed: what the journal keeps of its contents, by unit. An error when one is damaged.
Result<std::vector<std::string>> read_recordings(Run& run);
// Reads those that were sealed, with what the journal says of them. An error where one is damaged, or not what this run sealed.
Status read_sealed_recordings(Run& run, const JournalContents& contents);
// Of a run that is over: its parameter files are those it made; its recordings are there as they were sealed, or were pruned, and none
// goes on.
Status check_what_is_over(const Run& run, const JournalContents& contents);

// What the run in `folder` recorded, and before it what that run continues: oldest first. An error when one is not as it was sealed.
Result<std::vector<LoadedRecording>> recordings_up_to(const std::string& folder);

}  // namespace turncal
