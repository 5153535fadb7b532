// The actions of a run. Before the first item of its sequence and after the last: connect, home, rest after an interruption, stop. Its items:
// which comes next, moves and dwells, their segments in the recordings, and the end of it.
#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <limits>

#include "imu_io/base/text.h"
#include "orchestrator/run/station_run.h"

namespace turncal {

namespace {

constexpr double homing_deadline_s = 300.0;
// Moves back to where the table should stand, where the sequence gives no rate.
constexpr double return_rate_degps = 10.0;
constexpr double return_acceleration_degps2 = 20.0;

}  // namespace

StationRun::MaybeEvent StationRun::connect() {
  if (devices_.chamber) {  // first: one that was left on goes off, whatever else fails
    if (const Status chamber = devices_.chamber->connect(); !chamber)
      return raise(RunEvent::connect_failed, chamber.error());
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
      return raise(RunEvent::connect_failed, input_error(named(lane,
                                                               "the unit tells no temperature: expected one that "
                                                               "does, for chamber.limit_unit_c")));
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
  if (fault_left_)
    if (const MaybeEvent event = taken(devices_.table.clear_fault(), "clearing the fault: ")) return event;
  if (const MaybeEvent event = taken(devices_.table.enable(), "enabling: ")) return event;
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
    if (const MaybeEvent event = taken(devices_.table.stop_all(), "stopping: ")) return event;
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
  const auto write = [now_s = devices_.clock.now_s()](RunJournal& journal) { return journal.home(now_s); };
  if (const MaybeEvent event = journalled(write)) return event;
  commanded_to_move_ = true;
  return taken(devices_.table.home(), "homing: ");
}

bool StationRun::stands_as_left() const {
  return std::ranges::all_of(all_axes, [this](Axis axis) {
    const AxisStatus& status = status_[index(axis)];
    return status.homed && !status.moving && !out_of_tolerance(axis, commanded_deg_[axis]);
  });
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

// ---- the items

void StationRun::hold() {
  for (Axis axis : all_axes) held_deg_[axis] = status_[index(axis)].position_deg;
}

StationRun::MaybeEvent StationRun::select_next() {
  if (const MaybeEvent event = read_table()) return event;
  if (pause_asked() && item_ < job_.plan.items.size()) return pause();
  if (const MaybeEvent event = leave_out()) return event;
  const std::vector<PlannedItem>& items = job_.plan.items;
  const bool item_left = item_ < items.size() && items[item_].step_index == step_;
  if (const std::optional<Axis> axis = displaced_axis()) {
    const AxisLimits& limits = job_.station.axis[index(*axis)];
    pending_move_ = Move{*axis, commanded_deg_[*axis], std::min(return_rate_degps, limits.max_rate_degps),
                         std::min(return_acceleration_degps2, limits.max_acceleration_degps2)};
    item_running_ = false;
    detail_ = fmt::format("{} stands at {:.4f} deg, should be at {:.4f} deg: moved there", to_string(*axis),
                          status_[index(*axis)].position_deg, commanded_deg_[*axis]);
    return RunEvent::move_next;
  }
  if (rest_due_ && !recording_) return RunEvent::back_in_place;
  if (!item_left) return RunEvent::step_complete;
  item_running_ = true;
  const PlannedItem& item = items[item_];
  if (item.kind == SequenceItem::Kind::dwell) {
    detail_ = fmt::format("{}, {} samples", item.dwell_kind == SegmentKind::align ? "align" : "dwell", item.samples);
    return RunEvent::dwell_next;
  }
  pending_move_ = Move{item.axis, item.to_deg, item.rate_degps, item.acceleration_degps2};
  detail_ = fmt::format("{} from {} to {} deg at {} deg/s", to_string(item.axis), format_number(item.from_deg),
                        format_number(item.to_deg), format_number(item.rate_degps));
  return RunEvent::move_next;
}

StationRun::MaybeEvent StationRun::leave_out() {
  const std::vector<PlannedItem>& items = job_.plan.items;
  if (!hooks_.go_on_with || item_ == asked_of_item_ || items[item_ - 1].kind != SequenceItem::Kind::dwell)
    return std::nullopt;
  asked_of_item_ = item_;
  while (true) {
    const Result<std::optional<std::size_t>> next = hooks_.go_on_with(item_);
    if (!next) return kept(next.error());
    if (*next && **next < item_) {  // the dwell once more
      --item_;
      ++repeated_dwells_;
      asked_of_item_ = item_;
    } else if (*next && **next > item_) {
      item_ = std::min(**next, items.size());
      asked_of_item_ = item_;
      continue;  // what comes there is asked, too
    }
    // Where something follows what was left out, the table first goes where that begins.
    if (*next && item_ > 0 && item_ < items.size()) commanded_deg_ = items[item_ - 1].commanded_deg;
    if (*next) return std::nullopt;
    if (const MaybeEvent event = look_around()) return event;
  }
}

StationRun::MaybeEvent StationRun::issue_move() {
  assert(pending_move_);
  const Move move = *pending_move_;
  if (item_running_) {
    recording_ = true;
    commanded_deg_ = job_.plan.items[item_].commanded_deg;
  }
  for (UnitLane& lane : lanes_) lane.motion_lost = false;
  hold();
  begin_segment(SegmentKind::rotate);
  const double from_deg = status_[index(move.axis)].position_deg;
  const auto write = [move, now_s = devices_.clock.now_s()](RunJournal& journal) { return journal.move(move, now_s); };
  if (const MaybeEvent event = journalled(write)) return event;
  arrival_.start_move(move, from_deg, devices_.clock.now_s());
  speed_.restart(status_, asked_s_, answered_s_);
  for (UnitLane& lane : lanes_)
    if (lane.alive()) lane.felt().begin_turn(SpeedWatch::factor * move.acceleration_degps2);
  commanded_to_move_ = true;
  return taken(devices_.table.move_absolute(move.axis, move.target_deg, move.rate_degps, move.acceleration_degps2),
               "move refused: ");
}

StationRun::MaybeEvent StationRun::close_move() {
  if (const MaybeEvent event = end_segment(SegmentKind::rotate)) return event;
  if (const std::optional<Move>& move = arrival_.move()) {
    const double turned_deg = status_[index(move->axis)].position_deg - arrival_.from_deg();
    for (UnitLane& lane : lanes_)
      if (lane.alive()) lane.felt().end_turn(turned_deg);
    if (!devices_.table.needs_operator())
      if (const MaybeEvent event = fault_of(SpeedWatch::judge_turn(felt(), *move, turned_deg))) return event;
  }
  pending_move_.reset();
  if (item_running_) {
    ++item_;
    forget_repeats();
  }
  item_running_ = false;
  return select_next();
}

void StationRun::forget_repeats() {
  repeats_ = 0;
  for (UnitLane& lane : lanes_) lane.repeats = 0;
}

StationRun::MaybeEvent StationRun::discard_move() {
  if (const MaybeEvent event = end_segment(SegmentKind::rotate)) return event;
  ++repeats_;
  ++repeated_moves_;
  for (UnitLane& lane : lanes_) lane.repeats += lane.motion_lost ? 1 : 0;
  const PlannedItem& item = job_.plan.items[item_];
  commanded_deg_[item.axis] = item.from_deg;
  pending_move_.reset();
  item_running_ = false;
  return select_next();
}

StationRun::MaybeEvent StationRun::begin_dwell() {
  const PlannedItem& item = job_.plan.items[item_];
  recording_ = true;
  begin_segment(item.dwell_kind);
  for (Axis axis : all_axes) dwell_start_deg_[axis] = status_[index(axis)].position_deg;
  double dwell_s = 0.0;
  for (UnitLane& lane : lanes_) {
    if (!lane.alive()) continue;
    lane.begin_dwell(item.samples);
    dwell_s = double(item.samples) * lane.sample_period_s();
  }
  phase_deadline_s_ = devices_.clock.now_s() + 1.1 * dwell_s + job_.station.motion.deadline_margin_s;
  return std::nullopt;
}

StationRun::MaybeEvent StationRun::close_dwell() {
  if (const MaybeEvent event = end_segment(job_.plan.items[item_].dwell_kind)) return event;
  if (hooks_.journal) {
    if (const MaybeEvent event = in_every_lane(not_stored(), std::mem_fn(&UnitLane::sync))) return event;
    CompletedDwell dwell{.item = item_,
                         .units = {},
                         .repeated_dwells = repeated_dwells_,
                         .time_s = devices_.clock.now_s(),
                         .utc_s = devices_.clock.utc_s()};
    std::vector<const RunSink*> sinks;
    for (const UnitLane& lane : lanes_) {
      dwell.units.push_back(lane.point());
      sinks.push_back(&lane.sink());
    }
    const auto write = [dwell, sinks](RunJournal& journal) mutable {
      for (std::size_t i = 0; i < sinks.size(); ++i) dwell.units[i].written = sinks[i]->written();
      return journal.dwell(dwell);
    };
    if (const MaybeEvent event = journalled(write)) return event;
  }
  forget_repeats();
  ++item_;
  item_running_ = false;
  return select_next();
}

StationRun::MaybeEvent StationRun::discard_dwell() {
  if (const MaybeEvent event = end_segment(SegmentKind::rotate)) return event;
  ++repeats_;
  ++repeated_dwells_;
  for (UnitLane& lane : lanes_) lane.repeats += !bad_lane_ || bad_lane_ == &lane ? 1 : 0;
  return settle_again(recording_);
}

StationRun::MaybeEvent StationRun::finish_step() {
  if (const MaybeEvent event = in_every_lane(not_stored(), std::mem_fn(&UnitLane::sync))) return event;
  return step_ + 1 < job_.sequence.steps.size() ? RunEvent::step_next : RunEvent::sequence_complete;
}

StationRun::MaybeEvent StationRun::calibrate() {
  std::vector<std::string> hashes;
  if (hooks_.content_hashes) {
    if (const MaybeEvent event = in_every_lane(not_stored(), std::mem_fn(&UnitLane::sync))) return event;
    Result<std::vector<std::string>> read = hooks_.content_hashes();
    if (!read) return kept(read.error());
    hashes = std::move(*read);
  }
  const auto seal = [utc_s = devices_.clock.utc_s(), hashes](RunJournal& journal) {
    return journal.seal(utc_s, hashes);
  };
  if (const MaybeEvent event = journalled(seal)) return event;
  if (const MaybeEvent event = in_every_lane(not_stored(), std::mem_fn(&UnitLane::finish))) return event;
  tell_progress();
  if (hooks_.calibrate)
    if (const MaybeEvent event = kept(hooks_.calibrate())) return event;
  return RunEvent::calibration_ok;
}

void StationRun::begin_segment(SegmentKind kind) {
  if (!recording_) return;
  const Segment segment{.step = job_.sequence.steps[step_].number,
                        .kind = kind,
                        .heading_deg = commanded_deg_[Axis::heading],
                        .pitch_deg = commanded_deg_[Axis::pitch],
                        .roll_deg = commanded_deg_[Axis::roll]};
  for (UnitLane& lane : lanes_)
    if (lane.alive()) lane.begin_segment(segment);
}

StationRun::MaybeEvent StationRun::end_segment(SegmentKind kind) {
  const auto end = [&](UnitLane& lane) { return lane.end_segment(kind, commanded_deg_); };
  if (const MaybeEvent event = in_every_lane(RunEvent::storage_failed, end)) return event;
  return in_every_lane(RunEvent::unit_wrong, std::mem_fn(&UnitLane::fits));
}

}  // namespace turncal
