// Prompts for the operator of a table turned by hand: above each question the step, the progress and the time left;
// during a measurement how long to keep the hands off; all of it also as a screen, for a caller that shows one.
//
// Time left: the dwells and rests of the plan, and for each turn the mean time that turns have taken beyond the plan so far;
// before the first turn, first_turn_s. A rehearsal has no time left, because its clock stands while somebody thinks.
#pragma once

#include <functional>
#include <optional>
#include <ostream>
#include <string>

#include "calib/types/status.h"
#include "orchestrator/run/run_observer.h"
#include "orchestrator/station/station_config.h"
#include "orchestrator/watch/operator_screen.h"
#include "turntable_drivers/manual/manual_turntable.h"

namespace turncal {

class OperatorPrompts : public RunObserver {
 public:
  // The table must outlive this object.
  explicit OperatorPrompts(ManualTurntable& table, double first_turn_s = 0.0)
      : table_(table), first_turn_s_(first_turn_s) {}
  ~OperatorPrompts() override { show_on({}, true); }
  OperatorPrompts(const OperatorPrompts&) = delete;
  OperatorPrompts& operator=(const OperatorPrompts&) = delete;
  // lines: whether the table prints its questions, too.
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
  double began_s_ = 0.0, planned_left_s_ = 0.0;  // at the request for the present turn
  double beyond_plan_s_ = 0.0;                   // summed over the turns done
  int turns_done_ = 0;
  RunSnapshot at_;
  bool pause_comes_ = false, measured_ = false;
  std::function<void(const OperatorScreen&)> show_;
};

// Has a unit of a live batch mounted, by a person or by a hook.
//
//   hook.mount is set       it is run (orchestrator/station/child_program.h: TURNCAL_EVENT = mount) for at most hook.mount_time_s; code 0: mounted
//   input is a terminal     the operator is asked: Enter when it is mounted, `skip REASON`, `quit`; not of a unit that stays on the table
//   neither                 hook.needs_operator is called, and the batch ends
//
// Anything but "mounted" or "skipped" is an error of kind interrupted that says what to do: the same command goes on with the unit.
// A dry run mounts nothing and asks nothing, because its hook could move something real.
struct Mounted {
  std::optional<std::string> skipped;  // the reason
};

// call: `mount` of the unit. stays: it is on the table still, as the message says. `input`: file descriptor of the answers. A request to stop
// (stop_signals.h) ends the wait.
Result<Mounted> mount_unit(const StationConfig& station, const HookCall& call, bool stays, int input, std::ostream& out,
                           const std::string& tag);
// hook.needs_operator of the same unit; why it cannot be called is printed.
void call_operator(const HookCommands& hooks, HookCall call, const Error& why, std::ostream& out,
                   const std::string& tag);

}  // namespace turncal
