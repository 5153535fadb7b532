#include "orchestrator/run/arrival_monitor.h"

#include <algorithm>
#include <cmath>

namespace turncal {

namespace {

constexpr int guard_polls = 3;

// What counts as coming nearer: far less than any real move makes in stall_s, more than an encoder's flicker.
constexpr double progress_deg = 2e-4;

}  // namespace

void ArrivalMonitor::start_move(const Move& move, double from_deg, double now_s) {
  move_ = move;
  from_deg_ = from_deg;
  started_s_ = now_s;
  const double angle_deg = std::abs(move.target_deg - from_deg);
  expected_end_s_ = now_s + move_duration_s(angle_deg, move.rate_degps, move.acceleration_degps2);
  deadline_s_ = now_s + angle_deg / move.rate_degps + 2.0 * move.rate_degps / move.acceleration_degps2 +
                config_.deadline_margin_s;
  polls_ = 0;
  motion_seen_ = false;
  arrived_s_.reset();
  best_distance_deg_ = angle_deg;
  last_progress_s_ = now_s;
}

void ArrivalMonitor::settle_only(double now_s) {
  move_.reset();
  started_s_ = now_s;
  expected_end_s_ = now_s;
  deadline_s_ = now_s + config_.settle_s + config_.deadline_margin_s;
  polls_ = 0;
  motion_seen_ = true;
  arrived_s_ = now_s;
}

bool ArrivalMonitor::holds(const TableStatus& status) const {
  for (const AxisStatus& axis : status)
    if (axis.moving || !(std::abs(axis.rate_degps) <= config_.settle_rate_degps)) return false;
  if (!move_) return true;
  const AxisStatus& axis = status[index(move_->axis)];
  const bool armed = motion_seen_ || polls_ >= guard_polls;
  return armed && axis.in_position && std::abs(axis.position_deg - move_->target_deg) <= config_.position_tolerance_deg;
}

std::optional<RunEvent> ArrivalMonitor::update(const TableStatus& status, double now_s) {
  ++polls_;
  if (move_) {
    const AxisStatus& axis = status[index(move_->axis)];
    if (axis.moving || std::abs(axis.rate_degps) > config_.settle_rate_degps ||
        std::abs(axis.position_deg - from_deg_) > config_.position_tolerance_deg) {
      motion_seen_ = true;
    }
  }
  if (holds(status)) {
    if (!arrived_s_) {
      arrived_s_ = now_s;
      return RunEvent::arrived;
    }
    if (now_s - *arrived_s_ >= config_.settle_s - time_slack_s) return RunEvent::settled;
    return std::nullopt;
  }
  const bool was_settling = arrived_s_.has_value();
  arrived_s_.reset();
  if (now_s > deadline_s_ + time_slack_s) return RunEvent::deadline;
  if (!move_) {
    arrived_s_ = now_s;  // the settle time begins anew; the deadline does not
    return std::nullopt;
  }
  if (was_settling) {
    last_progress_s_ = now_s;
    return RunEvent::unsettled;
  }
  const double distance_deg = std::abs(status[index(move_->axis)].position_deg - move_->target_deg);
  if (distance_deg < best_distance_deg_ - progress_deg) {
    best_distance_deg_ = distance_deg;
    last_progress_s_ = now_s;
  }
  const bool outside = distance_deg > config_.position_tolerance_deg;
  if (outside && now_s - last_progress_s_ >= config_.stall_s - time_slack_s) return RunEvent::stall;
  return std::nullopt;
}

double ArrivalMonitor::moment_of_interest_s(double now_s) const {
  if (arrived_s_) return *arrived_s_ + config_.settle_s;
  if (expected_end_s_ > now_s + time_slack_s) return expected_end_s_;
  return deadline_s_ + 2.0 * time_slack_s;
}

}  // namespace turncal
