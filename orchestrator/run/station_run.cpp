// The loop and the actions of a run. What the table says is judged in station_watch.cpp, what the units do in station_lanes.cpp.
#include "orchestrator/run/station_run.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstdio>
#include <limits>

#include "imu_io/base/format_number.h"

namespace turncal {

namespace {

constexpr double homing_deadline_s = 300.0;

// Moves back to where the table should stand, where the sequence gives no rate.
constexpr double return_rate_degps = 10.0;
constexpr double return_acceleration_degps2 = 20.0;

// A person who turns the table takes the time that it takes; the driver has its own limit for an answer.
MotionConfig patient(MotionConfig motion, bool needs_operator) {
  if (!needs_operator) return motion;
  motion.stall_s = motion.deadline_margin_s = std::numeric_limits<double>::infinity();
  return motion;
}

StopCause cause_of(RunEvent event) {
  if (event == RunEvent::operator_stop) return StopCause::by_operator;
  const bool interruption = event == RunEvent::pause_wanted || event == RunEvent::end_wanted;
  return interruption ? StopCause::interruption : StopCause::error;
}

}  // namespace

StationRun::StationRun(StationDevices devices, StationJob job, const std::vector<StationUnit>& units,
                       StationHooks hooks)
    : devices_(std::move(devices)),
      job_(std::move(job)),
      hooks_(std::move(hooks)),
      lanes_(units.begin(), units.end()),
      commanded_deg_(job_.sequence.start_deg),
      arrival_(patient(job_.station.motion, devices_.table.needs_operator())),
      stop_(devices_.table, job_.station.motion.settle_rate_degps) {
  if (job_.resume) take_up(*job_.resume);
}

void StationRun::take_up(const ResumePoint& resume) {
  const CompletedDwell& dwell = resume.after;
  const PlannedItem& item = job_.plan.items[dwell.item];
  item_ = dwell.item + 1;
  step_ = item.step_index;
  commanded_deg_ = item.commanded_deg;
  repeated_dwells_ = dwell.repeated_dwells;
  rest_due_ = !resume.no_time_passed;
  for (std::size_t i = 0; i < lanes_.size(); ++i) {
    lanes_[i].take_up(dwell.units[i], resume.no_time_passed);
    if (i < resume.dropped.size() && resume.dropped[i])
      lanes_[i].drop(device_error("dropped out before the interruption"));
  }
}

RunOutcome StationRun::run() {
  // The table outlives this object, and may be asked again by whoever leaves it.
  struct Meanwhile {
    Turntable& table;
    ~Meanwhile() { table.set_meanwhile({}); }
  } const meanwhile{devices_.table};
  devices_.table.set_meanwhile([this] { receive_meanwhile(); });
  started_s_ = devices_.clock.now_s();
  handle(RunEvent::start);
  while (!is_final(state_)) {
    if (const MaybeEvent event = asked()) {
      handle(*event);
      continue;
    }
    if (const MaybeEvent event = pump()) {
      handle(*event);
    } else if (devices_.clock.now_s() >= next_poll_s_ - time_slack_s) {
      if (const MaybeEvent judged = poll()) handle(*judged);
    }
    tell_progress();
  }
  for (UnitLane& lane : lanes_) lane.close();
  return outcome();
}

RunOutcome StationRun::outcome() const {
  RunOutcome outcome;
  outcome.state = state_;
  if (first_error_) outcome.error = *first_error_;
  outcome.repeated_dwells = repeated_dwells_;
  outcome.repeated_moves = repeated_moves_;
  for (const UnitLane& lane : lanes_) {
    const RecordingPoint at = lane.point();
    outcome.units.push_back({at.next_sample, at.lost_samples, at.duplicate_samples, lane.failure()});
  }
  return outcome;
}

void StationRun::handle(RunEvent event) {
  MaybeEvent pending = event;
  while (pending) {
    const RunEvent now = *pending;
    const RunGuards guards{.rest_due = rest_due_,
                           .repeats_left = any_living(
                               [this](const UnitLane& lane) { return lane.repeats < job_.station.dwell.max_repeats; }),
                           .stop_cause = stop_cause_,
                           .abort_sent = abort_sent_};
    const Transition transition = next(state_, now, guards);
    if (transition.outcome == Transition::Outcome::ignored) {
      detail_.clear();
      return;
    }
    const bool unexpected = transition.outcome == Transition::Outcome::unexpected;
    if (unexpected) {
      raise(now, ErrorKind::internal,
            "event " + std::string(to_string(now)) + " was not expected in state " + std::string(to_string(state_)));
    }
    TransitionRecord record{snapshot(), state_, now, transition.to, transition.action, unexpected, detail_};
    detail_.clear();
    // Whatever ends in a stop has an error to report, once; later reasons are consequences.
    if (transition.to == RunState::stopping || (is_final(transition.to) && transition.to != RunState::done)) {
      if (!first_error_) {
        const std::string reason = record.detail.empty() ? std::string(to_string(now)) : record.detail;
        first_error_ = Error{raised_kind_, place() + ": " + reason};
        stop_cause_ = cause_of(now);
      } else if (now == RunEvent::operator_stop && stop_cause_ == StopCause::interruption) {
        first_error_ = Error{raised_kind_, place() + ": " + record.detail};
        stop_cause_ = StopCause::by_operator;
      } else if (transition.to == RunState::failed && now == RunEvent::deadline) {
        first_error_->message += "; THE STOP COULD NOT BE VERIFIED, the table may still move";
        first_error_->kind = ErrorKind::device;
      }
    }
    // Where nothing changes, the poll that is due stays due.
    const bool changed = transition.to != state_;
    state_ = transition.to;
    pending.reset();
    // A stop goes out at once: neither disk nor terminal may hold it up.
    const bool stop = transition.action == RunAction::stop_table || transition.action == RunAction::abort_table;
    if (stop) pending = perform(transition.action, now);
    if (hooks_.observer) hooks_.observer->on_transition(record);
    const Status kept = hooks_.journal ? hooks_.journal->transition(record) : Status{};
    // Anything else does not happen unless it is in the journal.
    if (!kept && (live_states.contains(state_) || state_ == RunState::calibrating)) {
      pending = keep(kept);
    } else if (!stop) {
      pending = perform(transition.action, now);
    }
    if (changed) schedule_poll(devices_.clock.now_s());
  }
}

RunEvent StationRun::raise(RunEvent event, ErrorKind kind, const std::string& reason) {
  raised_kind_ = kind;
  detail_ = reason;
  return event;
}

RunEvent StationRun::raise_table(RunEvent event, const Error& error, const std::string& before) {
  if (state_ == RunState::stopping) return raise(event, error.kind, before + error.message);
  if (error.kind == ErrorKind::interrupted) return raise(RunEvent::end_wanted, error.kind, error.message);
  if (error.kind != ErrorKind::aborted) return raise(event, error.kind, before + error.message);
  if (hooks_.stop_requests && hooks_.stop_requests->load() > stops_seen_) ++stops_seen_;
  return raise_stop();
}

RunEvent StationRun::raise_stop() {
  const int ends = hooks_.end_requests ? hooks_.end_requests->load() : 0;
  const bool ended = ends > 0 && hooks_.stop_requests && ends >= hooks_.stop_requests->load();
  return ended ? raise(RunEvent::end_wanted, ErrorKind::interrupted, "told to end (SIGTERM or SIGHUP)")
               : raise(RunEvent::operator_stop, ErrorKind::aborted, "stopped by the operator");
}

StationRun::MaybeEvent StationRun::asked() {
  if (hooks_.stop_requests && hooks_.stop_requests->load() > stops_seen_) {
    ++stops_seen_;
    return raise_stop();
  }
  if (!pause_asked() || pause_told_) return std::nullopt;
  pause_told_ = true;
  // A table turned by hand stands when nobody turns it: who pauses while asked for a turn need not make it.
  if (devices_.table.needs_operator() && (state_ == RunState::homing || state_ == RunState::moving)) {
    return raise(RunEvent::end_wanted, ErrorKind::interrupted, "paused");
  }
  return raise(RunEvent::pause_wanted, ErrorKind::interrupted, format_pause(snapshot()));
}

RunEvent StationRun::pause() {
  pause_told_ = true;
  return raise(RunEvent::pause_wanted, ErrorKind::interrupted, "paused");
}

StationRun::MaybeEvent StationRun::perform(RunAction action, RunEvent cause) {
  switch (action) {
    case RunAction::none:
    case RunAction::watch_settling:
    case RunAction::watch_moving:
    case RunAction::announce: return std::nullopt;
    case RunAction::connect: return connect();
    case RunAction::enable_and_home: return enable_and_home();
    case RunAction::begin_rest: return begin_rest();
    case RunAction::settle_again: return settle_again(cause == RunEvent::back_in_place);
    case RunAction::select_next:
      if (cause == RunEvent::step_next) ++step_;
      return select_next();
    case RunAction::issue_move: return issue_move();
    case RunAction::close_move: return close_move();
    case RunAction::begin_dwell: return begin_dwell();
    case RunAction::close_dwell: return close_dwell();
    case RunAction::discard_dwell: return discard_dwell();
    case RunAction::discard_move: return discard_move();
    case RunAction::finish_step: return finish_step();
    case RunAction::calibrate: return calibrate();
    case RunAction::stop_table: return stop_table();
    case RunAction::abort_table: return abort_table();
  }
  return std::nullopt;
}

StationRun::MaybeEvent StationRun::keep(const Status& status) {
  if (status) return std::nullopt;
  const RunEvent event = state_ == RunState::connecting    ? RunEvent::connect_failed
                         : state_ == RunState::calibrating ? RunEvent::calibration_failed
                                                           : RunEvent::storage_failed;
  return raise(event, status.error().kind, status.error().message);
}

StationRun::MaybeEvent StationRun::connect() {
  if (Status status = devices_.table.connect(); !status) return raise_table(RunEvent::connect_failed, status.error());
  const Result<TableIdentity> table = devices_.table.identify();
  if (!table) return raise_table(RunEvent::connect_failed, table.error());
  std::string found = table->description;
  for (UnitLane& lane : lanes_) {
    if (!lane.alive()) continue;
    const Result<std::string> unit =
        lane.connect(job_.station, table->simulated, job_.resume.has_value(), devices_.clock.now_s());
    if (unit) {
      found += "; " + named(lane, *unit);
    } else if (const MaybeEvent event = fail(lane, RunEvent::connect_failed, unit.error())) {
      return event;
    }
  }
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
  phase_deadline_s_ = devices_.table.needs_operator() ? std::numeric_limits<double>::infinity()
                                                      : devices_.clock.now_s() + homing_deadline_s;
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
  if (!at_rest()) {  // whoever commanded this is gone
    if (Status status = devices_.table.stop_all(); !status) {
      return raise_table(RunEvent::table_fault, status.error(), "stopping: ");
    }
    return std::nullopt;
  }
  return send_home();
}

StationRun::MaybeEvent StationRun::send_home() {
  home_sent_ = true;
  if (hooks_.journal) {
    if (const MaybeEvent event = keep(hooks_.journal->home(devices_.clock.now_s()))) return event;
  }
  if (Status status = devices_.table.home(); !status) {
    return raise_table(RunEvent::table_fault, status.error(), "homing: ");
  }
  return std::nullopt;
}

bool StationRun::stands_as_left() const {
  for (Axis axis : all_axes) {
    const AxisStatus& status = status_[static_cast<std::size_t>(axis)];
    if (!status.homed || status.moving || out_of_tolerance(axis, commanded_deg_[axis])) return false;
  }
  return true;
}

StationRun::MaybeEvent StationRun::begin_rest() {
  if (pause_asked()) return pause();
  rest_until_s_ = devices_.clock.now_s() + job_.station.resume_rest_s;
  hold();
  detail_ = "rests for " + format_number(job_.station.resume_rest_s) + " s after the interruption";
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

void StationRun::hold() {
  for (Axis axis : all_axes) held_deg_[axis] = status_[static_cast<std::size_t>(axis)].position_deg;
}

StationRun::MaybeEvent StationRun::select_next() {
  if (const MaybeEvent event = read_table()) return event;
  if (pause_asked() && item_ < job_.plan.items.size()) return pause();
  const std::vector<PlannedItem>& items = job_.plan.items;
  const bool item_left = item_ < items.size() && items[item_].step_index == step_;
  if (const std::optional<Axis> axis = displaced_axis()) {
    const AxisLimits& limits = job_.station.axis[static_cast<std::size_t>(*axis)];
    pending_move_ = Move{*axis, commanded_deg_[*axis], std::min(return_rate_degps, limits.max_rate_degps),
                         std::min(return_acceleration_degps2, limits.max_acceleration_degps2)};
    item_running_ = false;
    char text[120];
    std::snprintf(text, sizeof text, "%s stands at %.4f deg, should be at %.4f deg: moved there", to_string(*axis),
                  status_[static_cast<std::size_t>(*axis)].position_deg, commanded_deg_[*axis]);
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
  const double from_deg = status_[static_cast<std::size_t>(move.axis)].position_deg;
  if (hooks_.journal) {
    if (const MaybeEvent event = keep(hooks_.journal->move(move, devices_.clock.now_s()))) return event;
  }
  arrival_.start_move(move, from_deg, devices_.clock.now_s());
  if (Status status =
          devices_.table.move_absolute(move.axis, move.target_deg, move.rate_degps, move.acceleration_degps2);
      !status) {
    return raise_table(RunEvent::table_fault, status.error(), "move refused: ");
  }
  return std::nullopt;
}

StationRun::MaybeEvent StationRun::close_move() {
  if (const MaybeEvent event = end_segment(SegmentKind::rotate)) return event;
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
  for (Axis axis : all_axes) dwell_start_deg_[axis] = status_[static_cast<std::size_t>(axis)].position_deg;
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
    if (const MaybeEvent event = in_every_lane([](UnitLane& lane) { return lane.sync(); })) return event;
    CompletedDwell dwell{.item = item_,
                         .units = {},
                         .repeated_dwells = repeated_dwells_,
                         .time_s = devices_.clock.now_s(),
                         .utc_s = devices_.clock.utc_s()};
    for (const UnitLane& lane : lanes_) dwell.units.push_back(lane.point());
    if (const MaybeEvent event = keep(hooks_.journal->dwell(dwell))) return event;
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
  item_running_ = false;
  hold();
  arrival_.settle_only(devices_.clock.now_s());
  begin_segment(SegmentKind::rotate);
  return std::nullopt;
}

StationRun::MaybeEvent StationRun::finish_step() {
  if (const MaybeEvent event = in_every_lane([](UnitLane& lane) { return lane.sync(); })) return event;
  return step_ + 1 < job_.sequence.steps.size() ? RunEvent::step_next : RunEvent::sequence_complete;
}

StationRun::MaybeEvent StationRun::calibrate() {
  if (hooks_.journal) {
    std::vector<std::string> hashes;
    if (hooks_.content_hashes) {
      if (const MaybeEvent event = in_every_lane([](UnitLane& lane) { return lane.sync(); })) return event;
      Result<std::vector<std::string>> read = hooks_.content_hashes();
      if (!read) return keep(read.error());
      hashes = std::move(*read);
    }
    if (const MaybeEvent event = keep(hooks_.journal->seal(devices_.clock.utc_s(), hashes))) return event;
  }
  if (const MaybeEvent event = in_every_lane([](UnitLane& lane) { return lane.finish(); })) return event;
  tell_progress();
  if (hooks_.calibrate) {
    if (const MaybeEvent event = keep(hooks_.calibrate())) return event;
  }
  return RunEvent::calibration_ok;
}

StationRun::MaybeEvent StationRun::stop_table() {
  recording_ = false;
  for (UnitLane& lane : lanes_) lane.leave_segment();
  double brake_s = 0.0;
  for (const PlannedItem& item : job_.plan.items) {
    if (item.kind == SequenceItem::Kind::move) brake_s = std::max(brake_s, item.rate_degps / item.acceleration_degps2);
  }
  const double now_s = devices_.clock.now_s();
  phase_deadline_s_ = now_s + 2.0 * brake_s + job_.station.motion.deadline_margin_s;
  stop_.begin();
  // Whether it was taken is judged by what the axes do until the deadline.
  abort_sent_ = !stop_.stop(now_s).ok();
  return std::nullopt;
}

StationRun::MaybeEvent StationRun::abort_table() {
  abort_sent_ = true;
  phase_deadline_s_ = devices_.clock.now_s() + job_.station.motion.deadline_margin_s;
  static_cast<void>(stop_.abort(devices_.clock.now_s()).ok());
  return std::nullopt;
}

void StationRun::begin_segment(SegmentKind kind) {
  if (!recording_) return;
  const Segment segment{.step = job_.sequence.steps[step_].number,
                        .kind = kind,
                        .heading_deg = commanded_deg_[Axis::heading],
                        .pitch_deg = commanded_deg_[Axis::pitch],
                        .roll_deg = commanded_deg_[Axis::roll]};
  for (UnitLane& lane : lanes_) {
    if (lane.alive()) lane.begin_segment(segment);
  }
}

StationRun::MaybeEvent StationRun::end_segment(SegmentKind kind) {
  return in_every_lane([&](UnitLane& lane) { return lane.end_segment(kind, commanded_deg_); });
}

}  // namespace turncal
