// The eyes of a run: reading the IMU, polling the table, and what is made of it.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "orchestrator/station_run.h"

namespace turncal {

namespace {

constexpr int status_tries = 3;
constexpr std::size_t catch_up_samples = 65536;  // more than any line holds
constexpr double reconnect_wait_min_s = 0.5;
constexpr double reconnect_wait_max_s = 5.0;

bool by_operator(const Error& error) { return error.kind == ErrorKind::aborted || error.kind == ErrorKind::interrupted; }

}  // namespace

StationRun::MaybeEvent StationRun::pump() {
  const double period_s = info_.sample_period_s;
  const double now_s = devices_.clock.now_s();
  const double wanted_s = std::max(next_poll_s_ - now_s, 0.0);
  if (!imu_open_) {
    devices_.wait(std::max(wanted_s, period_s));
    return std::nullopt;
  }
  // A poll that is due comes first; what has arrived meanwhile waits in the source.
  if (wanted_s < time_slack_s) return std::nullopt;
  auto count = static_cast<std::size_t>(std::max(1.0, std::ceil((wanted_s - time_slack_s) / period_s)));
  if (state_ == RunState::dwelling) count = std::min(count, static_cast<std::size_t>(dwell_->remaining()));
  count = std::clamp<std::size_t>(count, 1, buffer_.size());
  // Half a period more, so that rounding cannot cost a sample.
  const double timeout_s = (static_cast<double>(count) + 0.5) * period_s;
  const Result<std::size_t> got = devices_.imu.read(std::span(buffer_).first(count), timeout_s);
  if (!got) {
    imu_open_ = false;
    return raise(RunEvent::imu_lost, got.error().kind, got.error().message);
  }
  const double after_s = devices_.clock.now_s();
  if (*got == 0) {
    if (state_ != RunState::stopping && after_s - last_sample_s_ > job_.station.imu_timeout_s) {
      return raise(RunEvent::imu_lost, ErrorKind::device,
                   "no sample from the IMU for " + std::to_string(std::lround(after_s - last_sample_s_)) + " s");
    }
    return std::nullopt;
  }
  last_sample_s_ = after_s;
  return take(std::span(buffer_).first(*got));
}

StationRun::MaybeEvent StationRun::catch_up() {
  for (std::size_t left = catch_up_samples; imu_open_ && left > 0;) {
    const Result<std::size_t> got = devices_.imu.read(std::span(buffer_).first(std::min(left, buffer_.size())), 0.0);
    if (!got) {
      imu_open_ = false;
      return raise(RunEvent::imu_lost, got.error().kind, got.error().message);
    }
    if (*got == 0) break;
    left -= *got;
    last_sample_s_ = devices_.clock.now_s();
    if (const MaybeEvent event = take(std::span(buffer_).first(*got))) {
      if (*event != RunEvent::motion_data_lost) return event;
      handle(*event);
    }
  }
  return std::nullopt;
}

StationRun::MaybeEvent StationRun::take(std::span<ImuSample> samples) {
  // A sample that came twice is dropped here; the recording wants counters that increase.
  std::size_t kept = 0;
  for (const ImuSample& sample : samples) {
    if (last_counter_ && sample.counter <= *last_counter_) {
      ++outcome_.duplicate_samples;
      continue;
    }
    last_counter_ = sample.counter;
    samples[kept++] = sample;
  }
  samples = samples.first(kept);
  if (samples.empty() || !segment_open_ || !recording_) return std::nullopt;

  if (gap_due_) {
    // One sample stands for all that was missed: the unit's counter may have begun anew, and the table is back where it was.
    ++next_sample_;
    first_counter_ = samples.front().counter - next_sample_;
    gap_due_ = false;
  }
  if (!first_counter_) first_counter_ = samples.front().counter;
  for (ImuSample& sample : samples) sample.counter -= *first_counter_;
  outcome_.lost_samples += static_cast<std::uint64_t>(samples.back().counter + 1 - next_sample_) - samples.size();
  const std::int64_t expected = next_sample_;
  next_sample_ = samples.back().counter + 1;
  outcome_.recorded_samples = next_sample_;
  if (Status status = sink_.add(samples); !status) {
    return raise(RunEvent::storage_failed, status.error().kind, status.error().message);
  }
  if (state_ == RunState::dwelling) {
    if (const std::optional<DwellMonitor::Defect>& defect = dwell_->add(samples)) {
      return raise(RunEvent::dwell_bad, defect->kind, defect->reason);
    }
    if (!dwell_->complete()) return std::nullopt;
    // The last word on whether the table stood still is the table's.
    if (const MaybeEvent event = read_table()) return event;
    if (const MaybeEvent event = judge_dwell()) return event;
    return RunEvent::dwell_complete;
  }
  if (!arrival_.move()) return std::nullopt;
  const bool gap = next_sample_ - expected != static_cast<std::int64_t>(samples.size());
  return check_motion_data(samples, gap);
}

StationRun::MaybeEvent StationRun::check_motion_data(std::span<const ImuSample> samples, bool gap) {
  if (motion_loss_told_) return std::nullopt;
  const bool flagged = std::any_of(samples.begin(), samples.end(), [](const ImuSample& sample) {
    return (sample.flags & sample_flag_invalid) != 0;
  });
  if (!gap && !flagged) return std::nullopt;
  motion_loss_told_ = true;
  return raise(RunEvent::motion_data_lost, ErrorKind::device,
               std::string(gap ? "samples lost" : "the unit flagged its data as bad") +
                   " while the table turned, before sample " + std::to_string(next_sample_));
}

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

StationRun::MaybeEvent StationRun::judge(double now_s) {
  switch (state_) {
    case RunState::homing: return judge_homing(now_s);
    case RunState::resting:
      if (now_s < rest_until_s_ - time_slack_s) return std::nullopt;
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
  for (Axis axis : all_axes) {
    Error error;
    bool answered = false;
    for (int i = 0; i < status_tries && !answered; ++i) {
      if (Result<AxisStatus> status = devices_.table.status(axis)) {
        status_[static_cast<std::size_t>(axis)] = std::move(*status);
        answered = true;
      } else {
        error = status.error();
        if (by_operator(error)) break;
      }
    }
    if (!answered && by_operator(error)) return raise_table(RunEvent::link_lost, error);
    if (!answered) {
      link_down_ = true;
      return raise(RunEvent::link_lost, ErrorKind::device,
                   std::string("the table does not answer for axis ") + to_string(axis) + ": " + error.message);
    }
  }
  link_down_ = false;
  if (!live_states.contains(state_)) return std::nullopt;
  for (Axis axis : all_axes) {
    const AxisStatus& status = status_[static_cast<std::size_t>(axis)];
    const std::string text = status.text.empty() ? "" : ": " + status.text;
    const std::string name = to_string(axis);
    if (status.emergency_stop) {
      return raise(RunEvent::e_stop, ErrorKind::device, "emergency stop is pressed" + text);
    }
    if (status.fault) return raise(RunEvent::table_fault, ErrorKind::device, "fault of axis " + name + text);
    if (status.limit) return raise(RunEvent::table_fault, ErrorKind::device, "limit switch of axis " + name + text);
    if (!status.remote) return raise(RunEvent::table_fault, ErrorKind::device, "axis " + name + " is not in remote mode");
    if (state_ == RunState::homing || state_ == RunState::parking) continue;
    if (!status.enabled) return raise(RunEvent::table_fault, ErrorKind::device, "drive of axis " + name + " is off" + text);
    if (!status.homed) return raise(RunEvent::table_fault, ErrorKind::device, "axis " + name + " lost its zero" + text);
  }
  return std::nullopt;
}

bool StationRun::at_rest() const {
  return std::all_of(status_.begin(), status_.end(), [this](const AxisStatus& axis) {
    return !axis.moving && std::abs(axis.rate_degps) <= job_.station.motion.settle_rate_degps;
  });
}

StationRun::MaybeEvent StationRun::judge_homing(double now_s) {
  if (!home_sent_ && at_rest()) return send_home();
  const bool homed = std::all_of(status_.begin(), status_.end(),
                                 [](const AxisStatus& axis) { return axis.homed && axis.enabled && !axis.moving; });
  if (home_sent_ && homed) return RunEvent::homed;
  if (now_s > phase_deadline_s_) return raise(RunEvent::deadline, ErrorKind::device, "the axes did not find their zero");
  return std::nullopt;
}

StationRun::MaybeEvent StationRun::judge_dwell() {
  for (Axis axis : all_axes) {
    const AxisStatus& status = status_[static_cast<std::size_t>(axis)];
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
  if (devices_.clock.now_s() > phase_deadline_s_) {
    return raise(RunEvent::deadline, ErrorKind::device, "the IMU's samples come too slowly for its period");
  }
  return std::nullopt;
}

StationRun::MaybeEvent StationRun::judge_stop(double now_s) {
  if (link_down_) {
    try_to_reconnect(now_s);
  } else {
    const bool off = std::none_of(status_.begin(), status_.end(), [](const AxisStatus& axis) { return axis.enabled; });
    if (at_rest() && off) return RunEvent::stopped_verified;
    if (at_rest() && !drives_off_sent_) {
      drives_off_sent_ = true;
      link_down_ = !devices_.table.abort_all().ok();
    }
  }
  if (now_s > phase_deadline_s_) {
    if (state_ == RunState::parking) return raise(RunEvent::deadline, ErrorKind::device, "the drives do not go off");
    return RunEvent::deadline;
  }
  return std::nullopt;
}

// For the stop only: a motion is never taken up again.
void StationRun::try_to_reconnect(double now_s) {
  if (now_s < reconnect_at_s_) return;
  reconnect_at_s_ = now_s + reconnect_wait_s_;
  reconnect_wait_s_ = std::min(2.0 * std::max(reconnect_wait_s_, reconnect_wait_min_s), reconnect_wait_max_s);
  if (!devices_.table.connect()) return;
  link_down_ = false;
  if (Status status = devices_.table.stop_all(); !status) {
    abort_sent_ = true;
    link_down_ = !devices_.table.abort_all().ok();
  }
}

void StationRun::schedule_poll(double now_s) {
  const MotionConfig& motion = job_.station.motion;
  const bool resting =
      state_ == RunState::dwelling || state_ == RunState::homing || state_ == RunState::resting;
  next_poll_s_ = now_s + (resting ? motion.poll_idle_s : motion.poll_moving_s);
  if (state_ == RunState::moving || state_ == RunState::settling) {
    next_poll_s_ = std::min(next_poll_s_, arrival_.moment_of_interest_s(now_s));
  }
}

std::optional<Axis> StationRun::displaced_axis() const {
  for (Axis axis : {Axis::roll, Axis::pitch, Axis::heading}) {
    if (out_of_tolerance(axis, commanded_deg_[axis])) return axis;
  }
  return std::nullopt;
}

bool StationRun::out_of_tolerance(Axis axis, double from_deg) const {
  return !(std::abs(status_[static_cast<std::size_t>(axis)].position_deg - from_deg) <=
           job_.station.motion.position_tolerance_deg);
}

}  // namespace turncal
