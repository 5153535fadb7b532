#include "orchestrator/run_job.h"

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <memory>
#include <thread>

#include "imu_io/atomic_file.h"
#include "imu_io/clock.h"
#include "imu_io/recording_source.h"
#include "orchestrator/dry_run_devices.h"
#include "orchestrator/hooks.h"
#include "orchestrator/live_devices.h"
#include "orchestrator/live_view.h"
#include "orchestrator/output_folder.h"
#include "orchestrator/progress.h"
#include "orchestrator/recording_sink.h"
#include "orchestrator/rehearsal_devices.h"
#include "orchestrator/run_log.h"
#include "orchestrator/results_database.h"
#include "orchestrator/run_results.h"
#include "orchestrator/station_run.h"
#include "orchestrator/status_page.h"
#include "orchestrator/stop_signals.h"

namespace turncal {

namespace {

constexpr const char* log_name = "run.log";

Status check_plan(const Plan& plan) {
  if (plan.ok()) return {};
  const std::size_t more = plan.violations.size() - 1;
  return input_error(plan.violations.front() +
                     (more > 0 ? " (and " + std::to_string(more) + " more; see turncal check)" : ""));
}

// A table whose calibration is overdue is used only with a reason.
Status check_due(const PreparedRun& run, double utc_s) {
  const std::string& due = run.station.table_calibration_due;
  const std::string today = format_utc(utc_s).substr(0, 10);
  if (due.empty() || today <= due) return {};  // days as 2026-12-31 sort as they follow each other
  if (!run.request.overdue_reason.empty()) return {};
  return input_error("the calibration of table '" + run.station.table_id + "' was due on " + due + ", today is " + today +
                     ": expected a calibrated table, or --override-due REASON, which goes on record");
}

// Feeds the run's log and what the operator sees from the same events.
class Fanout : public RunObserver {
 public:
  explicit Fanout(std::vector<RunObserver*> observers) : observers_(std::move(observers)) {}
  void on_transition(const TransitionRecord& record) override {
    for (RunObserver* observer : observers_) observer->on_transition(record);
  }
  void on_progress(const RunSnapshot& snapshot) override {
    for (RunObserver* observer : observers_) observer->on_progress(snapshot);
  }

 private:
  std::vector<RunObserver*> observers_;
};

// Holds virtual time back to `pace` times the wall clock.
class PaceKeeper : public RunObserver {
 public:
  explicit PaceKeeper(double pace) : pace_(pace) {}
  void on_transition(const TransitionRecord&) override {}
  void on_progress(const RunSnapshot& snapshot) override {
    if (pace_ <= 0.0) return;
    if (!began_s_) began_s_ = steady_wall_s() - snapshot.time_s / pace_;
    const double ahead_s = snapshot.time_s / pace_ - (steady_wall_s() - *began_s_);
    if (ahead_s > 0.0) std::this_thread::sleep_for(std::chrono::duration<double>(std::min(ahead_s, 1.0)));
  }

