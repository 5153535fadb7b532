// What the operator sees of a run.
//
// On a terminal: one line, redrawn in place at most ten times a second of wall time,
//   step 3/14  moving  pitch 123.45 -> 360.00 deg  34%  run  11%  ETA 1:23:45
// where ETA is station time that the plan says is left. Elsewhere, and where they are asked for: one timestamped line a transition
// (run_log.h). Without those: what a pause that was asked for waits for.
#pragma once

#include <functional>
#include <ostream>
#include <string>

#include "orchestrator/run/run_observer.h"

namespace turncal {

class ProgressPrinter : public RunObserver {
 public:
  // columns: width of the terminal, 0 when it is none.
  // transitions: whether each is printed, too.
  // wall_s: seconds on any steady clock; only used to limit redrawing.
  // takes_more: false while the stream would block; what is shown then is left out, since the run may not wait for it.
  ProgressPrinter(
      std::ostream& out, int columns, bool transitions, std::function<double()> wall_s,
      std::function<bool()> takes_more = [] { return true; });
  ~ProgressPrinter() override { clear(); }
  void on_transition(const TransitionRecord& record) override;
  void on_dropout(const Dropout& dropout) override;
  void on_progress(const RunSnapshot& snapshot) override;
  void clear();  // takes the live line away before something else is printed

 private:
  std::ostream& out_;
  int columns_;
  bool transitions_;
  bool line_shown_ = false;
  std::function<double()> wall_s_;
  std::function<bool()> takes_more_;
  double drawn_s_ = -1e9;
};

// The phase as it is for a person: "dwell (repeat 1)", "resting after the interruption", "turn pitch to 90.00 deg".
std::string phase_words(const RunSnapshot& snapshot, bool by_hand);
bool waits_for_operator(const RunSnapshot& snapshot, bool by_hand);
std::string format_progress(const RunSnapshot& snapshot);
std::string format_duration(double seconds);  // 1:23:45
double wall_utc_s();                          // seconds since 1970-01-01 UTC
bool stdout_takes_more();                     // false: a pipe nobody reads, a terminal that was stopped

}  // namespace turncal
