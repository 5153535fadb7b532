#include "orchestrator/jobs/run.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <deque>
#include <thread>

#include "imu_io/base/clock.h"
#include "orchestrator/devices/dry_run_devices.h"
#include "orchestrator/devices/first_step_check.h"
#include "orchestrator/devices/operator_prompts.h"
#include "orchestrator/devices/stop_signals.h"
#include "orchestrator/jobs/enough_watch.h"
#include "orchestrator/run/station_run.h"
#include "orchestrator/station/number_text.h"
#include "orchestrator/watch/progress.h"
#include "orchestrator/watch/status_page.h"
#include "turntable_drivers/table/table_stop.h"

namespace turncal {

namespace {

// Slows virtual time down to `pace` times the wall clock.
class PaceKeeper : public RunObserver {
 public:
  explicit PaceKeeper(double pace) : pace_(pace) {}
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

// Returns the newest results on record, one line each.
std::vector<std::string> last_results(const RunPlan& run) {
  constexpr std::size_t shown = 10;
  std::vector<std::string> lines;
  std::string trouble;
  constexpr int with_those_that_run = 30;
  Result<std::vector<AttemptRecord>> all = recorded_attempts(run.station, {.newest = with_those_that_run}, trouble);
  if (!all) return {all.error().message};
  std::erase_if(*all, [](const AttemptRecord& attempt) { return attempt.outcome == outcome_running; });
  for (std::size_t i = all->size() - std::min(all->size(), shown); i < all->size(); ++i) {
    const AttemptRecord& a = (*all)[i];
    lines.push_back(a.time_utc + "  " + a.unit + "  " + in_words(a.outcome) + (a.simulated ? "  [simulated]" : ""));
  }
  if (!trouble.empty()) lines.push_back(trouble + "; new results are kept here and sent later");
  return lines;
}

// Returns the clock error of every unit, rounded to its accuracy, and stores it in `units`.
std::vector<std::optional<UnitClock>> clocks_of(const LiveDevices& devices, std::vector<RunUnit>& units) {
  std::vector<std::optional<UnitClock>> clocks;
  const auto rounded_ppm = [](double part) { return std::round(1e8 * part) / 100.0; };
  for (std::size_t i = 0; i < units.size(); ++i) {
    if (const auto clock = devices.unit_clock(i))
      units[i].clock = {rounded_ppm(-clock->skew), rounded_ppm(clock->skew_uncertainty)};
    clocks.push_back(units[i].clock);
  }
  return clocks;
}

// Stores how far every unit came, and the facts known before there are results.
void note_outcome(const RunOutcome& outcome, Run& run) {
  for (std::size_t i = 0; i < run.units.size(); ++i) {
    const RunOutcome::Unit& end = outcome.units[i];
    RunUnit& unit = run.units[i];
    unit.recorded_s = double(end.next_sample) * run.sample_period_s();
    unit.repeated_dwells = outcome.repeated_dwells;
    unit.lost_samples = end.lost_samples;
    if (end.dropped_out && !unit.dropped) unit.drop(*end.dropped_out);
  }
}

std::string outcomes_of(const Run& run) {
  std::vector<std::string> outcomes;
  for (const RunUnit& unit : run.units)
    outcomes.push_back((run.units.size() > 1 ? unit.serial + " " : "") + outcome_of(run, unit));
  return join(outcomes);
}

std::vector<std::string> verifications_of(const Run& run) {
  std::vector<std::string> lines;
  for (const RunUnit& unit : run.units)
    if (const std::string& found = unit.verdict.verification; !found.empty())
      lines.push_back((run.units.size() > 1 ? "unit " + unit.serial + ": " : "") + found);
  return lines;
}

Tone tone_of(const RunOutcome& outcome, const Run& run) {
  if (outcome.state == RunState::interrupted) return Tone::attention;
  if (outcome.state != RunState::done) return Tone::bad;
  Tone worst = Tone::good;
  for (const RunUnit& unit : run.units) {
    const UnitVerdict verdict = unit.verdict.verdict;
    const bool failed = !unit.dropped && (!unit.status || !is_accepted(verdict));
    worst = std::max(worst, failed ? Tone::bad : unit.dropped ? Tone::attention : tone_of(verdict));
  }
  return worst;
}

// The displays of a run: terminal and page.
struct RunView {
  RunView(const Run& run, OperatorPrompts* prompts, CommandContext& where)
      : context(where),
        // A line redrawn in place would overwrite the operator's answers.
        in_place(context.out_is_terminal && !prompts),
        progress(
            context.out, in_place ? context.terminal_columns - int(tag_of(run).size()) : 0,
            // A dry run takes seconds, and whoever turns the table has other things to read.
            run.request.session.verbose || !(in_place || run.request.dry_run || prompts || run.request.session.brief),
            monotonic_s, stdout_takes_more),
        live({.unit = join(run.request.units),
              .station = run.station.name,
              .sequence = run.sequence.name + run.request.session.whole,
              .folder = run.folder,
              .simulated = run.simulated(),
              .by_hand = prompts != nullptr,
              .results = last_results(run)},
             monotonic_s),
        asked(prompts) {
    if (!prompts) return;
    const bool screen = context.out_is_terminal && !run.request.session.verbose;
    if (screen && ::isatty(STDIN_FILENO) == 1 && stdout_size().takes_screen()) {
      // Bypasses the stream, whose prefix is for lines.
      const auto write = [&out = context.out](const std::string& text) {
        if (stdout_takes_more() && out.flush()) static_cast<void>(!::write(STDOUT_FILENO, text.data(), text.size()));
      };
      terminal.emplace(std::string(tag_of(run)), write, stdout_size(), wall_utc_s);
    }
    const auto show = [this](const OperatorScreen& now) {
      live.show_operator(now);
      if (terminal) terminal->show(now);
    };
    prompts->show_on(show, !terminal);
  }
  ~RunView() { leave_screen(); }
  RunView(const RunView&) = delete;
  RunView& operator=(const RunView&) = delete;

