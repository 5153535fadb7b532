// From a sealed recording to what a run leaves behind, in the order in which it becomes durable:
//
//   truth.conf (dry run) -> verification.conf -> diagnosis/ -> parameters.conf -> statistics.tcs -> journal `results` -> database -> parameter store -> journal `verdict`
//
// Only then is a verdict printed. What cannot be written is a fault of the storage (kind device), whatever the reason. Every step can be done again: a run that was interrupted in between repeats them all with the
// same bytes.
#pragma once

#include <optional>
#include <ostream>
#include <string>
#include <string_view>

#include "orchestrator/jobs/calibration_job.h"
#include "orchestrator/jobs/diagnosis_job.h"
#include "orchestrator/jobs/run_request.h"
#include "orchestrator/records/attempt_record.h"
#include "orchestrator/records/journal_file.h"
#include "orchestrator/records/output_folder.h"
#include "orchestrator/report/verification_report.h"
#include "orchestrator/station/verdict.h"

namespace turncal {

inline constexpr const char* truth_name = "truth.conf";
inline constexpr const char* verification_name = "verification.conf";
inline constexpr const char* diagnosis_folder = "diagnosis";
// Before every line that a dry run prints or logs, so that none passes for a real one.
inline constexpr std::string_view dry_run_tag = "[dry run] ";
inline constexpr std::string_view simulated_tag = "[simulated] ";  // the same of a live run with a twin
std::string_view tag_of(const PreparedRun& run);
std::string_view tag_of(const JournalContents& journal);

struct RunCounts {
  double recorded_s = 0.0;
  int repeated_dwells = 0;
  std::uint64_t lost_samples = 0;
  int sessions = 1;                     // how often the run was begun or taken up again
  std::optional<UnitClock> clock = {};  // empty: not measured, as in a dry run
  double ended_utc_s = 0.0;             // 0: it did not begin
};

struct RunResults {
  std::optional<CalibrationOutput> output;         // empty: only captured
  std::optional<DiagnosisOutput> diagnosis;        // empty: not made
  std::optional<VerificationReport> verification;  // empty: not asked for
  VerdictReport verdict;
};

// utc_s: when the recording was sealed. mark: goes after the other fields of the journal's records.
Status write_results(const PreparedRun& run, const std::string& folder, const LoadedRecording& recording, double utc_s,
                     const RunCounts& counts, JournalFile& journal, const JournalFields& mark, RunResults& results);

// A failure to keep something is never the unit's, nor a mistake of the operator's: of kind device.
Status stored(Status status);

// The attempt as the database has it; the caller says what became of it, and when.
AttemptRecord attempt_record(const PreparedRun& run, const std::string& folder, const RunCounts& counts,
                             const RunResults& results);

// A recording of less says too little about what the 24 parameters lack: no diagnosis at the end of the run.
inline constexpr double least_diagnosed_s = 1800.0;

void print_summary(const PreparedRun& run, const std::string& folder, const RunCounts& counts,
                   const RunResults& results, double wall_s, const std::string& log, std::ostream& out);
// Why the verdict is what it is; empty: a plain pass.
std::string reason_of(const PreparedRun& run, const VerdictReport& verdict);
// An error of kind unit_failed, with verdict and reason, when the verdict is not one to accept.
Status verdict_status(const std::string& unit, const VerdictReport& report);

}  // namespace turncal
