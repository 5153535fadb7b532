#include "orchestrator/jobs/run_attempt.h"

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <deque>
#include <thread>

#include "imu_io/base/clock.h"
#include "orchestrator/devices/first_step_check.h"
#include "orchestrator/devices/operator_view.h"
#include "orchestrator/devices/stop_signals.h"
#include "orchestrator/figures/report_format.h"
#include "orchestrator/jobs/command_context.h"
#include "orchestrator/jobs/enough_watch.h"
#include "orchestrator/jobs/run_results.h"
#include "orchestrator/records/recording_sink.h"
#include "orchestrator/records/station_records.h"
#include "orchestrator/run/station_run.h"
#include "orchestrator/watch/live_status.h"
#include "orchestrator/watch/progress.h"
#include "orchestrator/watch/service_watch.h"
#include "orchestrator/watch/status_page.h"
#include "turntable_drivers/table/table_stop.h"

namespace turncal {

namespace {

// Feeds the run's log and what the operator sees from the same events.
class Fanout : public RunObserver {
 public:
  explicit Fanout(std::vector<RunObserver*> observers) : observers_(std::move(observers)) {}
  void on_transition(const TransitionRecord& record) override {
    for (RunObserver* observer : observers_) observer->on_transition(record);
  }
  void on_dropout(const Dropout& dropout) override {
    for (RunObserver* observer : observers_) observer->on_dropout(dropout);
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
    if (!began_s_) began_s_ = monotonic_s() - snapshot.time_s / pace_;
    const double ahead_s = snapshot.time_s / pace_ - (monotonic_s() - *began_s_);
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
  std::string trouble;
  constexpr int with_those_that_run = 30;
  Result<std::vector<AttemptRecord>> all = recorded_attempts(run.station, {.newest = with_those_that_run}, trouble);
  if (!all) return {all.error().message};
  std::erase_if(*all, [](const AttemptRecord& attempt) { return attempt.outcome == outcome_running; });
  for (std::size_t i = all->size() - std::min(all->size(), shown); i < all->size(); ++i) {
    const AttemptRecord& a = (*all)[i];
    lines.push_back(a.time_utc + "  " + a.unit + "  " + a.outcome + (a.simulated ? "  [simulated]" : ""));
  }
  if (!trouble.empty()) lines.push_back(trouble + "; new results are kept here and sent later");
  return lines;
}

std::string outcomes_of(const std::vector<UnitRun>& units) {
  std::string text;
  for (const UnitRun& unit : units)
    text += (text.empty() ? "" : ", ") + (units.size() > 1 ? unit.run.unit() + " " : "") + outcome_of(unit);
  return text;
}

std::vector<std::string> verifications_of(const std::vector<UnitRun>& units) {
  std::vector<std::string> lines;
  for (const UnitRun& unit : units)
    if (const std::string& found = unit.results.verdict.verification; !found.empty())
      lines.push_back((units.size() > 1 ? "unit " + unit.run.unit() + ": " : "") + found);
  return lines;
}

Tone tone_of(const RunOutcome& outcome, const std::vector<UnitRun>& units) {
  if (outcome.state == RunState::interrupted) return Tone::attention;
  if (outcome.state != RunState::done) return Tone::bad;
  Tone worst = Tone::good;
  for (const UnitRun& unit : units) {
    const UnitVerdict verdict = unit.results.verdict.verdict;
    const bool failed = !unit.dropped && (!unit.status || !is_accepted(verdict));
    worst = std::max(worst, failed ? Tone::bad : unit.dropped ? Tone::attention : tone_of(verdict));
  }
  return worst;
}

// Of every unit, rounded to what can be known; kept with its counts, too.
std::vector<std::optional<UnitClock>> clocks_of(const LiveDevices& devices, std::vector<UnitRun>& units) {
  std::vector<std::optional<UnitClock>> clocks;
  for (std::size_t i = 0; i < units.size(); ++i) {
    clocks.emplace_back();
    if (const auto clock = devices.unit_clock(i)) {
      const auto rounded_ppm = [](double part) { return std::round(1e8 * part) / 100.0; };
      clocks.back() = {rounded_ppm(-clock->skew), rounded_ppm(clock->skew_uncertainty)};
    }
    units[i].counts.clock = clocks.back();
  }
  return clocks;
}

// How far every unit came, and what is known of it before there are results.
void note_outcome(const RunOutcome& outcome, double sample_period_s, std::vector<UnitRun>& units) {
  for (std::size_t i = 0; i < units.size(); ++i) {
    const RunOutcome::Unit& end = outcome.units[i];
    UnitRun& unit = units[i];
    unit.counts.recorded_s = static_cast<double>(end.recorded_samples) * sample_period_s;
    unit.counts.repeated_dwells = outcome.repeated_dwells;
    unit.counts.lost_samples = end.lost_samples;
    if (!end.dropped_out || unit.dropped) continue;
    unit.dropped = true;
    unit.status =
        Error{end.dropped_out->kind, "unit " + unit.run.unit() + " dropped out at " + end.dropped_out->message};
  }
}

}  // namespace

Result<RunDevices> make_devices(const PreparedRun& run, CommandContext& context) {
  RunDevices run_devices;
  if (context.quiet && (run.request.rehearsal() || run.station.table.driver == TableDriver::manual))
    return input_error("--quiet: a table that is turned by hand needs an operator who is told what to do");
  if (run.request.rehearsal()) {
    run_devices.rehearsal = std::make_unique<RehearsalDevices>(run.rig, run.station, STDIN_FILENO, context.out);
    run_devices.prompts = &run_devices.rehearsal->prompts();
    return run_devices;
  }
  if (run.request.dry_run) {
    run_devices.rig = std::make_unique<DryRunDevices>(run.rig, run.request.units.size());
    return run_devices;
  }
  std::unique_ptr<LiveDevices> live =
      TRY(LiveDevices::make(run.station, StopSignals::requests(), context.out, run.request.units.size()));
  run_devices.live = std::move(live);
  run_devices.prompts = run_devices.live->prompts();
  return run_devices;
}

// A disk that hangs for good would hold up whoever waits for its thread: the table was left, so the program says so and ends at once.
[[noreturn]] void end_without_storage(const Error& error, const std::string& folder, CommandContext& context) {
  context.err << context.tag << "turncal: " << error.message << "; nothing more could be written to " << folder
              << ", and the program ends without waiting for it; when the disk answers again: turncal resume " << folder
              << std::endl;
  std::_Exit(exit_code(ErrorKind::device));
}

// One attempt with the devices, up to the verdicts.
RunEnd attempt(const Attempt& a, RunDevices& run_devices, CommandContext& context) {
  const StationDevices devices = run_devices.devices();
  const double began_s = monotonic_s();
  // A line redrawn in place would run over the operator's answers.
  const bool in_place = context.out_is_terminal && !run_devices.prompts;
  const int columns = context.terminal_columns - static_cast<int>(tag_of(a.run).size());
  // A dry run is over in seconds; whoever turns the table has other things to read.
  const bool transitions = a.run.request.verbose || !(in_place || a.run.request.dry_run || run_devices.prompts);
  ProgressPrinter progress(context.out, in_place ? columns : 0, transitions, monotonic_s, stdout_takes_more);
  LiveStatus live({.unit = join(a.run.request.units),
                   .station = a.run.station.name,
                   .sequence = a.run.sequence.name,
                   .folder = a.folder,
                   .simulated = a.run.simulated(),
                   .by_hand = run_devices.prompts != nullptr,
                   .results = last_results(a.run)},
                  monotonic_s);
  OperatorView operator_view(run_devices.prompts, live, context.out, tag_of(a.run),
                             context.out_is_terminal && !a.run.request.verbose);
  std::unique_ptr<StatusPage> page;
  if (!a.run.request.listen.empty()) {
    std::unique_ptr<StatusPage> opened = TRY(StatusPage::open(a.run.request.listen, live));
    page = std::move(opened);
    context.out << "status page " << page->url() << std::endl;
    if (const std::string warning = page->warning(); !warning.empty()) context.err << warning << std::endl;
  }
  PaceKeeper pace(a.run.request.pace);
  std::deque<RecordingSink> recordings;
  for (UnitRun& unit : a.units) {
    recordings.emplace_back(unit.folder);
    unit.counts.sessions = a.sessions;
  }
  std::deque<FirstStepCheck> checks;
  for (RecordingSink& recording : recordings) checks.emplace_back(recording);
  LiveSink shown(checks.front(), live);  // the page plots the first unit
  std::vector<StationUnit> lanes;
  for (std::size_t i = 0; i < a.units.size(); ++i) {
    RunSink& sink = i == 0 ? static_cast<RunSink&>(shown) : checks[i];
    lanes.push_back({run_devices.imu(i), sink, a.units[i].run.unit()});
  }
  const StopSignals signals(FirstInterrupt::pauses);
  // What the loop hands out is written and shown beside it; of a simulation whose time stands still meanwhile, within it.
  const BackgroundQueue::By by = run_devices.live ? BackgroundQueue::By::thread : BackgroundQueue::By::caller;
  BackgroundQueue storage(by), display(by);
  ClockWatch clock(run_devices.live ? a.run.station.clock_speed_up : 1.0, [&](double by_s, const RunSnapshot& at) {
    storage.post([&a, by_s, at] {
      char text[80];
      std::snprintf(text, sizeof text, "the clock was set by %+.3f s, to ", by_s);
      a.log.line(text + format_utc(at.utc_s));
      // A journal that cannot be written refuses the next record, too, and that stops the run.
      if (Status kept = a.journal.clock_set(by_s, at); !kept) a.log.line(kept.error().message);
    });
  });
  ServiceWatch service;
  BackgroundObserver log(a.log, storage), shown_live(live, display), shown_progress(progress, display);
  std::vector<RunObserver*> all{&log, &shown_live, &pace, &clock, &service};
  if (run_devices.prompts) all.push_back(run_devices.prompts);
  if (!operator_view.on_terminal()) all.push_back(&shown_progress);
  Fanout observers(all);
  StationRun* running = nullptr;
  const auto content_hashes = [&] {
    if (run_devices.live) run_devices.live->end_real_time();
    note_outcome(running->outcome(), a.sample_period_s, a.units);
    if (run_devices.live) a.journal.note_clocks(clocks_of(*run_devices.live, a.units));
    return read_recordings(a.units);
  };
  const auto calibrate = [&]() -> Status {
    note_outcome(running->outcome(), a.sample_period_s, a.units);
    return calibrate_units(a.units, devices.clock.utc_s(), a.journal);
  };
  EnoughWatch enough(a.run, a.plan, a.units, recordings, a.journal, storage,
                     [&](const std::string& line, const KnownSoFar& unit) {
                       storage.post([&a, line] { a.log.line(line); });
                       std::vector<LiveStatus::Known> bars;
                       for (const NeededSigma& one : unit.sigmas)
                         bars.push_back({std::string(parameter_keys[one.parameter]), one.sigma, one.needed});
                       display.post([&, line, bars = std::move(bars)] {
                         progress.clear();
                         if (!operator_view.on_terminal() && stdout_takes_more()) context.out << line << std::endl;
                         live.show_known(line, bars);
                       });
                     });
  const auto go_on_with = [&](std::size_t next_item) {
    note_outcome(running->outcome(), a.sample_period_s, a.units);
    return enough.go_on_with(next_item);
  };
  StationRun run(devices, {a.run.sequence, a.plan, a.run.station, a.units.front().run.unit(), a.resume, a.sessions > 1},
                 lanes,
                 {.observer = &observers,
                  .stop_requests = &StopSignals::requests(),
                  .calibrate = calibrate,
                  .journal = &a.journal,
                  .pause_requests = &StopSignals::pauses(),
                  .end_requests = &StopSignals::ends(),
                  .content_hashes = content_hashes,
                  .go_on_with = a.run.request.until_sigma ? decltype(StationHooks::go_on_with)(go_on_with) : nullptr,
                  .storage = &storage});
  running = &run;
  const RunOutcome outcome = run.run();
  display.drain();
  if (outcome.stop_failed && run_devices.live) run_devices.live->give_table_up();
  if (outcome.storage_hangs) end_without_storage(outcome.error, a.folder, context);
  if (run_devices.live && outcome.left) a.log.line(how_it_rests(devices.table));
  if (const std::string sag = run_devices.live && outcome.left ? run_devices.live->sag_since(outcome.left) : "";
      !sag.empty()) {
    a.log.line(sag);
    context.warn(sag);
  }
  for (std::size_t i = 0; run_devices.live && i < a.units.size(); ++i) {
    a.log.line("unit " + a.units[i].run.unit() + ": " + run_devices.live->unit_summary(i));
  }
  progress.clear();
  note_outcome(outcome, a.sample_period_s, a.units);
  for (UnitRun& unit : a.units) unit.counts.ended_utc_s = devices.clock.utc_s();
  const bool done = outcome.state == RunState::done, interrupted = outcome.state == RunState::interrupted;
  const bool recorded =
      std::any_of(a.units.begin(), a.units.end(), [](const UnitRun& unit) { return unit.counts.recorded_s > 0.0; });
  // Of no use to whoever resumes: a folder that was taken away, a unit of which all is recorded.
  const bool sealed = outcome.error.kind == ErrorKind::unit_failed && a.units.front().recording.has_value();
  const bool goes_on = !done && (interrupted || recorded) && path_exists(a.folder + "/" + journal_name) && !sealed;
  operator_view.end(done, goes_on ? a.folder : "");
  live.end(done          ? "Done: " + outcomes_of(a.units)
           : interrupted ? "Paused: " + outcome.error.message
                         : "The run is over: " + outcome.error.message,
           tone_of(outcome, a.units), verifications_of(a.units));
  if (page) page->say_goodbye();
  if (!done) {
    a.log.line(outcome.error.message);
    Error whole = outcome.error;
    for (UnitRun& unit : a.units) {
      if (unit.dropped)
        whole.message += "; " + unit.status.error().message;
      else
        unit.status = outcome.error;
    }
    RunEnd end(outcome.error);
    end.moved = outcome.moved;
    end.to_the_end = outcome.error.kind == ErrorKind::unit_failed;  // what failed is the unit
    if (goes_on && interrupted) {
      whole.message += "; go on with: turncal resume " + a.folder;
    } else if (goes_on) {
      context.out << "what is recorded is kept; go on with: turncal resume " << a.folder << std::endl;
    }
    end.status = whole;
    return end;
  }
  if (!a.log.status()) return a.log.status();
  for (const UnitRun& unit : a.units) {
    if (!unit.dropped && !unit.status) a.log.line("unit " + unit.run.unit() + ": " + unit.status.error().message);
  }
  for (const UnitRun& unit : a.units)
    if (const std::string text = not_reached(unit); !text.empty()) {
      a.log.line(text);
      context.out << text << std::endl;
    }
  conclude_units(a.units, monotonic_s() - began_s, a.folder + "/" + log_name, context.out);
  RunEnd end(status_of(a.units));
  end.to_the_end = true;
  return end;
}

}  // namespace turncal
