// A run before the first item of its sequence and after the last: connect, home, rest after an interruption, stop.
#include <algorithm>
#include <limits>

#include "imu_io/base/format_number.h"
#include "orchestrator/run/station_run.h"

namespace turncal {

namespace {

constexpr double homing_deadline_s = 300.0;

}  // namespace

StationRun::MaybeEvent StationRun::connect() {
  if (devices_.chamber) {  // first: one that was left on goes off, whatever else fails
    if (const Status chamber = devices_.chamber->connect(); !chamber)
      return raise(RunEvent::connect_failed, chamber.error().kind, chamber.error().message);
  }
  if (Status status = devices_.table.connect(); !status) return raise_table(RunEvent::connect_failed, status.error());
  const Result<TableIdentity> table = devices_.table.identify();
  if (!table) return raise_table(RunEvent::connect_failed, table.error());
  std::string found = table->description;
  for (UnitLane& lane : lanes_) {
    if (!lane.alive()) continue;
    const Result<std::string> unit = lane.connect(job_.station, table->simulated, devices_.clock);
    if (unit) {
      found += "; " + named(lane, *unit);
    } else if (const MaybeEvent event = fail(lane, RunEvent::connect_failed, unit.error())) {
      return event;
    }
  }
  for (const UnitLane& lane : lanes_)
    if (devices_.chamber && lane.alive() && !lane.tells_temperature())
      return raise(RunEvent::connect_failed, ErrorKind::input,
                   named(lane, "the unit tells no temperature: expected one that does, for chamber.limit_unit_c"));
  if (devices_.chamber) found += "; " + devices_.chamber->text();
  const auto begin = [this](UnitLane& lane) { return lane.begin_recording(job_.resume.has_value()); };
  if (const MaybeEvent event = in_every_lane(RunEvent::connect_failed, begin)) return event;
  if (pause_asked()) return pause();
  std::string left;
  for (Axis axis : all_axes) {
    if (!job_.taken_up) break;
    const Result<AxisStatus> status = devices_.table.status(axis);
    if (!status) return raise_table(RunEvent::connect_failed, status.error());
    if (!status->fault) continue;
    fault_left_ = true;
    left += std::string("; clears the fault of axis ") + to_string(axis) +
            (status->text.empty() ? "" : ": " + status->text);
  }
  detail_ = found + left;
  return RunEvent::connected;
}

StationRun::MaybeEvent StationRun::enable_and_home() {
  enabled_ = true;
  if (fault_left_) {
    if (Status status = devices_.table.clear_fault(); !status) {
      return raise_table(RunEvent::table_fault, status.error(), "clearing the fault: ");
    }
  }
  if (Status status = devices_.table.enable(); !status) {
    return raise_table(RunEvent::table_fault, status.error(), "enabling: ");
  }
  if (job_.resume && job_.resume->no_time_passed) {
    if (const MaybeEvent event = read_table()) return event;
    if (stands_as_left()) {
      detail_ = "the encoders stand as the last completed dwell left them";
      return RunEvent::homed;
    }
    rest_due_ = true;
    for (UnitLane& lane : lanes_) lane.expect_gap();
  }
  if (const MaybeEvent event = read_table()) return event;
  if (!table_stands()) {  // whoever commanded this is gone
    if (Status status = devices_.table.stop_all(); !status) {
      return raise_table(RunEvent::table_fault, status.error(), "stopping: ");
    }
    homing_ends_in(brake_s());
    return std::nullopt;
  }
  return send_home();
}

void StationRun::homing_ends_in(double seconds) {
  const bool by_hand = devices_.table.needs_operator();
  phase_deadline_s_ = by_hand ? std::numeric_limits<double>::infinity() : devices_.clock.now_s() + seconds;
}

StationRun::MaybeEvent StationRun::send_home() {
  home_sent_ = true;
  homing_ends_in(homing_deadline_s);
  if (!devices_.table.needs_operator()) homing_.emplace(job_.station.axis);
  if (hooks_.journal) {
    const double now_s = devices_.clock.now_s();
    if (const MaybeEvent event = keep([journal = hooks_.journal, now_s] { return journal->home(now_s); })) return event;
  }
  commanded_to_move_ = true;
  if (Status status = devices_.table.home(); !status) {
    return raise_table(RunEvent::table_fault, status.error(), "homing: ");
  }
  return std::nullopt;
}

bool StationRun::stands_as_left() const {
  for (Axis axis : all_axes) {
    const AxisStatus& status = status_[index(axis)];
    if (!status.homed || status.moving || out_of_tolerance(axis, commanded_deg_[axis])) return false;
  }
  return true;
}

StationRun::MaybeEvent StationRun::begin_rest() {
  if (pause_asked()) return pause();
  const double now_s = devices_.clock.now_s(), rest_s = rest_due_ ? job_.station.resume_rest_s : 0.0;
  rest_began_s_ = now_s;
  rest_until_s_ = now_s + rest_s;
  hold();
  if (devices_.chamber) {
    devices_.chamber->bring_to(*job_.temperature_c, job_.station.chamber->described.limits.ramp_c_per_min, now_s);
    detail_ = "brings the chamber to " + format_number(*job_.temperature_c) + " C" + (rest_due_ ? ", " : "");
  }
  if (rest_due_) detail_ += "rests for " + format_number(job_.station.resume_rest_s) + " s after the interruption";
  return std::nullopt;
}

StationRun::MaybeEvent StationRun::settle_again(bool in_place) {
  recording_ = in_place;
  item_running_ = false;
  hold();
  arrival_.settle_only(devices_.clock.now_s());
  begin_segment(SegmentKind::rotate);
  return std::nullopt;
}

StationRun::MaybeEvent StationRun::stop_table() {
  recording_ = false;
  for (UnitLane& lane : lanes_) lane.leave_segment();
  const double now_s = devices_.clock.now_s();
  stop_.begin(now_s, brake_s());
  // Whether it was taken is judged by what the axes do until the deadline.
  static_cast<void>(stop_.stop(now_s).ok());
  phase_deadline_s_ = now_s + brake_s() + job_.station.motion.deadline_margin_s;
  if (!chamber_rests()) {
    devices_.chamber->switch_off();
    chamber_until_s_ = now_s + ChamberKeeper::off_limit_s;
  }
  return std::nullopt;
}

double StationRun::brake_s() const {
  double ramp_s = 0.0;
  for (const PlannedItem& item : job_.plan.items)
    if (item.kind == SequenceItem::Kind::move) ramp_s = std::max(ramp_s, item.rate_degps / item.acceleration_degps2);
  return 2.0 * ramp_s + job_.station.motion.stall_s;
}

StationRun::MaybeEvent StationRun::abort_table() {
  static_cast<void>(stop_.abort(devices_.clock.now_s()).ok());
  return std::nullopt;
}

}  // namespace turncal
