// The station's state machine: one transition table, and a pure function that looks a transition up in it.
//
//   (state, event, guards)  ->  (next state, action)
//
// The table is constant data and knows no step of any sequence: which move or dwell comes next is found outside and
// comes in as an event (move_next, dwell_next, step_complete, ...). Nothing here waits, logs, moves or reads a clock;
// StationRun does, and carries the actions out. docs/architecture.md draws the same table and a test compares them.
//
// Every pair of state and event has an outcome: a row of `transition_table`, a row of `ignored_events` (with the reason
// why it may be ignored), or else it is unexpected: our own mistake, on which the table is stopped as on any error.
//
// A run that goes on after an interruption walks the same table, from `idle`, with its cursor after the last completed dwell.
#pragma once

#include <cstdint>
#include <initializer_list>
#include <span>
#include <string>
#include <string_view>

#include "imu_io/base/text.h"
#include "orchestrator/station/number_text.h"

namespace turncal {

enum class RunState {
  idle,         // nothing opened yet
  connecting,   // table and IMU are being opened and identified
  homing,       // drives enabled, axes search their zero
  resting,      // resumes after an interruption: unit and table warm up
  selecting,    // at rest between two items of the sequence: selects the next
  moving,       // one axis was commanded and has not arrived
  settling,     // arrived; has to stay so for the settle time
  dwelling,     // at rest, samples are counted
  step_done,    // every item of a step is recorded
  parking,      // nothing left to record: a stop went out, the drives go off, both are being verified
  calibrating,  // the recording is complete, the table at rest with its drives off
  stopping,     // a stop went out to all axes and is being verified
  done,
  failed,
  aborted,     // by the operator
  interrupted  // paused, or told to end from outside: can be resumed
};
template <>
inline constexpr auto enum_words<RunState> = std::to_array({"idle", "connecting", "homing", "resting", "selecting",
                                                            "moving", "settling", "dwelling", "step_done", "parking",
                                                            "calibrating", "stopping", "done", "failed", "aborted",
                                                            "interrupted"});

enum class RunEvent {
  start,
  connected,  // table and IMU answer, and are the ones expected
  connect_failed,
  homed,              // every axis says homed and not moving
  rest_over,          // the rest after an interruption has lasted long enough
  back_in_place,      // after that rest: the table stands where the last completed dwell left it
  move_next,          // next is a move: of the sequence, or back to where the table should stand
  dwell_next,         // next is a dwell
  step_complete,      // the step has no further item
  step_next,          // there is a further step
  sequence_complete,  // there is none
  arrived,            // the arrival rule holds, but for the settle time
  unsettled,          // it held and holds no longer
  settled,            // it held for the settle time
  dwell_complete,     // all samples of the dwell are there and good
  dwell_bad,          // the table moved, samples were lost, or the unit flagged its data
  move_bad,           // samples were lost or flagged while the table turned, and it has settled
  calibration_ok,     // parameters estimated and durable on disk
  calibration_failed,
  stopped_verified,  // every axis reads at rest, and its drive is off
  stall,             // commanded and no progress
  deadline,          // not finished in the time it may take
  table_fault,       // fault, limit switch, refused command, drive switched off
  e_stop,
  link_lost,         // the table does not answer
  chamber_fault,     // door, alarm, sensor, link, never settles, the unit too warm (chamber_watch.h)
  imu_lost,          // the IMU is gone or silent
  motion_data_lost,  // samples lost or flagged while the table turns: reported at once, judged when it has settled
  storage_failed,    // the recording cannot be written
  unit_wrong,        // what the unit feels does not fit its frame, its mounting or the site
  pause_wanted,      // a pause is asked for: reported while an item goes on, and again at the next safe point
  operator_stop,     // the operator: stop now
  end_wanted         // from outside (SIGTERM, SIGHUP): stop now; the run may be resumed
};
template <>
inline constexpr auto enum_words<RunEvent> =
    std::to_array({"start",          "connected",      "connect_failed",     "homed",
                   "rest_over",      "back_in_place",  "move_next",          "dwell_next",
                   "step_complete",  "step_next",      "sequence_complete",  "arrived",
                   "unsettled",      "settled",        "dwell_complete",     "dwell_bad",
                   "move_bad",       "calibration_ok", "calibration_failed", "stopped_verified",
                   "stall",          "deadline",       "table_fault",        "e_stop",
                   "link_lost",      "chamber_fault",  "imu_lost",           "motion_data_lost",
                   "storage_failed", "unit_wrong",     "pause_wanted",       "operator_stop",
                   "end_wanted"});

enum class RunAction {
  none,
  connect,
  enable_and_home,
  begin_rest,
  settle_again,  // after an interruption; back in place the recording goes on, with a rotate segment to settle in
  select_next,   // looks at cursor and table, selects what comes next
  issue_move,    // open a rotate segment, command the axis
  watch_settling,
  watch_moving,
  close_move,     // close the rotate segment, select what comes next
  begin_dwell,    // open the dwell's segment
  close_dwell,    // close it as what it is, select what comes next
  discard_dwell,  // close it as rotate, count the repeat, open a rotate segment to settle in
  discard_move,   // close it as rotate, count the repeat, go back to where it began
  finish_step,    // sync the recording, look for a further step
  calibrate,      // seal the recording, calibrate from it, write the results
  stop_table,     // stop to all axes; once they rest, drives off
  abort_table,    // fastest stop, drives off
  announce        // say how it ended
};
template <>
inline constexpr auto enum_words<RunAction> =
    std::to_array({"none", "connect", "enable_and_home", "begin_rest", "settle_again", "select_next", "issue_move",
                   "watch_settling", "watch_moving", "close_move", "begin_dwell", "close_dwell", "discard_dwell",
                   "discard_move", "finish_step", "calibrate", "stop_table", "abort_table", "announce"});

enum class RunGuard {
  always,
  rest_due,  // the run goes on after an interruption in which time passed
  no_rest_due,
  repeats_left,  // the dwell or move may be repeated once more
  no_repeats_left,
  by_operator,  // why the table is being stopped
  by_error,
  by_interruption
};

// A set of states or events as bits, so that one row can say "from any of these".
template <class Enum>
struct EnumSet {
  std::uint64_t bits = 0;
  constexpr EnumSet(std::initializer_list<Enum> members) {
    for (Enum member : members) bits |= std::uint64_t{1} << unsigned(member);
  }
  constexpr EnumSet(Enum member) : EnumSet({member}) {}
  constexpr bool contains(Enum member) const { return (bits >> unsigned(member) & 1u) != 0; }
};
using StateSet = EnumSet<RunState>;
using EventSet = EnumSet<RunEvent>;
using GuardSet = EnumSet<RunGuard>;

// Returns the guards that hold. stop_cause: by_operator, by_error or by_interruption.
constexpr GuardSet guards_of(bool rest_due, bool repeats_left, RunGuard stop_cause) {
  return {RunGuard::always, rest_due ? RunGuard::rest_due : RunGuard::no_rest_due,
          repeats_left ? RunGuard::repeats_left : RunGuard::no_repeats_left, stop_cause};
}

struct TransitionRow {
  StateSet from;
  EventSet events;
  RunGuard guard;
  RunState to;
  RunAction action;
};
struct IgnoredRow {
  StateSet in;
  EventSet events;
  std::string_view why;
};

// States in which the drives are on, and so an error has to stop the table.
inline constexpr StateSet live_states = {RunState::homing,    RunState::resting,  RunState::selecting,
                                         RunState::moving,    RunState::settling, RunState::dwelling,
                                         RunState::step_done, RunState::parking};

namespace run_table {
using enum RunState;
using enum RunEvent;
using enum RunAction;
using enum RunGuard;

// clang-format off
inline constexpr TransitionRow rows[] = {
  // from          event               guard            to           action
  {idle,           start,              always,          connecting,  connect},
  {connecting,     connected,          always,          homing,      enable_and_home},
  {homing,         homed,              no_rest_due,     selecting,   select_next},
  {homing,         homed,              rest_due,        resting,     begin_rest},
  {resting,        rest_over,          always,          settling,    settle_again},
  {selecting,      back_in_place,      always,          settling,    settle_again},

  {selecting,      move_next,          always,          moving,      issue_move},
  {moving,         arrived,            always,          settling,    watch_settling},
  {settling,       unsettled,          always,          moving,      watch_moving},
  {settling,       settled,            always,          selecting,   close_move},
  {moving,         motion_data_lost,   always,          moving,      none},
  {settling,       motion_data_lost,   always,          settling,    none},
  {settling,       move_bad,           repeats_left,    selecting,   discard_move},
  {settling,       move_bad,           no_repeats_left, stopping,    stop_table},

  {selecting,      dwell_next,         always,          dwelling,    begin_dwell},
  {dwelling,       dwell_complete,     always,          selecting,   close_dwell},
  {dwelling,       dwell_bad,          repeats_left,    settling,    discard_dwell},
  {dwelling,       dwell_bad,          no_repeats_left, stopping,    stop_table},

  {selecting,      step_complete,      always,          step_done,   finish_step},
  {step_done,      step_next,          always,          selecting,   select_next},
  {step_done,      sequence_complete,  always,          parking,     stop_table},
  {parking,        stopped_verified,   always,          calibrating, calibrate},
  {calibrating,    calibration_ok,     always,          done,        announce},

  {homing,         pause_wanted,       always,          homing,      none},
  {moving,         pause_wanted,       always,          moving,      none},
  {settling,       pause_wanted,       always,          settling,    none},
  {dwelling,       pause_wanted,       always,          dwelling,    none},
  {parking,        pause_wanted,       always,          parking,     none},
  {{connecting, resting, selecting, step_done},
                   pause_wanted,       always,          stopping,    stop_table},

  {moving,         stall,              always,          stopping,    stop_table},
  {{homing, moving, settling, dwelling},
                   deadline,           always,          stopping,    stop_table},
  {live_states,    {table_fault, e_stop, link_lost, chamber_fault, imu_lost, storage_failed, unit_wrong, operator_stop, end_wanted},
                                       always,          stopping,    stop_table},
  {calibrating,    {calibration_failed, operator_stop, end_wanted},
                                       always,          stopping,    stop_table},

  {stopping,       stopped_verified,   by_error,        failed,      announce},
  {stopping,       stopped_verified,   by_operator,     aborted,     announce},
  {stopping,       stopped_verified,   by_interruption, interrupted, announce},
  {stopping,       {operator_stop, end_wanted},
                                       always,          stopping,    abort_table},
  {{stopping, parking},
                   deadline,           always,          failed,      announce},
  {connecting,     connect_failed,     always,          failed,      announce},
  {{idle, connecting},
                   operator_stop,      always,          aborted,     announce},
  {{idle, connecting},
                   end_wanted,         always,          interrupted, announce},
};

inline constexpr IgnoredRow ignored[] = {
  {stopping,    {table_fault, e_stop, link_lost, chamber_fault, imu_lost, motion_data_lost, storage_failed, unit_wrong},
                "the first reason stands; the deadline judges the stop"},
  {calibrating, {table_fault, e_stop, link_lost, chamber_fault, imu_lost},
                "the recording is complete and the table is at rest, its drives off"},
  {calibrating, pause_wanted,
                "everything is recorded: the run finishes"},
  {stopping,    pause_wanted,
                "it stops already"},
  {{done, failed, aborted, interrupted},
                {start, connected, connect_failed, homed, rest_over, back_in_place, move_next, dwell_next, step_complete,
                 step_next, sequence_complete, arrived, unsettled, settled, dwell_complete, dwell_bad, move_bad,
                 calibration_ok, calibration_failed, stopped_verified, stall, deadline, table_fault, e_stop, link_lost, chamber_fault, imu_lost,
                 motion_data_lost, storage_failed, unit_wrong, pause_wanted, operator_stop, end_wanted},
                "the run is over"},
};
// clang-format on
}  // namespace run_table

inline constexpr std::span<const TransitionRow> transition_table{run_table::rows};
inline constexpr std::span<const IgnoredRow> ignored_events{run_table::ignored};

struct Transition {
  enum class Outcome { taken, ignored, unexpected } outcome = Outcome::unexpected;
  RunState to = RunState::failed;
  RunAction action = RunAction::none;
};

// Looks a transition up. An unexpected event leads to `stopping` with stop_table where the drives may be on, else to `failed`.
constexpr Transition next(RunState state, RunEvent event, GuardSet guards) {
  for (const TransitionRow& row : transition_table)
    if (row.events.contains(event) && row.from.contains(state) && guards.contains(row.guard))
      return {Transition::Outcome::taken, row.to, row.action};
  for (const IgnoredRow& row : ignored_events)
    if (row.in.contains(state) && row.events.contains(event))
      return {Transition::Outcome::ignored, state, RunAction::none};
  const bool drives_may_be_on =
      live_states.contains(state) || state == RunState::stopping || state == RunState::calibrating;
  if (drives_may_be_on) return {Transition::Outcome::unexpected, RunState::stopping, RunAction::stop_table};
  return {Transition::Outcome::unexpected, RunState::failed, RunAction::announce};
}

constexpr bool is_final(RunState state) {
  return state == RunState::done || state == RunState::failed || state == RunState::aborted ||
         state == RunState::interrupted;
}

inline std::string state_words(std::string_view state) {  // for people: "at rest" between two items
  return state == to_string(RunState::selecting) || state == to_string(RunState::step_done) ? "at rest"
                                                                                            : in_words(state);
}

}  // namespace turncal
