#include "orchestrator/run/run_state_machine.h"

#include "imu_io/base/clock.h"
#include "orchestrator/run/run_observer.h"

namespace turncal {

namespace {

constexpr std::array<std::string_view, run_state_count> state_names = {
    "idle",      "connecting", "homing",      "resting",  "selecting", "moving", "settling", "dwelling",
    "step_done", "parking",    "calibrating", "stopping", "done",      "failed", "aborted",  "interrupted"};

constexpr std::array<std::string_view, run_event_count> event_names = {
    "start",          "connected",      "connect_failed",     "homed",
    "rest_over",      "back_in_place",  "move_next",          "dwell_next",
    "step_complete",  "step_next",      "sequence_complete",  "arrived",
    "unsettled",      "settled",        "dwell_complete",     "dwell_bad",
    "move_bad",       "calibration_ok", "calibration_failed", "stopped_verified",
    "stall",          "deadline",       "table_fault",        "e_stop",
    "link_lost",      "chamber_fault",  "imu_lost",           "motion_data_lost",
    "storage_failed", "unit_wrong",     "pause_wanted",       "operator_stop",
    "end_wanted"};

constexpr std::array<std::string_view, run_action_count> action_names = {
    "none",           "connect",      "enable_and_home", "begin_rest",  "settle_again", "select_next",   "issue_move",
    "watch_settling", "watch_moving", "close_move",      "begin_dwell", "close_dwell",  "discard_dwell", "discard_move",
    "finish_step",    "calibrate",    "stop_table",      "abort_table", "announce"};

}  // namespace

Transition next(RunState state, RunEvent event, GuardSet guards) {
  for (const TransitionRow& row : transition_table)
    if (row.event == event && row.from.contains(state) && guards.contains(row.guard))
      return {Transition::Outcome::taken, row.to, row.action};
  for (const IgnoredRow& row : ignored_events)
    if (row.in.contains(state) && row.events.contains(event))
      return {Transition::Outcome::ignored, state, RunAction::none};
  const bool drives_may_be_on =
      live_states.contains(state) || state == RunState::stopping || state == RunState::calibrating;
  if (drives_may_be_on) return {Transition::Outcome::unexpected, RunState::stopping, RunAction::stop_table};
  return {Transition::Outcome::unexpected, RunState::failed, RunAction::announce};
}

std::string_view to_string(RunState state) { return state_names[std::size_t(state)]; }
std::string_view to_string(RunEvent event) { return event_names[std::size_t(event)]; }
std::string_view to_string(RunAction action) { return action_names[std::size_t(action)]; }

std::string format_pause(const RunSnapshot& at) {
  std::string when;
  switch (at.state) {
    case RunState::homing: when = "after homing"; break;
    case RunState::moving: when = "after this move"; break;
    case RunState::settling: when = "after settling"; break;
    case RunState::dwelling: when = "after this dwell"; break;
    case RunState::parking:
    case RunState::calibrating: return "pause asked for: everything is recorded, the run finishes";
    default: return "paused";
  }
  if (at.item_end_utc_s > 0.0) when += ", at " + format_utc(at.item_end_utc_s).substr(11);
  return "pause asked for: " + when + "; Ctrl-C again stops now";
}

}  // namespace turncal