  Status open_page(const std::string& address) {
    if (address.empty()) return {};
    page = TRY(StatusPage::open(address, live));
    const std::string url = page->server().url();
    context.out << "status page " << url << std::endl;
    if (!page->server().loopback())
      context.err << "warning: everybody who reaches " << url
                  << " can read the status page: it has no access control and is not encrypted" << std::endl;
    return {};
  }
  void show_known(const std::string& line, const std::vector<NeededSigma>& known) {
    progress.clear();
    if (!terminal && stdout_takes_more()) context.out << line << std::endl;
    live.show_known(line, known);
  }
  void leave_screen() {  // later output goes below it
    if (asked) asked->show_on({}, true);
    terminal.reset();
  }
  // resume: the folder to resume; empty: none.
  void end(const Run& run, const RunOutcome& outcome, const std::string& resume) {
    const bool done = outcome.state == RunState::done;
    if (terminal) terminal->show(last_screen(done, resume, asked->texts()));
    leave_screen();
    live.end(done                                     ? "Done: " + outcomes_of(run)
             : outcome.state == RunState::interrupted ? "Paused: " + outcome.error.message
                                                      : "The run is over: " + outcome.error.message,
             tone_of(outcome, run), verifications_of(run));
    if (page) page->say_goodbye();
  }

