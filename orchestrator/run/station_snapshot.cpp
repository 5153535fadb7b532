// What a run shows of itself: where it is, in words and numbers.
#include <algorithm>
#include <cstdio>

#include "orchestrator/run/station_run.h"

namespace turncal {

std::string StationRun::place() const {
  std::string text;
  if (enabled_) {
    text = "step " + std::to_string(job_.sequence.steps[step_].number) + " (" + std::to_string(step_ + 1) + "/" +
           std::to_string(job_.sequence.steps.size()) + ") ";
  }
  text += to_string(state_);
  if (!angles_known_) return text;
  char angles[200];
  if ((state_ == RunState::moving || state_ == RunState::settling) && arrival_.move()) {
    const Move& move = *arrival_.move();
    std::snprintf(angles, sizeof angles, ", %s at %.4f deg, target %.4f deg", to_string(move.axis),
                  status_[index(move.axis)].position_deg, move.target_deg);
  } else {
    std::snprintf(angles, sizeof angles, " at heading %.4f pitch %.4f roll %.4f deg", status_[0].position_deg,
                  status_[1].position_deg, status_[2].position_deg);
  }
  return text + angles;
}

RunSnapshot StationRun::snapshot() const {
  RunSnapshot s;
  s.time_s = devices_.clock.now_s() - started_s_;
  s.utc_s = devices_.clock.utc_s();
  s.state = state_;
  s.step_count = job_.sequence.steps.size();
  if (enabled_) {
    s.step = job_.sequence.steps[step_].number;
    s.step_place = step_ + 1;
  }
  s.table = unread_ ? state_unread(devices_.table)
                    : state_of(status_, state_ == RunState::stopping || state_ == RunState::parking);
  for (Axis axis : all_axes) {
    s.position_deg[axis] = status_[index(axis)].position_deg;
    s.rate_degps[axis] = status_[index(axis)].rate_degps;
  }
  if ((state_ == RunState::moving || state_ == RunState::settling) && arrival_.move()) {
    s.axis = arrival_.move()->axis;
    s.target_deg = arrival_.move()->target_deg;
  }
  s.repeats = repeats_;
  if (devices_.chamber) s.chamber = devices_.chamber->text();
  std::int64_t dwell_left = 0;
  for (const UnitLane& lane : lanes_) {
    s.lost_samples += lane.lost_samples();
    s.units.push_back(
        {lane.serial(), lane.next_sample(), lane.lost_samples(), lane.alive() ? "" : lane.failure()->message});
    if (lane.alive() && state_ == RunState::dwelling) dwell_left = std::max(dwell_left, lane.dwell_remaining());
  }
  double planned_s = job_.plan.station_s;
  if (item_ < job_.plan.items.size()) {
    const PlannedItem& item = job_.plan.items[item_];
    planned_s = item.start_s;
    if (state_ == RunState::dwelling) {
      s.dwell_kind = item.dwell_kind;
      s.phase_fraction = 1.0 - static_cast<double>(dwell_left) / static_cast<double>(item.samples);
    } else if (item_running_ && (state_ == RunState::moving || state_ == RunState::settling)) {
      s.phase_fraction =
          std::clamp((s.position_deg[item.axis] - item.from_deg) / (item.to_deg - item.from_deg) + 0.0, 0.0, 1.0);
    }
    planned_s += s.phase_fraction * item.duration_s;
    if (state_ == RunState::dwelling || (state_ == RunState::moving && item_running_))
      s.item_end_utc_s = s.utc_s + (1.0 - s.phase_fraction) * item.duration_s / job_.station.clock_speed_up;
  }
  s.run_fraction = job_.plan.station_s > 0.0 ? planned_s / job_.plan.station_s : 0.0;
  s.eta_s = std::max(0.0, job_.plan.station_s - planned_s);
  if (state_ == RunState::resting) {
    const double now_s = devices_.clock.now_s();
    const double chamber_s = devices_.chamber ? devices_.chamber->left_s(now_s) : 0.0;
    const double rest_s =
        devices_.chamber ? std::max(rest_until_s_, now_s + chamber_s) - rest_began_s_ : job_.station.resume_rest_s;
    const double left_s = std::clamp(std::max(rest_until_s_ - now_s, chamber_s), 0.0, rest_s);
    s.phase_fraction = rest_s > 0.0 ? 1.0 - left_s / rest_s : 1.0;
    s.item_end_utc_s = s.utc_s + left_s / job_.station.clock_speed_up;
    s.eta_s += left_s;
  } else if (rest_due_ && !recording_ && (state_ == RunState::connecting || state_ == RunState::homing)) {
    s.eta_s += job_.station.resume_rest_s;
  }
  s.end_utc_s = s.utc_s + s.eta_s / job_.station.clock_speed_up;
  s.moves_left = static_cast<std::size_t>(std::count_if(
      job_.plan.items.begin() + static_cast<std::ptrdiff_t>(std::min(item_, job_.plan.items.size())),
      job_.plan.items.end(), [](const PlannedItem& item) { return item.kind == SequenceItem::Kind::move; }));
  return s;
}

void StationRun::tell_progress() {
  if (hooks_.observer) hooks_.observer->on_progress(snapshot());
}

}  // namespace turncal
