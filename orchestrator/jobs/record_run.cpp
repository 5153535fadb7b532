#include "orchestrator/jobs/run.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <deque>
#include <thread>

#include "imu_io/base/clock.h"
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

// Holds virtual time back to `pace` times the wall clock.
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

// The newest results on record, one line each.
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

// Of every unit, rounded to what can be known; kept with it, too.
std::vector<std::optional<UnitClock>> clocks_of(const LiveDevices& devices, std::vector<RunUnit>& units) {
  std::vector<std::optional<UnitClock>> clocks;
  for (std::size_t i = 0; i < units.size(); ++i) {
    clocks.emplace_back();
    if (const auto clock = devices.unit_clock(i)) {
      const auto rounded_ppm = [](double part) { return std::round(1e8 * part) / 100.0; };
      clocks.back() = {rounded_ppm(-clock->skew), rounded_ppm(clock->skew_uncertainty)};
    }
    units[i].clock = clocks.back();
  }
  return clocks;
}

// How far every unit came, and what is known of it before there are results.
void note_outcome(const RunOutcome& outcome, Run& run) {
  for (std::size_t i = 0; i < run.units.size(); ++i) {
    const RunOutcome::Unit& end = outcome.units[i];
    RunUnit& unit = run.units[i];
    unit.recorded_s = double(end.recorded_samples) * run.sample_period_s();
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

// What is seen of a run while it goes on, at the terminal and on the page.
struct RunView {
  RunView(const Run& run, OperatorPrompts* prompts, CommandContext& where)
      : context(where),
        // A line redrawn in place would run over the operator's answers.
        in_place(context.out_is_terminal && !prompts),
        progress(
            context.out, in_place ? context.terminal_columns - int(tag_of(run).size()) : 0,
            // A dry run is over in seconds; whoever turns the table has other things to read.
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
      // Past the stream: its prefix belongs to lines.
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
    context.out << "status page " << page->url() << std::endl;
    if (const std::string warning = page->warning(); !warning.empty()) context.err << warning << std::endl;
    return {};
  }
  void show_known(const std::string& line, const std::vector<NeededSigma>& known) {
    progress.clear();
    if (!terminal && stdout_takes_more()) context.out << line << std::endl;
    live.show_known(line, known);
  }
  void leave_screen() {  // what is printed next stands below
    if (asked) asked->show_on({}, true);
    terminal.reset();
  }
  // resume: the folder to go on with; empty: none.
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
  OperatorPrompts* asked;                    // null: nobody turns the table
  std::optional<OperatorTerminal> terminal;  // of whoever does, where it takes a screen
  std::unique_ptr<StatusPage> page;
};

// Walks through the plan, with all that listens to the walk. What the loop hands out is written and shown beside it; of a simulation, whose
// time stands still meanwhile, within it.
class Recorder {
 public:
  Recorder(Run& run, RunDevices& devices, RunView& view)
      : run_(run),
        devices_(devices),
        view_(view),
        storage_(devices.live ? BackgroundQueue::By::thread : BackgroundQueue::By::caller),
        display_(devices.live ? BackgroundQueue::By::thread : BackgroundQueue::By::caller),
        clock_(devices.live ? run.station.clock_speed_up : 1.0,
               [this](double by_s, const RunSnapshot& at) { note_clock(by_s, at); }),
        enough_(run, recordings_, storage_,
                [this](const std::string& line, const KnownSoFar& unit) { tell_known(line, unit); }),
        station_(devices.devices(),
                 {run.sequence, run.plan, run.station, run.units.front().serial, run.resume, run.sessions > 1,
                  run.temperature_c()},
                 make_lanes(), hooks()) {}

  RunOutcome walk() {
    std::optional<StorageLimit> limit;
    if (!devices_.live)
      limit.emplace([this] { return storage_.stuck(); },
                    [this] {
                      end_without_storage(storage_.status().error().message, run_.folder, "resume " + run_.folder,
                                          view_.context);
                    });
    const RunOutcome outcome = station_.run();
    display_.drain();
    return outcome;
  }

 private:
  std::vector<StationUnit> make_lanes() {
    for (const RunUnit& unit : run_.units) recordings_.emplace_back(unit.folder);
    for (RecordingSink& recording : recordings_) checks_.emplace_back(recording);
    shown_.emplace(checks_.front(), view_.live);  // the page plots the first unit
    std::vector<StationUnit> lanes;
    for (std::size_t i = 0; i < run_.units.size(); ++i) {
      RunSink& sink = i == 0 ? static_cast<RunSink&>(*shown_) : checks_[i];
      lanes.push_back({devices_.imu(i), sink, run_.units[i].serial});
    }
    return lanes;
  }

  StationHooks hooks() {
    StationHooks hooks;
    hooks.observers = {&log_, &shown_live_, &pace_, &clock_, &service_};
    if (devices_.prompts) hooks.observers.push_back(devices_.prompts);
    if (!view_.terminal) hooks.observers.push_back(&shown_progress_);
    hooks.stop_requests = &StopSignals::requests();
    hooks.pause_requests = &StopSignals::pauses();
    hooks.end_requests = &StopSignals::ends();
    hooks.journal = &*run_.journal;
    hooks.check_kept = [this] {
      const Status journal = run_.journal->check_kept();
      return journal ? run_.log->check_kept() : journal;
    };
    hooks.storage = &storage_;
    hooks.content_hashes = [this] { return content_hashes(); };
    hooks.calibrate = [this] {
      note_outcome(station_.outcome(), run_);
      return make_results(run_, devices_.devices().clock.utc_s(), view_.context);
    };
    if (run_.request.until_sigma || settling_allowed_s(run_) > 0.0)
      hooks.go_on_with = [this](std::size_t next_item) {
        note_outcome(station_.outcome(), run_);
        return enough_.go_on_with(next_item);
      };
    return hooks;
  }

  Result<std::vector<std::string>> content_hashes() {
    if (devices_.live) devices_.live->end_real_time();
    note_outcome(station_.outcome(), run_);
    if (devices_.live) run_.journal->note_clocks(clocks_of(*devices_.live, run_.units));
    return read_recordings(run_);
  }

  void note_clock(double by_s, const RunSnapshot& at) {
    storage_.post([this, by_s, at] {
      run_.say(fmt::format("the clock was set by {:+.3f} s, to {}", by_s, format_utc(at.utc_s)));
      // A journal that cannot be written refuses the next record, too, and that stops the run.
      if (Status kept = run_.journal->clock_set(by_s, at); !kept) run_.say(kept.error().message);
    });
  }

  void tell_known(const std::string& line, const KnownSoFar& unit) {
    storage_.post([this, line] { run_.say(line); });
    display_.post([this, line, known = unit.sigmas] { view_.show_known(line, known); });
  }

  // In the order of construction: what a queue still does is of things that outlive it.
  Run& run_;
  RunDevices& devices_;
  RunView& view_;
  PaceKeeper pace_{run_.request.session.pace};
  std::deque<RecordingSink> recordings_;
  std::deque<FirstStepCheck> checks_;
  std::optional<LiveSink> shown_;
  const StopSignals signals_{FirstInterrupt::pauses};
  BackgroundQueue storage_, display_;
  ClockWatch clock_;
  ServiceWatch service_;
  BackgroundObserver log_{*run_.log, storage_}, shown_live_{view_.live, display_},
      shown_progress_{view_.progress, display_};
  EnoughWatch enough_;
  StationRun station_;
};

// How table and units were left, for the log.
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

// A run that did not come to its end. goes_on: it can be taken up.
RunEnd stopped(Run& run, const RunOutcome& outcome, bool goes_on, CommandContext& context) {
  run.say(outcome.error.message);
  Error whole = outcome.error;
  for (RunUnit& unit : run.units) {
    if (unit.dropped)
      whole.message += "; " + unit.status.error().message;
    else
      unit.status = outcome.error;
  }
  if (goes_on && outcome.state == RunState::interrupted)
    whole.message += "; resume with: turncal resume " + run.folder;
  else if (goes_on)
    context.out << "what is recorded is kept; resume with: turncal resume " << run.folder << std::endl;
  RunEnd end(whole);
  end.moved = outcome.moved;
  end.to_the_end = outcome.error.kind == ErrorKind::unit_failed;  // what failed is the unit
  return end;
}

void add_chamber(const RunPlan& run, RunDevices& devices) {
  if (!run.temperature_c()) return;
  const ChamberConfig& config = *run.station.chamber;
  if (!devices.live) {
    RigGroup& group = devices.rig ? devices.rig->group : devices.rehearsal->group();
    devices.rig_chamber = std::make_unique<RigChamber>(group, config.described.limits);
  }
  Chamber& chamber = devices.live ? static_cast<Chamber&>(*devices.live->chamber()) : *devices.rig_chamber;
  devices.chamber = std::make_unique<ChamberKeeper>(
      chamber, config, devices.live ? BackgroundQueue::By::thread : BackgroundQueue::By::caller);
}

}  // namespace

Result<RunDevices> make_devices(const RunPlan& run, CommandContext& context) {
  RunDevices devices;
  if (context.quiet && (run.request.rehearsal() || run.station.table.driver == TableDriver::manual))
    return input_error("--quiet: expected none with a table turned by hand: the operator has to be told what to do");
  if (run.request.rehearsal()) {
    devices.rehearsal = std::make_unique<RehearsalDevices>(run.rig, run.station, STDIN_FILENO, context.out);
    devices.prompts = &devices.rehearsal->prompts();
  } else if (run.request.dry_run) {
    devices.rig = std::make_unique<DryRunDevices>(run.rig, run.request.units.size());
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
  Recorder recorder(run, devices, view);
  const RunOutcome outcome = recorder.walk();
  if (outcome.stop_failed && devices.live) devices.live->give_table_up();
  if (outcome.storage_hangs) end_without_storage(outcome.error.message, run.folder, "resume " + run.folder, context);
  log_how_left(run, outcome, devices, context);
  view.progress.clear();
  note_outcome(outcome, run);
  for (RunUnit& unit : run.units) unit.ended_utc_s = devices.devices().clock.utc_s();
  const bool done = outcome.state == RunState::done;
  const bool recorded = std::ranges::any_of(run.units, [](const RunUnit& unit) { return unit.recorded_s > 0.0; });
  // Of no use to whoever resumes: a unit of which all is recorded.
  const bool sealed = outcome.error.kind == ErrorKind::unit_failed && run.units.front().recording.has_value();
  const bool goes_on = !done && (outcome.state == RunState::interrupted || recorded) && !sealed && can_go_on(run);
  view.end(run, outcome, goes_on ? run.folder : "");
  if (!done) return stopped(run, outcome, goes_on, context);
  TRY(run.log->status());
  for (const RunUnit& unit : run.units)
    if (!unit.dropped && !unit.status) run.say("unit " + unit.serial + ": " + unit.status.error().message);
  for (const RunUnit& unit : run.units)
    if (const std::string text = not_reached(run, unit); !text.empty()) {
      run.say(text);
      context.out << text << std::endl;
    }
  print_results(run, monotonic_s() - began_s, context.out);
  return {status_of(run), true};
}

}  // namespace turncal
