// Describes a run in words: a line for each transition, with station time, on the terminal and in the file run.log.
//
//   2026-01-01T00:12:34Z     754.500 s  step 2/14  moving -> settling  arrived: roll at 360.0000 deg
//
// The log of a dry run has the same bytes every time, since its times are the station's. A terminal shows one line, redrawn at most ten
// times a second of wall time; ETA is the station time left in the plan:
//   step 3/14  moving  pitch 123.45 -> 360.00 deg  34%  run  11%  ETA 1:23:45
// Transitions are printed when the output is not a terminal, or on request. Colours are shown after allow_colour, on a terminal whose user
// has not disabled them (https://no-color.org).
#pragma once

#include <cmath>
#include <functional>
#include <optional>
#include <ostream>
#include <string>
#include <string_view>

#include "calib/types/status.h"
#include "imu_io/base/files.h"
#include "imu_io/base/text.h"
#include "orchestrator/run/run_observer.h"
#include "orchestrator/station/verdict.h"

namespace turncal {

// The results have no line break.
std::string format_transition(const TransitionRecord& record);
std::string format_dropout(const Dropout& dropout);

class RunLog : public RunObserver {
 public:
  // Creates the log; the file must not exist. Every line is handed to the system at once. `tag` begins each line ("[dry run] "), so that no
  // line of a simulation passes for a real one.
  static Result<RunLog> create(const std::string& path, std::string tag);
  static Result<RunLog> append(const std::string& path, std::string tag);  // appends to a log, or creates one

  void line(const std::string& text);
  void on_transition(const TransitionRecord& record) override { line(format_transition(record)); }
  void on_dropout(const Dropout& dropout) override { line(format_dropout(dropout)); }
  // Returns the first failure to write, which the run must not hide.
  const Status& status() const { return status_; }
  Status check_kept() const { return status_ ? file_.check_kept() : status_; }

 private:
  RunLog(PosixFile file, std::string tag) : file_(std::move(file)), tag_(std::move(tag)) {}
  PosixFile file_;
  std::string tag_;
  Status status_;
};

class ProgressPrinter : public RunObserver {
 public:
  // columns: width of the terminal, 0 when it is none.
  // transitions: whether each is printed, too.
  // wall_s: seconds on any steady clock; only used to limit redrawing.
  // takes_more: false while the stream would block; output is then skipped, since the run must not wait for it.
  ProgressPrinter(
      std::ostream& out, int columns, bool transitions, std::function<double()> wall_s,
      std::function<bool()> takes_more = [] { return true; })
      : out_(out),
        columns_(columns),
        transitions_(transitions),
        wall_s_(std::move(wall_s)),
        takes_more_(std::move(takes_more)) {}
  ~ProgressPrinter() override { clear(); }
  void on_transition(const TransitionRecord& record) override;
  void on_dropout(const Dropout& dropout) override;
  void on_progress(const RunSnapshot& snapshot) override;
  void clear();  // removes the live line before other output

 private:
  std::ostream& out_;
  int columns_;
  bool transitions_, line_shown_ = false;
  std::function<double()> wall_s_;
  std::function<bool()> takes_more_;
  double drawn_s_ = -1e9;
};

// Returns the phase in words: "dwell (repeat 1)", "resting after the interruption", "turn pitch to 90.00 deg".
std::string phase_words(const RunSnapshot& snapshot, bool by_hand);
bool waits_for_operator(const RunSnapshot& snapshot, bool by_hand);
std::string format_progress(const RunSnapshot& snapshot);
std::string format_duration(double seconds);  // 1:23:45
std::string clock_time(double seconds);       // likewise; "-" when not finite
double wall_utc_s();                          // seconds since 1970-01-01 UTC
bool stdout_takes_more();                     // false: a pipe nobody reads, a terminal that was stopped

enum class Tone { good, attention, bad };  // green, amber, red
template <>
inline constexpr auto enum_words<Tone> = std::to_array({"good", "attention", "bad"});
Tone tone_of(UnitVerdict verdict);

void allow_colour(std::ostream& out, int descriptor);
std::string in_tone(std::ostream& out, Tone tone, std::string_view text);  // in colour if `out` shows it

// Tells systemd, or whoever set NOTIFY_SOCKET (sd_notify(3)), about a run; without that variable it does nothing. It reports where the run is, and
// every second, while the table may move, that the loop goes on: systemd ends a run that is stuck for watch_s
// (docs/getting-started.md). Nothing is watched while the table rests with its drives off, because an estimate may take minutes.
class ServiceWatch : public RunObserver {
 public:
  static constexpr int watch_s = 30;

  ServiceWatch();
  ~ServiceWatch() override { disarm(); }
  ServiceWatch(const ServiceWatch&) = delete;
  ServiceWatch& operator=(const ServiceWatch&) = delete;
  void on_transition(const TransitionRecord& record) override;
  void on_progress(const RunSnapshot& snapshot) override;

 private:
  void tell(const std::string& what) const;
  void disarm();
  Descriptor socket_;
  bool armed_ = false;
  double last_ping_s_ = -1e9;
};

// Notices that the civil clock was set during a run: it should advance with the monotonic clock, which measures all deadlines. A
// slow correction (NTP slews by 0.05 % at most) is not a step; a suspend is one, because the monotonic clock stood still.
class ClockWatch : public RunObserver {
 public:
  static constexpr double step_s = 1.0;

  // speed_up: station seconds per second of the civil clock. `on_step`: gets the step, + forward, and the next snapshot.
  ClockWatch(double speed_up, std::function<void(double by_s, const RunSnapshot& at)> on_step)
      : speed_up_(speed_up), on_step_(std::move(on_step)) {}
  void on_progress(const RunSnapshot& at) override {
    const double offset_s = at.utc_s - at.time_s / speed_up_;
    if (offset_s_ && std::abs(offset_s - *offset_s_) >= step_s) on_step_(offset_s - *offset_s_, at);
    offset_s_ = offset_s;
  }

 private:
  double speed_up_;
  std::function<void(double, const RunSnapshot&)> on_step_;
  std::optional<double> offset_s_;
};

}  // namespace turncal
