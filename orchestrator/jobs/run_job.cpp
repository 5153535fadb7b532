#include "orchestrator/jobs/run_job.h"

#include <algorithm>
#include <filesystem>

#include "imu_io/base/clock.h"
#include "imu_io/base/console.h"
#include "imu_io/base/format_number.h"
#include "orchestrator/devices/stop_signals.h"
#include "orchestrator/figures/report_format.h"
#include "orchestrator/jobs/continued_run.h"
#include "orchestrator/jobs/navigation/verification_job.h"
#include "orchestrator/jobs/preflight.h"
#include "orchestrator/jobs/run_attempt.h"
#include "orchestrator/jobs/run_results.h"
#include "orchestrator/jobs/sequence_coverage.h"
#include "orchestrator/records/output_folder.h"
#include "orchestrator/records/recording_sink.h"
#include "orchestrator/records/results_database.h"
#include "orchestrator/records/station_records.h"
#include "orchestrator/station/hooks.h"
#include "orchestrator/station/version.h"
#include "orchestrator/watch/progress.h"
#include "orchestrator/watch/service_watch.h"

namespace turncal {

namespace {

Status check_plan(const Plan& plan) {
  if (plan.ok()) return {};
  const std::size_t more = plan.violations.size() - 1;
  return input_error(plan.violations.front() +
                     (more > 0 ? " (and " + std::to_string(more) + " more; see turncal check)" : ""));
}

Plan plan_of(const PreparedRun& run, const Sequence& sequence, double sample_period_s) {
  return make_plan(sequence, plan_limits(run.station, sample_period_s));
}

// What the recording of a verification would say.
RecordingInfo verified_info(const PreparedRun& run) {
  RecordingInfo info = planned_info(run);
  info.unit_serial = run.unit();
  info.simulated = run.simulated();
  return info;
}

// What could not be calibrated at the end is said before anything moves.
Status check_sequence(const PreparedRun& run, const Plan& plan, const std::string& otherwise) {
  TRY(check_plan(plan));
  if (run.request.verify) {
    if (run.verified) {
      TRY(check_applicable(*run.verified, run.request.verified, verified_info(run)));
    }
    const Segments planned = planned_segments(plan);
    TRY(check_north_seeking(planned, run.verify_from, run.sample_period_s(), run.sequence.file));
  }
  if (run.request.capture_only || run.request.partial || !run.request.continues.empty()) return {};
  Sequence calibrating = run.sequence;
  if (run.verify_from > 0)
    std::erase_if(calibrating.steps, [&](const Step& step) { return step.number >= run.verify_from; });
  const std::vector<std::string> keys =
      undetermined_by(calibrating, plan_of(run, calibrating, run.sample_period_s()), planned_info(run));
  if (keys.empty()) return {};
  return input_error("sequence " + run.sequence.name + " " + coverage_text(keys) + otherwise);
}

Status look_ahead(const PreparedRun& run, const Plan& plan, const std::string& folder, double utc_s) {
  if (!run.request.continues.empty()) {
    if (const auto earlier = recordings_up_to(run.request.continues); !earlier) return earlier.error();
  }
  const std::vector<Error> found = preflight({.station = run.station,
                                              .plan = plan,
                                              .folder = folder,
                                              .units = run.request.units,
                                              .utc_s = utc_s,
                                              .simulated = run.simulated(),
                                              .overdue_reason = run.request.overdue_reason});
  if (found.empty()) return {};
  const std::size_t more = found.size() - 1;
  return Error{found.front().kind,
               found.front().message + (more > 0 ? " (and " + std::to_string(more) + " more)" : "")};
}

std::string first_line(const PreparedRun& run) {
  return std::string("turncal ") + software_version() + (run.request.units.size() > 1 ? ", units " : ", unit ") +
         join(run.request.units) + ", station " + run.station.name + ", sequence " + run.sequence.name +
         (run.request.dry_run ? ", rig seed " + std::to_string(run.rig.seed)
          : run.simulated()   ? ", simulated devices"
                              : "");
}

// In one word, whatever became of a unit.
std::string attempt_outcome(const UnitRun& unit) {
  const std::string outcome = outcome_of(unit);
  if (!outcome.empty()) return outcome;
  const ErrorKind kind = unit.status.error().kind;
  return kind == ErrorKind::aborted ? "aborted" : kind == ErrorKind::interrupted ? "interrupted" : "failed";
}

Status note_attempt(const UnitRun& unit, const std::string& outcome, const Status& why, double utc_s) {
  const std::string records = records_file(unit.run.station);
  if (records.empty()) return {};
  ResultsDatabase database = TRY(ResultsDatabase::open(records));
  AttemptRecord attempt = attempt_record(unit.run, unit.folder, unit.counts, unit.results);
  attempt.outcome = outcome;
  attempt.time_utc = format_utc(utc_s);
  if (attempt.began_utc.empty()) attempt.began_utc = attempt.time_utc;
  if (!why) attempt.reason = why.error().message;
  return stored(database.note(attempt));
}

// To a server; what cannot be sent is said in the log and does not hold up a run.
void send_on(const std::vector<UnitRun>& units, RunLog* log) {
  const std::string trouble = units.empty() ? "" : send_records(units.front().run.station);
  if (log && !trouble.empty()) log->line(trouble);
}

Status note_running(const std::vector<UnitRun>& units, double utc_s) {
  for (const UnitRun& unit : units) {
    if (unit.dropped) continue;
    if (Status status = note_attempt(unit, outcome_running, {}, utc_s); !status) return status;
  }
  return {};
}

// Before there was a run. A refusal makes no database, and why it was refused is said whether it can be noted or not.
Error refused(const PreparedRun& run, const Error& why) {
  const double utc_s = run.request.dry_run ? run.rig.start_utc_s : wall_utc_s();
  const std::vector<UnitRun> units = units_of(run, "");
  for (const UnitRun& unit : units) {
    if (!path_exists(records_file(run.station))) break;
    if (!note_attempt(unit, "refused", why, utc_s)) break;
  }
  send_on(units, nullptr);
  return why;
}

// What became of units that have no calibration: the others were noted with theirs.
Status note_outcomes(const std::vector<UnitRun>& units) {
  for (const UnitRun& unit : units) {
    if (unit.counts.ended_utc_s <= 0.0 || (unit.results.output && !outcome_of(unit).empty())) continue;
    TRY(note_attempt(unit, attempt_outcome(unit), unit.status, unit.counts.ended_utc_s));
  }
  return {};
}

// What the station wants kept and told of every unit; what became of them is not changed by it.
RunEnd conclude(RunEnd end, std::vector<UnitRun>& units, RunLog* log) {
  for (UnitRun& unit : units) {
    if (!end.to_the_end && unit.status) unit.status = end.status;
  }
  if (Status status = note_outcomes(units); !status) {
    if (log) log->line(status.error().message);
    if (end.status || end.to_the_end) end.status = status;
    end.to_the_end = false;
  }
  send_on(units, log);
  for (UnitRun& unit : units) {
    HookCall call = call_for(unit.status);
    call.unit = unit.run.unit();
    call.folder = unit.folder;
    call.outcome = outcome_of(unit);
    if (unit.status && call.outcome == to_string(UnitVerdict::not_judged)) {  // nobody has said that it is good
      call.event = "needs_operator";
      call.message = "unit " + call.unit + ": " + call.outcome + ": " + reason_of(unit.run, unit.results.verdict);
    }
    call.dry_run = unit.run.request.dry_run;
    if (Status status = run_hook(unit.run.station.hooks, call); !status && log) log->line(status.error().message);
    end.units.push_back({call.unit, call.folder, call.outcome, unit.status});
  }
  return end;
}

// Everything is recorded: no device is needed any more.
RunEnd finish_sealed(std::vector<UnitRun>& units, const std::string& folder, const JournalContents& contents,
                     JournalFile& journal, CommandContext& context) {
  const StopSignals signals(FirstInterrupt::pauses);  // as in a run that has recorded all: it finishes
  const double began_s = monotonic_s();
  for (UnitRun& unit : units) unit.counts.ended_utc_s = contents.seal_utc_s.value_or(0.0);
  TRY(verify_recordings(units, contents));
  TRY(calibrate_units(units, *contents.seal_utc_s, journal));
  conclude_units(units, monotonic_s() - began_s, folder + "/" + log_name, context.out);
  RunEnd end(status_of(units));
  end.to_the_end = true;
  return end;
}

Plan plan_of(const PreparedRun& run, double sample_period_s) { return plan_of(run, run.sequence, sample_period_s); }

// Whoever had dropped out. late: also those after the last completed dwell, which a run that goes on takes back.
void mark_dropped(const JournalContents& contents, bool late, std::vector<UnitRun>& units) {
  for (UnitRun& unit : units) {
    unit.dropped = false;
    unit.status = {};
  }
  for (const JournalContents::DroppedUnit& dropped : contents.dropped) {
    if (dropped.unit >= units.size() || (dropped.after_last_dwell && !late)) continue;
    UnitRun& unit = units[dropped.unit];
    unit.dropped = true;
    unit.status = Error{dropped.why.kind, "unit " + unit.run.unit() + " dropped out at " + dropped.why.message};
  }
}

VerdictReport report_of(const JournalFields& record) {
  VerdictReport report;
  for (const auto& [key, value] : record) {
    if (key == "reason") report.reason = value;
    if (key == "result") report.verdict = verdict_from(value).value_or(UnitVerdict::not_judged);
  }
  return report;
}

RunEnd say_over(const JournalContents& contents, const std::string& folder, std::ostream& out) {
  PreparedRun named;
  named.request = request_of(contents);
  std::vector<UnitRun> units = units_of(named, folder);
  mark_dropped(contents, true, units);
  TRY(check_what_is_over(units, folder, contents));
  for (UnitRun& unit : units) {
    if (unit.dropped) continue;
    const JournalFields& verdict = *contents.verdict_of(unit.run.unit());
    const std::string& result = verdict.front().second;
    out << "The run of unit " << unit.run.unit() << " is complete, verdict " << result << ": nothing to resume."
        << std::endl;
    unit.results.verdict = report_of(verdict);
    unit.status = verdict_status(unit.run.unit(), unit.results.verdict);
  }
  RunEnd end(status_of(units));
  end.to_the_end = true;
  for (const UnitRun& unit : units) end.units.push_back({unit.run.unit(), unit.folder, outcome_of(unit), unit.status});
  return end;
}

// What the journal says was asked for, with what is given now.
Result<RunRequest> request_again(const JournalContents& contents, const RunRequest& now) {
  RunRequest request = request_of(contents);
  if (!now.units.empty() && now.units != request.units) {
    const auto list = [](const std::vector<std::string>& units) {
      std::string text;
      for (const std::string& unit : units) text += (text.empty() ? "'" : ", '") + unit + "'";
      return text;
    };
    return input_error("--unit " + list(now.units) + ": expected " + list(request.units) + ", whose run this is");
  }
  if (!now.station.empty()) request.station = now.station;
  if (!now.sequence.empty()) request.sequence = now.sequence;
  if (!now.rig.empty()) request.rig = now.rig;
  if (request.overdue_reason.empty()) request.overdue_reason = now.overdue_reason;
  request.no_diagnosis = request.no_diagnosis || now.no_diagnosis;
  request.listen = now.listen;
  request.pace = now.pace;
  request.verbose = now.verbose;
  return request;
}

}  // namespace

bool is_over(const JournalContents& journal) {
  if (journal.verdicts.empty()) return false;
  const std::vector<std::string> units = journal.units();
  for (std::size_t i = 0; i < units.size(); ++i) {
    const bool dropped =
        std::any_of(journal.dropped.begin(), journal.dropped.end(), [i](const auto& gone) { return gone.unit == i; });
    if (!dropped && !journal.verdict_of(units[i])) return false;
  }
  return true;
}

Status check_sequence(const PreparedRun& run) { return check_sequence(run, plan_of(run, run.sample_period_s()), ""); }

RunEnd begin_run(const RunRequest& request, const std::string& folder_path, CommandContext& context) {
  if (request.dry_run) context.tag = dry_run_tag;
  PreparedRun prepared = TRY(prepare(request));
  context.tag = tag_of(prepared);
  const LinePrefix marked(context.out, context.tag);
  const double period_s = prepared.sample_period_s();
  const Plan plan = plan_of(prepared, period_s);
  if (Status status =
          check_sequence(prepared, plan, ", --partial to estimate what can be of the others, or --capture-only");
      !status)
    return refused(prepared, status.error());
  Result<RunDevices> devices = make_devices(prepared, context);
  if (!devices) return refused(prepared, devices.error());
  const double utc_s = devices->devices().clock.utc_s();
  if (Status status = look_ahead(prepared, plan, folder_path, utc_s); !status) return refused(prepared, status.error());

  Result<OutputFolder> folder = OutputFolder::prepare(
      folder_path,
      {binary_recording_name, partial_recording_name, parameters_name, truth_name, log_name, journal_name});
  if (!folder) return refused(prepared, folder.error());
  prepared.began_utc = format_utc(utc_s);
  std::vector<UnitRun> units = units_of(prepared, folder->path());
  std::vector<OutputFolder> unit_folders;
  for (std::size_t i = 0; units.size() > 1 && i < units.size(); ++i) {
    Result<OutputFolder> own = OutputFolder::prepare(
        units[i].folder, {binary_recording_name, partial_recording_name, parameters_name, truth_name});
    if (!own) return own.error();
    unit_folders.push_back(std::move(*own));
  }
  JournalFields begin = begin_fields(prepared);
  if (!prepared.request.manual) begin.emplace_back("planned_s", format_number(plan.station_s));
  JournalFile journal = TRY(JournalFile::create(folder->file(journal_name), begin));
  RunLog log = TRY(RunLog::create(folder->file(log_name), std::string(tag_of(prepared))));
  log.line(first_line(prepared));
  TRY(note_running(units, utc_s));
  send_on(units, &log);

  RunEnd end =
      attempt({prepared, plan, period_s, units, folder->path(), journal, log, std::nullopt, 1}, *devices, context);
  const bool interrupted =
      !end.status && end.status.error().kind == ErrorKind::interrupted;  // there is something to go on with
  for (std::size_t i = 0; i < units.size(); ++i) {
    if (units[i].counts.recorded_s <= 0.0 && !interrupted && !end.moved) continue;
    folder->keep();
    if (!unit_folders.empty()) unit_folders[i].keep();
  }
  return conclude(std::move(end), units, &log);
}

RunEnd resume_run(const std::string& folder, const RunRequest& now, CommandContext& context) {
  const std::string path = folder + "/" + journal_name;
  if (!path_exists(path)) return input_error(folder + ": holds no " + journal_name + ": expected the folder of a run");
  Result<JournalFile> journal = JournalFile::reopen(path);  // its lock: nobody else goes on with this run
  if (!journal) return journal.error();
  const LockFile held = TRY(hold_folder(folder));
  const JournalContents contents = TRY(read_journal(path));
  context.tag = tag_of(contents);
  const LinePrefix marked(context.out, context.tag);
  const RunRequest request = TRY(request_again(contents, now));
  if (is_over(contents)) return say_over(contents, folder, context.out);
  PreparedRun prepared = TRY(prepare(request));
  context.tag = tag_of(prepared);
  TRY(check_unchanged(prepared, contents));

  std::vector<UnitRun> units = units_of(prepared, folder);
  mark_dropped(contents, true, units);
  const bool sealed = TRY(sealed_recordings(units));
  if (sealed) return conclude(finish_sealed(units, folder, contents, *journal, context), units, nullptr);

  mark_dropped(contents, false, units);
  const double period_s = prepared.sample_period_s();
  const Plan plan = plan_of(prepared, period_s);
  TRY(check_plan(plan));
  RunDevices devices = TRY(make_devices(prepared, context));
  std::optional<ResumePoint> resume;
  std::string what = "no dwell was complete: starts again from the beginning";
  if (contents.last_dwell) {
    if (contents.last_dwell->item >= plan.items.size())
      return input_error(path + ": names an item that the plan does not have");
    if (contents.last_dwell->units.size() != units.size())
      return input_error(path + ": a dwell is not of all units of the run");
    resume = ResumePoint{*contents.last_dwell, devices.rig != nullptr};
    for (const UnitRun& unit : units) resume->dropped.push_back(unit.dropped);
    if (devices.rig) {
      TRY(devices.rig->put_back(contents.commands, contents.last_dwell->time_s));
    }
    if (devices.rehearsal) {
      TRY(devices.rehearsal->pass_until(contents.last_dwell->time_s));
    }
    what = "goes on after item " + std::to_string(contents.last_dwell->item + 1) + " of " +
           std::to_string(plan.items.size());
  } else {
    std::error_code ignored;
    for (const UnitRun& unit : units) {
      std::filesystem::create_directories(unit.folder, ignored);
      std::filesystem::remove(unit.folder + "/" + partial_recording_name, ignored);
    }
  }
  const double utc_s = devices.devices().clock.utc_s();
  TRY(look_ahead(prepared, plan, folder, utc_s));
  if (contents.last_dwell && utc_s < contents.last_dwell->utc_s - ClockWatch::step_s) {
    what +=
        "; the clock was set back: it stands before the end of that item, " + format_utc(contents.last_dwell->utc_s);
  }
  const JournalFields resumed = {
      {"software_version", software_version()}, {"what", what}, {"overdue_reason", prepared.request.overdue_reason}};
  TRY(journal->append(JournalType::resume, resumed));
  RunLog log = TRY(RunLog::append(folder + "/" + log_name, std::string(tag_of(prepared))));
  log.line("resumed by turncal " + std::string(software_version()) + ": " + what);
  for (UnitRun& unit : units) unit.counts.sessions = contents.sessions + 1;
  TRY(note_running(units, utc_s));
  send_on(units, &log);
  const Attempt again{prepared, plan, period_s, units, folder, *journal, log, resume, contents.sessions + 1};
  return conclude(attempt(again, devices, context), units, &log);
}

}  // namespace turncal