  CommandContext& context;
  const bool in_place;
  ProgressPrinter progress;
  LiveStatus live;
  OperatorPrompts* asked;                    // null when nobody turns the table
  std::optional<OperatorTerminal> terminal;  // for whoever does, on a terminal large enough
  std::unique_ptr<StatusPage> page;
};

// Logs how table and units were left.
void log_how_left(Run& run, const RunOutcome& outcome, RunDevices& devices, CommandContext& context) {
  if (!devices.live) return;
  if (outcome.left) {
    run.say(how_it_rests(devices.devices().table));
    if (const std::string sag = devices.live->sag_since(outcome.left); !sag.empty()) {
      run.say(sag);
      context.warn(sag);
    }
  }
  for (std::size_t i = 0; i < run.units.size(); ++i)
    run.say("unit " + run.units[i].serial + ": " + devices.live->unit_summary(i));
}

bool can_go_on(const Run& run) {
  const Result<JournalContents> journal = read_journal(run.folder + "/" + journal_name);
  return journal && check_goes_on(run, *journal);
}

// Ends a run that did not reach its end. goes_on: it can be resumed.
RunEnd stopped(Run& run, const RunOutcome& outcome, bool goes_on, CommandContext& context) {
  run.say(outcome.error.message);
  Error whole = outcome.error;
  for (RunUnit& unit : run.units)
    if (unit.dropped)
      whole.message += "; " + unit.status.error().message;
    else
      unit.status = outcome.error;
  const std::string how =
      run.request.session.part ? "the same command continues" : "resume with: turncal " + resuming(run.folder);
  if (goes_on && outcome.state == RunState::interrupted)
    whole.message += "; " + how;
  else if (goes_on)
    context.out << "what is recorded is kept; " << how << std::endl;
  RunEnd end(whole);
  end.moved = outcome.moved;
  end.to_the_end = outcome.error.kind == ErrorKind::unit_failed;  // the unit failed, not the run
  return end;
}

// Reports the outcome on the terminal, on the page and in the log.
RunEnd told(Run& run, const RunOutcome& outcome, RunDevices& devices, RunView& view, double began_s) {
  CommandContext& context = view.context;
  if (outcome.stop_failed && devices.live) devices.live->give_table_up();
  if (outcome.storage_hangs) end_without_storage(outcome.error.message, run.folder, resuming(run.folder), context);
  log_how_left(run, outcome, devices, context);
  view.progress.clear();
  note_outcome(outcome, run);
  for (RunUnit& unit : run.units) unit.ended_utc_s = devices.devices().clock.utc_s();
  const bool done = outcome.state == RunState::done;
  const bool recorded = std::ranges::any_of(run.units, [](const RunUnit& unit) { return unit.recorded_s > 0.0; });
  // A unit that failed with everything recorded cannot be resumed.
  const bool sealed = outcome.error.kind == ErrorKind::unit_failed && run.units.front().recording.has_value();
  const bool goes_on = !done && (outcome.state == RunState::interrupted || recorded) && !sealed && can_go_on(run);
  view.end(run, outcome, goes_on ? run.folder : "");
  if (!done) return stopped(run, outcome, goes_on, context);
  TRY(run.log->status());
  for (const RunUnit& unit : run.units)
    if (const std::string text = not_reached(run, unit); !text.empty()) {
      run.say(text);
      context.out << text << std::endl;
    }
  print_results(run, monotonic_s() - began_s, context.out);
  return {status_of(run), true};
}

void add_chamber(const RunPlan& run, RunDevices& devices) {
  if (!run.temperature_c()) return;
  const ChamberConfig& config = *run.station.chamber;
  if (!devices.live) devices.rig_chamber = std::make_unique<RigChamber>(devices.rig->group, config.described.limits);
  Chamber& chamber = devices.live ? static_cast<Chamber&>(*devices.live->chamber()) : *devices.rig_chamber;
  devices.chamber = std::make_unique<ChamberKeeper>(
      chamber, config, devices.live ? BackgroundQueue::By::thread : BackgroundQueue::By::caller);
}

}  // namespace

Result<RunDevices> make_devices(const RunPlan& run, CommandContext& context) {
  RunDevices devices;
  if (context.quiet && (run.request.rehearsal() || run.station.table.driver == TableDriver::manual))
    return input_error("--quiet: expected none with a table turned by hand: the operator has to be told what to do");
  if (run.request.dry_run) {
    devices.rig = std::make_unique<DryRunDevices>(run.rig, run.request.units.size());
    if (run.request.manual) devices.rig->rehearse(run.station, STDIN_FILENO, context.out);
    devices.prompts = devices.rig->prompts();
  } else {
    devices.live = TRY(LiveDevices::make(run.station, StopSignals::requests(), context.out, run.request.units.size()));
    devices.prompts = devices.live->prompts();
  }
  add_chamber(run, devices);
  return devices;
}

RunEnd record_run(Run& run, RunDevices& devices, CommandContext& context) {
  const double began_s = monotonic_s();
  RunView view(run, devices.prompts, context);
  TRY(view.open_page(run.request.session.listen));
  std::deque<RecordingSink> recordings;
  std::deque<FirstStepCheck> checks;
  std::vector<StationUnit> units;
  for (std::size_t i = 0; i < run.units.size(); ++i) {
    RecordingSink& recording = recordings.emplace_back(run.units[i].folder);
    units.push_back({devices.imu(i), {&recording, &checks.emplace_back()}, run.units[i].serial});
  }
  units.front().sinks.push_back(&view.live);  // the page plots the first unit

  // Declared after all that they write to, so that pending jobs refer to living objects.
  const auto by = devices.live ? BackgroundQueue::By::thread : BackgroundQueue::By::caller;
  BackgroundQueue storage(by), display(by);
  BackgroundObserver log(*run.log, storage), page(view.live, display), progress(view.progress, display);
  PaceKeeper pace(run.request.session.pace);
  ServiceWatch service;
  ClockWatch clock(devices.live ? run.station.clock_speed_up : 1.0, [&](double by_s, const RunSnapshot& at) {
    storage.post([&run, by_s, at] {
      run.say(fmt::format("the clock was set by {:+.3f} s, to {}", by_s, format_utc(at.utc_s)));
      // A journal that cannot be written refuses the next record, too, and that stops the run.
      if (Status kept = run.journal->clock_set(by_s, at); !kept) run.say(kept.error().message);
    });
  });
  EnoughWatch enough(run, recordings, storage, [&](const std::string& line, const KnownSoFar& unit) {
    storage.post([&run, line] { run.say(line); });
    display.post([&view, line, known = unit.sigmas] { view.show_known(line, known); });
  });

  StationHooks hooks;
  hooks.observers = {&log, &page, &pace, &clock, &service};
  if (devices.prompts) hooks.observers.push_back(devices.prompts);
  if (!view.terminal) hooks.observers.push_back(&progress);
  hooks.stop_requests = &StopSignals::requests();
  hooks.pause_requests = &StopSignals::pauses();
  hooks.end_requests = &StopSignals::ends();
  hooks.journal = &*run.journal;
  hooks.check_kept = [&] {
    const Status journal = run.journal->check_kept();
    return journal ? run.log->check_kept() : journal;
  };
  hooks.storage = &storage;
  hooks.content_hashes = [&](const RunOutcome& so_far) {
    if (devices.live) devices.live->end_real_time();
    note_outcome(so_far, run);
    if (devices.live) run.journal->note_clocks(clocks_of(*devices.live, run.units));
    return read_recordings(run);
  };
  hooks.calibrate = [&](const RunOutcome& so_far) {
    note_outcome(so_far, run);
    return make_results(run, devices.devices().clock.utc_s(), view.context);
  };
  if (run.request.until_sigma || settling_allowed_s(run) > 0.0)
    hooks.go_on_with = [&](std::size_t next_item, const RunOutcome& so_far) {
      note_outcome(so_far, run);
      return enough.go_on_with(next_item);
    };
  std::optional<StorageLimit> limit;
  if (!devices.live)
    limit.emplace(
        [&] { return storage.stuck(); },
        [&] { end_without_storage(storage.status().error().message, run.folder, resuming(run.folder), view.context); });
  const StationJob job{run.sequence, run.plan, run.station, run.resume, run.sessions > 1, run.temperature_c()};
  const RunOutcome outcome = StationRun(devices.devices(), job, units, hooks).run();
  display.drain();
  return told(run, outcome, devices, view, began_s);
}

}  // namespace turncal
