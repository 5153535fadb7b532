#include "orchestrator/devices/operator_prompts.h"

#include <algorithm>
#include <cmath>

#include "imu_io/base/clock.h"
#include "orchestrator/watch/progress.h"

namespace turncal {

void OperatorPrompts::on_transition(const TransitionRecord& record) {
  const RunSnapshot& at = record.at;
  if (record.event == RunEvent::settled && record.from == RunState::settling) {
    // Settling without a turn comes after a rest and after a dwell that is repeated.
    if (turning_) {
      beyond_plan_s_ += std::max(0.0, (at.time_s - began_s_) - (planned_left_s_ - at.eta_s));
      ++turns_done_;
    }
    turning_ = false;
  }
  if (record.event == RunEvent::connected) return table_.set_reason("First, where the table stands.");
  if (record.event != RunEvent::move_next) return;
  turning_ = true;
  began_s_ = at.time_s;
  planned_left_s_ = at.eta_s;
  const double a_turn_s = turns_done_ > 0 ? beyond_plan_s_ / turns_done_ : first_turn_s_;
  const double left_s = at.eta_s + a_turn_s * static_cast<double>(at.moves_left);
  table_.set_reason("Step " + std::to_string(at.step_place) + " of " + std::to_string(at.step_count) + ", " +
                    sequence_.steps[at.step_place - 1].title + ": " +
                    std::to_string(std::lround(std::floor(100.0 * at.run_fraction))) + " % done, " +
                    std::to_string(at.moves_left) + " turns and about " + format_duration(left_s) + " left, until " +
                    format_utc(at.utc_s + left_s) + ".");
}

}  // namespace turncal
