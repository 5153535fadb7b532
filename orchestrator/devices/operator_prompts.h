// What the operator of a table turned by hand is told: above each question the step, how far the run is, what is left of it;
// while the unit is measured how long to keep the hands off; all of it as a screen to whoever shows one.
//
// What is left: the dwells and rests of the plan, and for each turn the mean of what a turn has taken so far beyond its planned time;
// before the first turn, first_turn_s. No time of a rehearsal, whose clock stands while somebody thinks.
#pragma once

#include <functional>

#include "orchestrator/run/run_observer.h"
#include "orchestrator/watch/operator_screen.h"
#include "turntable_drivers/manual/manual_turntable.h"

namespace turncal {

class OperatorPrompts : public RunObserver {
 public:
  // The table must outlive this.
  explicit OperatorPrompts(ManualTurntable& table, double first_turn_s = 0.0)
      : table_(table), first_turn_s_(first_turn_s) {}
  ~OperatorPrompts() override { show_on({}, true); }
  OperatorPrompts(const OperatorPrompts&) = delete;
  OperatorPrompts& operator=(const OperatorPrompts&) = delete;
  // lines: the table prints its questions, too.
  void show_on(std::function<void(const OperatorScreen&)> show, bool lines);
  const OperatorTexts& texts() const { return table_.texts(); }
  void on_transition(const TransitionRecord& record) override;
  void on_progress(const RunSnapshot& at) override;

 private:
  void show();
  std::optional<double> left_s(const RunSnapshot& at) const;
  ManualTurntable& table_;
  double first_turn_s_;
  bool turning_ = false;
  double began_s_ = 0.0, planned_left_s_ = 0.0;  // when the turn going on was asked for
  double beyond_plan_s_ = 0.0;                   // sum over the turns done
  int turns_done_ = 0;
  RunSnapshot at_;
  bool pause_comes_ = false, measured_ = false;
  std::function<void(const OperatorScreen&)> show_;
};

}  // namespace turncal
