// What the operator of a table turned by hand is told above each question: step and its title, how far the run is, what is left of it.
//
// What is left: the dwells and rests of the plan, and for each turn the mean of what a turn has taken so far beyond its planned time;
// before the first turn, first_turn_s. Civil time of the end by the station's clock.
#pragma once

#include "orchestrator/run/run_observer.h"
#include "sequences/sequence.h"
#include "turntable_drivers/manual/manual_turntable.h"

namespace turncal {

class OperatorPrompts : public RunObserver {
 public:
  // Both must outlive this.
  OperatorPrompts(ManualTurntable& table, const Sequence& sequence, double first_turn_s)
      : table_(table), sequence_(sequence), first_turn_s_(first_turn_s) {}
  void on_transition(const TransitionRecord& record) override;
  void on_progress(const RunSnapshot&) override {}

 private:
  ManualTurntable& table_;
  const Sequence& sequence_;
  double first_turn_s_;
  bool turning_ = false;
  double began_s_ = 0.0, planned_left_s_ = 0.0;  // when the turn going on was asked for
  double beyond_plan_s_ = 0.0;                   // sum over the turns done
  int turns_done_ = 0;
};

}  // namespace turncal