 private:
  double pace_;
  std::optional<double> began_s_;
};

// The newest results on record, one line each.
std::vector<std::string> last_results(const PreparedRun& run) {
  constexpr std::size_t shown = 10;
  std::vector<std::string> lines;
  if (run.station.database.empty() || !path_exists(run.station.database)) return lines;
  const Result<ResultsDatabase> database = ResultsDatabase::open_to_read(run.station.database);
  const auto all = database ? database->list("", "N01") : Result<std::vector<StoredCalibration>>(database.error());
  if (!all) return {all.error().message};
  for (std::size_t i = all->size() - std::min(all->size(), shown); i < all->size(); ++i) {
    const StoredCalibration& c = (*all)[i];
    lines.push_back(c.time_utc + "  " + c.unit + "  " + c.verdict + (c.simulated ? "  [simulated]" : ""));
  }
  return lines;
}

struct Attempt {
  const PreparedRun& run;
  const Plan& plan;
  double sample_period_s;
  std::string folder;
  JournalFile& journal;
  RunLog& log;
  std::optional<ResumePoint> resume;
  int sessions = 1;
};

// The rig in its own time, the rig turned by an operator, or the station's real devices.
struct RunDevices {
  std::unique_ptr<DryRunDevices> rig;
  std::unique_ptr<RehearsalDevices> rehearsal;
  std::unique_ptr<LiveDevices> live;
  RunObserver* prompts = nullptr;  // of a table turned by hand
  StationDevices devices() { return rig ? rig->devices() : rehearsal ? rehearsal->devices() : live->devices(); }
};

Result<RunDevices> make_devices(const PreparedRun& run, CommandContext& context) {
  RunDevices made;
  const std::string tag(tag_of(run));
  if (run.request.rehearsal()) {
    made.rehearsal = std::make_unique<RehearsalDevices>(run.rig, run.station, run.sequence, STDIN_FILENO, context.out, tag);
    made.prompts = &made.rehearsal->prompts();
    return made;
  }
  if (run.request.dry_run) {
    made.rig = std::make_unique<DryRunDevices>(run.rig);
    return made;
  }
  Result<std::unique_ptr<LiveDevices>> live = LiveDevices::make(run.station, StopSignals::requests(), context.out);
  if (!live) return live.error();
  made.live = std::move(*live);
  made.prompts = made.live->prompts(run.sequence, tag);
  return made;
}

// One attempt with the devices, up to the verdict. `keep`: there is something to go on with.
Status attempt(const Attempt& a, RunDevices& made, CommandContext& context, bool& keep) {
  const StationDevices devices = made.devices();
  const std::string tag(tag_of(a.run));
  const double began_s = steady_wall_s();
  // A line redrawn in place would run over the operator's answers.
  const bool in_place = context.out_is_terminal && !made.prompts;
  ProgressView view(context.out, in_place ? context.terminal_columns : 0, tag, steady_wall_s);
  LiveView live(a.run.request.unit, a.run.station.name, a.run.sequence.name, a.run.request.dry_run, last_results(a.run),
                steady_wall_s);
  std::unique_ptr<StatusPage> page;
  if (!a.run.request.listen.empty()) {
    Result<std::unique_ptr<StatusPage>> opened = StatusPage::open(a.run.request.listen, live);
    if (!opened) return opened.error();
    page = std::move(*opened);
    context.out << tag << "status page " << page->url() << std::endl;
  }
  PaceKeeper pace(a.run.request.pace);
  std::vector<RunObserver*> told{&a.log, &view, &live, &pace};
  if (made.prompts) told.push_back(made.prompts);
  Fanout observers(told);
  RecordingSink recording(a.folder);
  LiveSink sink(recording, live);
  RunResults results;
  const StopSignals signals(FirstInterrupt::pauses);
  RunCounts counts;
  counts.sessions = a.sessions;
  StationRun* running = nullptr;
  const auto calibrate = [&]() -> Status {
    const RunOutcome& so_far = running->outcome();
    counts.recorded_s = static_cast<double>(so_far.recorded_samples) * a.sample_period_s;
    counts.repeated_dwells = so_far.repeated_dwells;
    counts.lost_samples = so_far.lost_samples;
    return write_results(a.run, a.folder, devices.clock.utc_s(), counts, a.journal, results);
  };
  StationRun run(devices, {a.run.sequence, a.plan, a.run.station, a.run.request.unit, a.resume}, sink,
                 {&observers, &StopSignals::requests(), calibrate, &a.journal, &StopSignals::pauses(), &StopSignals::ends()});
  running = &run;
  const RunOutcome outcome = run.run();
  view.clear();
  keep = outcome.recorded_samples > 0 || outcome.state == RunState::interrupted;
  live.end(outcome.state == RunState::done ? "done: " + std::string(to_string(results.verdict.verdict)) : outcome.error.message);
  if (page) page->say_goodbye();
  if (outcome.state != RunState::done) {
    a.log.line(outcome.error.message);
    if (outcome.state == RunState::interrupted) {
      return Error{outcome.error.kind, outcome.error.message + "; go on with: turncal resume " + a.folder};
    }
    if (keep) context.out << tag << "what is recorded is kept; go on with: turncal resume " << a.folder << std::endl;
    return outcome.error;
  }
  if (!a.log.status()) return a.log.status();
  print_summary(a.run, a.folder, counts, results, steady_wall_s() - began_s, context.out);
  return verdict_status(a.run.request.unit, results.verdict);
}

std::string first_line(const PreparedRun& run) {
  return std::string("turncal ") + software_version() + ", unit " + run.request.unit + ", station " + run.station.name +
         ", sequence " + run.sequence.name +
         (run.request.dry_run ? ", rig seed " + std::to_string(run.rig.seed) : run.simulated() ? ", simulated devices" : "");
}

// A recording that was finished but not yet renamed when the run was interrupted. Returns whether there is a sealed one.
Result<bool> sealed_recording(const std::string& folder) {
  const std::string path = folder + "/" + binary_recording_name, partial = folder + "/" + partial_recording_name;
  if (path_exists(path)) return true;
  if (!path_exists(partial)) return false;
  const Result<std::unique_ptr<RecordingSource>> source = RecordingSource::open(partial);
  if (!source || !(*source)->damage().complete) return false;
  if (Status status = rename_durably(partial, path); !status) return status.error();
  return true;
}

// Everything is recorded: no device is needed any more.
Status finish_sealed(const PreparedRun& run, const std::string& folder, const JournalContents& contents, JournalFile& journal,
                     CommandContext& context) {
  if (!contents.seal_utc_s || !contents.last_dwell) {
    return input_error(folder + ": the recording is complete, but the journal knows nothing of it");
  }
  const double began_s = steady_wall_s();
  Result<std::unique_ptr<RecordingSource>> source = RecordingSource::open(folder + "/" + binary_recording_name);
  if (!source) return source.error();
  if ((*source)->info().simulated != run.simulated() || (*source)->info().unit_serial != run.request.unit) {
    return input_error(folder + ": the recording is of unit " + (*source)->info().unit_serial + " and " +
                       ((*source)->info().simulated ? "simulated" : "real") + ", the journal is of another");
  }
  RunCounts counts;
  counts.repeated_dwells = contents.last_dwell->repeated_dwells;
  counts.lost_samples = contents.last_dwell->lost_samples;
  counts.sessions = contents.sessions + 1;
  counts.recorded_s = static_cast<double>((*source)->segments().back().end_sample) * (*source)->info().sample_period_s;
  RunResults results;
  if (Status status = write_results(run, folder, *contents.seal_utc_s, counts, journal, results); !status) return status;
  print_summary(run, folder, counts, results, steady_wall_s() - began_s, context.out);
  return verdict_status(run.request.unit, results.verdict);
}

// What the station wants told; the run's outcome is not changed by it.
Status told(const PreparedRun& run, const std::string& folder, RunLog* log, Status outcome) {
  HookCall call = call_for(outcome);
  call.unit = run.request.unit;
  call.folder = folder;
  call.dry_run = run.request.dry_run;
  if (Status status = run_hook(run.station.hooks, call); !status && log) log->line(status.error().message);
  return outcome;
}

Plan plan_of(const PreparedRun& run, double sample_period_s) {
  return make_plan(run.sequence, plan_limits(run.station, sample_period_s));
}

// A run with a verdict is over.
Status say_complete(const JournalContents& contents, const std::string& folder, std::ostream& out) {
  const std::string& verdict = contents.verdict.front().second;
  out << (contents.begin_value("simulated") == "true" ? dry_run_tag : "") << "The run of unit "
      << contents.begin_value("unit") << " is complete, verdict " << verdict << ": nothing to resume." << std::endl;
  if (verdict != to_string(UnitVerdict::fail) && verdict != to_string(UnitVerdict::conditional_fail)) return {};
  return Error{ErrorKind::unit_failed, folder + ": the unit's verdict is " + verdict};
}

// What the journal says was asked for, with what is given now.
Result<RunRequest> request_again(const JournalContents& contents, const RunRequest& now) {
  RunRequest request = request_of(contents);
  if (!now.unit.empty() && now.unit != request.unit) {
    return input_error("--unit '" + now.unit + "': expected '" + request.unit + "', whose run this is");
  }
  if (!now.station.empty()) request.station = now.station;
  if (!now.sequence.empty()) request.sequence = now.sequence;
  if (!now.rig.empty()) request.rig = now.rig;
  if (request.overdue_reason.empty()) request.overdue_reason = now.overdue_reason;
  request.listen = now.listen;
  request.pace = now.pace;
  return request;
}

}  // namespace

Status begin_run(const RunRequest& request, const std::string& folder_path, CommandContext& context) {
  if (request.dry_run) context.tag = dry_run_tag;
  Result<PreparedRun> prepared = prepare(request);
  if (!prepared) return prepared.error();
  context.tag = tag_of(*prepared);
  const double period_s = prepared->sample_period_s();
  const Plan plan = plan_of(*prepared, period_s);
  if (Status status = check_plan(plan); !status) return status;
  Result<RunDevices> devices = make_devices(*prepared, context);
  if (!devices) return devices.error();
  if (Status status = check_due(*prepared, devices->devices().clock.utc_s()); !status) return status;

  Result<OutputFolder> folder = OutputFolder::prepare(folder_path, {binary_recording_name, partial_recording_name,
                                                                    parameters_name, truth_name, log_name, journal_name});
  if (!folder) return folder.error();
  Result<JournalFile> journal = JournalFile::create(folder->file(journal_name), begin_fields(*prepared));
  if (!journal) return journal.error();
  Result<RunLog> log = RunLog::create(folder->file(log_name), std::string(tag_of(*prepared)));
  if (!log) return log.error();
  log->line(first_line(*prepared));

  bool keep = false;
  const Status status = attempt({*prepared, plan, period_s, folder->path(), *journal, *log, std::nullopt, 1}, *devices,
                                context, keep);
  if (keep) folder->keep();
  return told(*prepared, folder->path(), &*log, status);
}

Status take_up_run(const std::string& folder, const RunRequest& now, CommandContext& context) {
  const std::string path = folder + "/" + journal_name;
  if (!path_exists(path)) return input_error(folder + ": holds no " + journal_name + ": expected the folder of a run");
  Result<JournalFile> journal = JournalFile::reopen(path);  // its lock: nobody else goes on with this run
  if (!journal) return journal.error();
  const Result<JournalContents> contents = read_journal(path);
  if (!contents) return contents.error();
  if (contents->begin_value("live") != "true") context.tag = dry_run_tag;
  if (!contents->verdict.empty()) return say_complete(*contents, folder, context.out);
  const Result<RunRequest> request = request_again(*contents, now);
  if (!request) return request.error();
  Result<PreparedRun> prepared = prepare(*request);
  if (!prepared) return prepared.error();
  context.tag = tag_of(*prepared);
  if (Status status = check_unchanged(*prepared, *contents); !status) return status;

  const Result<bool> sealed = sealed_recording(folder);
  if (!sealed) return sealed.error();
  if (*sealed) return told(*prepared, folder, nullptr, finish_sealed(*prepared, folder, *contents, *journal, context));

  const double period_s = prepared->sample_period_s();
  const Plan plan = plan_of(*prepared, period_s);
  if (Status status = check_plan(plan); !status) return status;
  Result<RunDevices> devices = make_devices(*prepared, context);
  if (!devices) return devices.error();
  std::optional<ResumePoint> resume;
  std::string what = "no dwell was complete: begins anew";
  if (contents->last_dwell) {
    if (contents->last_dwell->item >= plan.items.size()) return input_error(path + ": names an item that the plan has not");
    resume = ResumePoint{*contents->last_dwell, devices->rig != nullptr};
    if (devices->rig) {
      if (Status status = devices->rig->put_back(contents->commands, contents->last_dwell->time_s); !status) return status;
    }
    if (devices->rehearsal) {
      if (Status status = devices->rehearsal->pass_until(contents->last_dwell->time_s); !status) return status;
    }
    what = "goes on behind item " + std::to_string(contents->last_dwell->item + 1) + " of " +
           std::to_string(plan.items.size());
  } else {
    std::error_code ignored;
    std::filesystem::remove(folder + "/" + partial_recording_name, ignored);
  }
  if (Status status = check_due(*prepared, devices->devices().clock.utc_s()); !status) return status;
  const JournalFields resumed = {{"software_version", software_version()}, {"what", what},
                                 {"overdue_reason", prepared->request.overdue_reason}};
  if (Status status = journal->append(JournalType::resume, resumed); !status) return status;
  Result<RunLog> log = RunLog::append(folder + "/" + log_name, std::string(tag_of(*prepared)));
  if (!log) return log.error();
  log->line("resumed by turncal " + std::string(software_version()) + ": " + what);
  bool keep = false;
  return told(*prepared, folder, &*log,
              attempt({*prepared, plan, period_s, folder, *journal, *log, resume, contents->sessions + 1}, *devices, context,
                      keep));
}

}  // namespace turncal
