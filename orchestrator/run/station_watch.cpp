// The eyes of a run: polling the table, and what is made of it.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "orchestrator/run/motion_watch.h"
#include "orchestrator/run/station_run.h"
#include "turntable_drivers/table/table_state.h"

namespace turncal {

namespace {

constexpr int status_tries = 3;

bool by_operator(const Error& error) {
  return error.kind == ErrorKind::aborted || error.kind == ErrorKind::interrupted;
}

}  // namespace

StationRun::MaybeEvent StationRun::poll() {
  const double now_s = devices_.clock.now_s();
  MaybeEvent event = read_table();
  if (state_ == RunState::stopping) {
    detail_.clear();  // a link that fails now is no new reason
    event = judge_stop(now_s);
  } else if (!event) {
    event = judge(now_s);
  }
  // A line that takes longer to ask than the time between two polls must not keep the unit from being read.
  schedule_poll(devices_.clock.now_s());
  return event;
}

// A table that turns by itself does not wait for the commanded axis to stall. A person who turns it may touch any axis.
StationRun::MaybeEvent StationRun::judge_motion() {
  if (devices_.table.needs_operator() || state_ == RunState::parking) return std::nullopt;
  const bool searches = state_ == RunState::homing;
  const bool turns = state_ == RunState::moving || state_ == RunState::settling;
  const std::optional<Move> move = turns ? arrival_.move() : std::nullopt;
  const double tolerance_deg = job_.station.motion.position_tolerance_deg;
  // A slip is put right by a move, but not while another move goes on or the table rests.
  const bool put_right = !move && state_ != RunState::resting;
  const double standing_deg = put_right ? least_runaway_deg(tolerance_deg) : tolerance_deg;
  auto said = searches ? std::nullopt : stray_axis(status_, held_deg_, move, standing_deg, tolerance_deg);
  if (!said) said = speed_.add(status_, asked_s_, answered_s_, move, searches);
  if (!said) {
    std::vector<const FeltRate*> felt;
    for (UnitLane& lane : lanes_)
      if (lane.alive()) felt.push_back(&lane.felt());
    said = speed_.add_felt(felt, status_, move, searches);
  }
  return said ? MaybeEvent(raise(RunEvent::table_fault, ErrorKind::device, *said)) : std::nullopt;
}

StationRun::MaybeEvent StationRun::judge(double now_s) {
  if (const MaybeEvent event = judge_motion()) return event;
  switch (state_) {
    case RunState::homing: return judge_homing(now_s);
    case RunState::resting:
      if (now_s < rest_until_s_ - time_slack_s || (devices_.chamber && !devices_.chamber->settled()))
        return std::nullopt;
      if (devices_.chamber) detail_ = devices_.chamber->text() + ", settled";
      return RunEvent::rest_over;
    case RunState::parking: return judge_stop(now_s);
    case RunState::dwelling: return judge_dwell();
    case RunState::moving:
    case RunState::settling: break;
    default: return std::nullopt;
  }
  const MaybeEvent event = arrival_.update(status_, now_s);
  if (event == RunEvent::settled) {
    // What the unit sent while the table still turned belongs to the move, not to the dwell that follows.
    if (const MaybeEvent late = catch_up()) return late;
    if (!unit_awaited_) await_until_s_ = now_s + job_.station.imu_timeout_s;
    unit_awaited_ = recording_ && apart() && now_s < await_until_s_;
    if (unit_awaited_) return std::nullopt;
    if (const MaybeEvent bad = judge_move()) return bad;
  }
  const char* axis = arrival_.move() ? to_string(arrival_.move()->axis) : "table";
  char text[120];
  if (event == RunEvent::stall) {
    std::snprintf(text, sizeof text, "%s has made no progress for %g s (stall)", axis, job_.station.motion.stall_s);
    return raise(*event, ErrorKind::device, text);
  }
  if (event == RunEvent::deadline) {
    std::snprintf(text, sizeof text, "%s has not settled within the %.1f s it may take", axis, arrival_.allowed_s());
    return raise(*event, ErrorKind::device, text);
  }
  return event;
}

StationRun::MaybeEvent StationRun::read_table() {
  asked_s_ = devices_.clock.now_s();
  for (Axis axis : all_axes) {
    Error error;
    bool answered = false;
    for (int i = 0; i < status_tries && !answered; ++i) {
      if (Result<AxisStatus> status = devices_.table.status(axis)) {
        status_[index(axis)] = std::move(*status);
        answered = true;
      } else {
        error = status.error();
        if (by_operator(error)) break;
      }
    }
    if (!answered && by_operator(error)) return raise_table(RunEvent::link_lost, error);
    if (!answered) {
      unread_ = true;
      const bool answers = devices_.table.answers();
      return raise(answers ? RunEvent::table_fault : RunEvent::link_lost, ErrorKind::device,
                   std::string(answers ? "no reading of axis " : "the table does not answer for axis ") +
                       to_string(axis) + ": " + error.message);
    }
  }
  unread_ = false;
  angles_known_ = true;
  answered_s_ = devices_.clock.now_s();
  if (!live_states.contains(state_)) return std::nullopt;
  const bool in_use = state_ != RunState::homing && state_ != RunState::parking;
  for (Axis axis : all_axes) {
    const AxisStatus& status = status_[index(axis)];
    const std::string trouble = trouble_of(axis, status, in_use);
    if (trouble.empty()) continue;
    return raise(status.emergency_stop ? RunEvent::e_stop : RunEvent::table_fault, ErrorKind::device, trouble);
  }
  return std::nullopt;
}

bool StationRun::table_stands() const {
  return std::all_of(status_.begin(), status_.end(), [this](const AxisStatus& axis) {
    return !axis.moving && std::abs(axis.rate_degps) <= job_.station.motion.settle_rate_degps;
  });
}

StationRun::MaybeEvent StationRun::judge_homing(double now_s) {
  if (!home_sent_ && table_stands()) return send_home();
  for (Axis axis : all_axes) {
    const AxisStatus& status = status_[index(axis)];
    // home() found it on.
    if (home_sent_ && !status.enabled)
      return raise(RunEvent::table_fault, ErrorKind::device, trouble_of(axis, status, true));
  }
  if (homing_) {
    if (const auto lost = homing_->add(status_)) return raise(RunEvent::table_fault, ErrorKind::device, *lost);
  }
  const bool homed = std::all_of(status_.begin(), status_.end(),
                                 [](const AxisStatus& axis) { return axis.homed && axis.enabled && !axis.moving; });
  if (home_sent_ && homed) return RunEvent::homed;
  if (now_s > phase_deadline_s_)
    return raise(RunEvent::deadline, ErrorKind::device,
                 home_sent_ ? "the axes did not find their zero"
                            : "the table was told to stop before it is homed, and does not come to rest");
  return std::nullopt;
}

StationRun::MaybeEvent StationRun::judge_dwell() {
  bad_lane_ = nullptr;
  // A slip is put right and the dwell repeated. An axis that reads further away turns by itself, or its encoder lost count: no move back.
  if (!devices_.table.needs_operator()) {
    const double slip_deg = least_runaway_deg(job_.station.motion.position_tolerance_deg);
    if (const auto stray = stray_axis(status_, dwell_start_deg_, std::nullopt, slip_deg, slip_deg)) {
      return raise(RunEvent::table_fault, ErrorKind::device, *stray);
    }
  }
  for (Axis axis : all_axes) {
    const AxisStatus& status = status_[index(axis)];
    char text[120];
    if (out_of_tolerance(axis, dwell_start_deg_[axis]) || out_of_tolerance(axis, commanded_deg_[axis])) {
      std::snprintf(text, sizeof text, "the table moved: %s from %.4f to %.4f deg", to_string(axis),
                    dwell_start_deg_[axis], status.position_deg);
      return raise(RunEvent::dwell_bad, ErrorKind::device, text);
    }
    if (status.moving || !(std::abs(status.rate_degps) <= job_.station.motion.settle_rate_degps)) {
      std::snprintf(text, sizeof text, "the table moves: %s at %.4g deg/s", to_string(axis), status.rate_degps);
      return raise(RunEvent::dwell_bad, ErrorKind::device, text);
    }
  }
  if (devices_.clock.now_s() <= phase_deadline_s_) return std::nullopt;
  for (UnitLane& lane : lanes_) {
    // A table that answers late holds up the count, not the unit.
    if (!lane.alive() || lane.dwell_received()) continue;
    const Error slow = device_error("the IMU's samples come too slowly for its period" + lane.came_instead());
    if (const MaybeEvent event = fail(lane, RunEvent::deadline, slow)) return event;
  }
  return std::nullopt;
}

StationRun::MaybeEvent StationRun::judge_stop(double now_s) {
  if (stop_.look(unread_ ? nullptr : &status_, now_s)) {
    left_ = status_;
    if (chamber_rests()) return RunEvent::stopped_verified;
    if (now_s <= chamber_until_s_) return std::nullopt;
    return raise(RunEvent::deadline, ErrorKind::device, "the chamber did not switch off");
  }
  if (now_s > phase_deadline_s_) {
    if (state_ == RunState::parking)
      return raise(RunEvent::deadline, ErrorKind::device, "the drives did not switch off");
    return RunEvent::deadline;
  }
  return std::nullopt;
}

bool StationRun::chamber_rests() const { return !devices_.chamber || devices_.chamber->is_off(); }

StationRun::MaybeEvent StationRun::look_at_chamber() {
  if (!devices_.chamber) return std::nullopt;
  std::optional<double> warmest_c;
  for (const UnitLane& lane : lanes_)
    if (lane.alive() && lane.temperature_c()) warmest_c = std::max(warmest_c.value_or(-1e3), *lane.temperature_c());
  const std::string fault = devices_.chamber->look(warmest_c, devices_.clock.now_s());
  if (fault.empty() || !live_states.contains(state_)) return std::nullopt;
  return raise(RunEvent::chamber_fault, ErrorKind::device, fault);
}

// What no stop has switched off: a run that ended before its table was used.
void StationRun::leave_chamber() {
  if (!devices_.chamber || !devices_.chamber->is_connected() || chamber_rests()) return;
  if (chamber_until_s_ > 0.0 && devices_.clock.now_s() > chamber_until_s_) return;
  const Status off =
      leave_off(*devices_.chamber, {[this] { return devices_.clock.now_s(); }, devices_.wait, {}, {}, {}});
  if (off) return;
  state_ = RunState::failed;
  first_error_ = device_error((first_error_ ? first_error_->message + "; " : "") + off.error().message);
}

void StationRun::schedule_poll(double now_s) {
  const MotionConfig& motion = job_.station.motion;
  const bool resting = state_ == RunState::dwelling || state_ == RunState::homing || state_ == RunState::resting;
  next_poll_s_ = now_s + (resting ? motion.poll_idle_s : motion.poll_moving_s);
  if (state_ == RunState::moving || state_ == RunState::settling)
    if (!unit_awaited_) next_poll_s_ = std::min(next_poll_s_, arrival_.moment_of_interest_s(now_s));
}

std::optional<Axis> StationRun::displaced_axis() const {
  for (Axis axis : {Axis::roll, Axis::pitch, Axis::heading})
    if (out_of_tolerance(axis, commanded_deg_[axis])) return axis;
  return std::nullopt;
}

bool StationRun::out_of_tolerance(Axis axis, double from_deg) const {
  return !(std::abs(status_[index(axis)].position_deg - from_deg) <= job_.station.motion.position_tolerance_deg);
}

}  // namespace turncal
