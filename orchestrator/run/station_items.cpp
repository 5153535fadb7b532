// The items of a sequence: which comes next, moves and dwells, their segments in the recordings, and the end of it.
#include <algorithm>
#include <cassert>
#include <cstdio>
#include <functional>

#include "imu_io/base/format_number.h"
#include "orchestrator/run/station_run.h"

namespace turncal {

namespace {

// Moves back to where the table should stand, where the sequence gives no rate.
constexpr double return_rate_degps = 10.0;
constexpr double return_acceleration_degps2 = 20.0;

}  // namespace

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
    char text[120];
    std::snprintf(text, sizeof text, "%s stands at %.4f deg, should be at %.4f deg: moved there", to_string(*axis),
                  status_[index(*axis)].position_deg, commanded_deg_[*axis]);
    detail_ = text;
    return RunEvent::move_next;
  }
  if (rest_due_ && !recording_) return RunEvent::back_in_place;
  if (!item_left) return RunEvent::step_complete;
  item_running_ = true;
  const PlannedItem& item = items[item_];
  if (item.kind == SequenceItem::Kind::dwell) {
    detail_ =
        (item.dwell_kind == SegmentKind::align ? "align, " : "dwell, ") + std::to_string(item.samples) + " samples";
    return RunEvent::dwell_next;
  }
  pending_move_ = Move{item.axis, item.to_deg, item.rate_degps, item.acceleration_degps2};
  detail_ = std::string(to_string(item.axis)) + " from " + format_number(item.from_deg) + " to " +
            format_number(item.to_deg) + " deg at " + format_number(item.rate_degps) + " deg/s";
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
  if (hooks_.journal) {
    const double now_s = devices_.clock.now_s();
    if (const MaybeEvent event = keep([journal = hooks_.journal, move, now_s] { return journal->move(move, now_s); }))
      return event;
  }
  arrival_.start_move(move, from_deg, devices_.clock.now_s());
  speed_.restart(status_, asked_s_, answered_s_);
  for (UnitLane& lane : lanes_)
    if (lane.alive()) lane.felt().begin_turn(SpeedWatch::factor * move.acceleration_degps2);
  commanded_to_move_ = true;
  if (Status status =
          devices_.table.move_absolute(move.axis, move.target_deg, move.rate_degps, move.acceleration_degps2);
      !status) {
    return raise_table(RunEvent::table_fault, status.error(), "move refused: ");
  }
  return std::nullopt;
}

StationRun::MaybeEvent StationRun::close_move() {
  if (const MaybeEvent event = end_segment(SegmentKind::rotate)) return event;
  if (const std::optional<Move>& move = arrival_.move()) {
    const double turned_deg = status_[index(move->axis)].position_deg - arrival_.from_deg();
    std::vector<const FeltRate*> felt;
    for (UnitLane& lane : lanes_) {
      if (!lane.alive()) continue;
      lane.felt().end_turn(turned_deg);
      felt.push_back(&lane.felt());
    }
    const auto said = devices_.table.needs_operator() ? std::nullopt : SpeedWatch::judge_turn(felt, *move, turned_deg);
    if (said) return raise(RunEvent::table_fault, ErrorKind::device, *said);
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
    dwell_s = static_cast<double>(item.samples) * lane.sample_period_s();
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
    const auto write = [journal = hooks_.journal, dwell, sinks]() mutable {
      for (std::size_t i = 0; i < sinks.size(); ++i) dwell.units[i].written = sinks[i]->written();
      return journal->dwell(dwell);
    };
    if (const MaybeEvent event = keep(write)) return event;
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
  if (hooks_.journal) {
    std::vector<std::string> hashes;
    if (hooks_.content_hashes) {
      if (const MaybeEvent event = in_every_lane(not_stored(), std::mem_fn(&UnitLane::sync))) return event;
      Result<std::vector<std::string>> read = hooks_.content_hashes();
      if (!read) return kept(read.error());
      hashes = std::move(*read);
    }
    const double utc_s = devices_.clock.utc_s();
    if (const MaybeEvent event =
            keep([journal = hooks_.journal, utc_s, hashes] { return journal->seal(utc_s, hashes); }))
      return event;
  }
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
