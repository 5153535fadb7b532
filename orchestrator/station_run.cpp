// The loop and the actions of a run. What is read from the devices and judged is in station_watch.cpp.
#include "orchestrator/station_run.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstdio>
#include <limits>

#include "imu_io/format_number.h"
#include "orchestrator/run_log.h"

namespace turncal {

namespace {

constexpr std::size_t buffer_samples = 1024;
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

StationRun::StationRun(StationDevices devices, StationJob job, RunSink& sink, StationHooks hooks)
    : devices_(std::move(devices)),
      job_(std::move(job)),
      sink_(sink),
      hooks_(std::move(hooks)),
      commanded_deg_(job_.sequence.start_deg),
      arrival_(patient(job_.station.motion, devices_.table.needs_operator())),
      buffer_(buffer_samples) {
  if (job_.resume) take_up(*job_.resume);
}

void StationRun::take_up(const ResumePoint& resume) {
  const CompletedDwell& dwell = resume.after;
  const PlannedItem& item = job_.plan.items[dwell.item];
  item_ = dwell.item + 1;
  step_ = item.step_index;
  commanded_deg_ = item.commanded_deg;
  next_sample_ = dwell.next_sample;
  outcome_.recorded_samples = dwell.next_sample;
  outcome_.repeated_dwells = dwell.repeated_dwells;
  outcome_.lost_samples = dwell.lost_samples;
  outcome_.duplicate_samples = dwell.duplicate_samples;
  gap_due_ = !resume.no_time_passed;
  if (gap_due_) return;
  first_counter_ = dwell.first_counter;
  last_counter_ = dwell.last_counter;
}

RunOutcome StationRun::run() {
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
  outcome_.state = state_;
  if (first_error_) outcome_.error = *first_error_;
  devices_.imu.close();
  return outcome_;
}

void StationRun::handle(RunEvent event) {
  MaybeEvent pending = event;
  while (pending) {
    const RunEvent now = *pending;
    const RunGuards guards{.rest_due = gap_due_,
                           .repeats_left = repeats_ < job_.station.dwell.max_repeats,
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
    if (!kept && live_states.contains(state_)) {
      pending = keep(kept);
    } else if (!kept && state_ == RunState::calibrating) {
      pending = raise(RunEvent::calibration_failed, kept.error().kind, kept.error().message);
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
    case RunAction::settle_recorded: return settle_recorded();
    case RunAction::select_next:
      if (cause == RunEvent::step_next) ++step_;
      return select_next();
    case RunAction::issue_move: return issue_move();
    case RunAction::close_move: return close_move();
    case RunAction::begin_dwell: return begin_dwell();
    case RunAction::close_dwell: return close_dwell();
    case RunAction::discard_dwell: return discard_dwell();
    case RunAction::finish_step: return finish_step();
    case RunAction::calibrate: return calibrate();
    case RunAction::stop_table: return stop_table();
    case RunAction::abort_table: return abort_table();
  }
  return std::nullopt;
}

StationRun::MaybeEvent StationRun::keep(const Status& status) {
  if (status) return std::nullopt;
  return raise(RunEvent::storage_failed, status.error().kind, status.error().message);
}

StationRun::MaybeEvent StationRun::connect() {
  const auto failed = [this](const Error& error) {
    return raise(RunEvent::connect_failed, error.kind, error.message);
  };
  if (Status status = devices_.table.connect(); !status) return raise_table(RunEvent::connect_failed, status.error());
  const Result<TableIdentity> table = devices_.table.identify();
  if (!table) return raise_table(RunEvent::connect_failed, table.error());
  if (Status status = devices_.imu.open(); !status) return failed(status.error());
  imu_open_ = true;
  const Result<ImuIdentity> imu = devices_.imu.identify();
  if (!imu) return failed(imu.error());
  if (!imu->unit_serial.empty() && imu->unit_serial != job_.unit_serial) {
    return failed(input_error("the unit on the table says it is '" + imu->unit_serial + "', asked for was '" +
                              job_.unit_serial + "'"));
  }
  devices_.imu.describe(info_);
  info_.latitude_deg = job_.station.latitude_deg;
  info_.gravity_mps2 = job_.station.gravity_mps2;
  info_.unit_serial = job_.unit_serial;
  info_.simulated = info_.simulated || table->simulated;
  dwell_.emplace(job_.station.dwell, info_);
  const Status begun = job_.resume ? sink_.resume(info_, next_sample_) : sink_.start(info_);
  if (!begun) return failed(begun.error());
  last_sample_s_ = devices_.clock.now_s();
  if (pause_asked()) return pause();
  detail_ = table->description + "; " + imu->description;
  return RunEvent::connected;
}

StationRun::MaybeEvent StationRun::enable_and_home() {
  enabled_ = true;
  phase_deadline_s_ = devices_.table.needs_operator() ? std::numeric_limits<double>::infinity()
                                                      : devices_.clock.now_s() + homing_deadline_s;
  if (Status status = devices_.table.enable(); !status) {
    return raise_table(RunEvent::table_fault, status.error(), "enabling: ");
  }
  if (job_.resume && job_.resume->no_time_passed) {
    if (const MaybeEvent event = read_table()) return event;
    if (stands_as_left()) {
      detail_ = "the encoders stand as the last completed dwell left them";
      return RunEvent::homed;
    }
    gap_due_ = true;
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
  detail_ = "rests for " + format_number(job_.station.resume_rest_s) + " s after the interruption";
  return std::nullopt;
}

StationRun::MaybeEvent StationRun::settle_recorded() {
  recording_ = true;
  item_running_ = false;
  arrival_.settle_only(devices_.clock.now_s());
  return begin_segment(SegmentKind::rotate);
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
  if (!item_left) return RunEvent::step_complete;
  item_running_ = true;
  const PlannedItem& item = items[item_];
  if (item.kind == SequenceItem::Kind::dwell) {
    detail_ = (item.dwell_kind == SegmentKind::align ? "align, " : "dwell, ") + std::to_string(item.samples) + " samples";
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
  motion_loss_told_ = false;
  if (const MaybeEvent event = begin_segment(SegmentKind::rotate)) return event;
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
  if (item_running_) ++item_;
  item_running_ = false;
  return select_next();
}

StationRun::MaybeEvent StationRun::begin_dwell() {
  const PlannedItem& item = job_.plan.items[item_];
  recording_ = true;
  if (const MaybeEvent event = begin_segment(item.dwell_kind)) return event;
  dwell_->start(next_sample_, item.samples);
  for (Axis axis : all_axes) dwell_start_deg_[axis] = status_[static_cast<std::size_t>(axis)].position_deg;
  const double dwell_s = static_cast<double>(item.samples) * info_.sample_period_s;
  phase_deadline_s_ = devices_.clock.now_s() + 1.1 * dwell_s + job_.station.motion.deadline_margin_s;
  return std::nullopt;
}

StationRun::MaybeEvent StationRun::close_dwell() {
  if (const MaybeEvent event = end_segment(job_.plan.items[item_].dwell_kind)) return event;
  if (hooks_.journal) {
    if (const MaybeEvent event = keep(sink_.sync())) return event;
    const CompletedDwell dwell{.item = item_,
                               .next_sample = next_sample_,
                               .first_counter = first_counter_.value_or(0),
                               .last_counter = last_counter_.value_or(0),
                               .repeated_dwells = outcome_.repeated_dwells,
                               .lost_samples = outcome_.lost_samples,
                               .duplicate_samples = outcome_.duplicate_samples,
                               .time_s = devices_.clock.now_s(),
                               .utc_s = devices_.clock.utc_s()};
    if (const MaybeEvent event = keep(hooks_.journal->dwell(dwell))) return event;
  }
  repeats_ = 0;
  ++item_;
  item_running_ = false;
  return select_next();
}

StationRun::MaybeEvent StationRun::discard_dwell() {
  if (const MaybeEvent event = end_segment(SegmentKind::rotate)) return event;
  ++repeats_;
  ++outcome_.repeated_dwells;
  item_running_ = false;
  arrival_.settle_only(devices_.clock.now_s());
  return begin_segment(SegmentKind::rotate);
}

StationRun::MaybeEvent StationRun::finish_step() {
  if (const MaybeEvent event = keep(sink_.sync())) return event;
  return step_ + 1 < job_.sequence.steps.size() ? RunEvent::step_next : RunEvent::sequence_complete;
}

StationRun::MaybeEvent StationRun::calibrate() {
  const auto failed = [this](const Error& error) {
    return raise(RunEvent::calibration_failed, error.kind, error.message);
  };
  if (hooks_.journal) {
    if (Status status = hooks_.journal->seal(devices_.clock.utc_s()); !status) return failed(status.error());
  }
  if (Status status = sink_.finish(); !status) return failed(status.error());
  tell_progress();
  if (hooks_.calibrate) {
    if (Status status = hooks_.calibrate(); !status) return failed(status.error());
  }
  return RunEvent::calibration_ok;
}

StationRun::MaybeEvent StationRun::stop_table() {
  recording_ = false;
  double brake_s = 0.0;
  for (const PlannedItem& item : job_.plan.items) {
    if (item.kind == SequenceItem::Kind::move) brake_s = std::max(brake_s, item.rate_degps / item.acceleration_degps2);
  }
  phase_deadline_s_ = devices_.clock.now_s() + 2.0 * brake_s + job_.station.motion.deadline_margin_s;
  if (Status status = devices_.table.stop_all(); !status) return abort_table();
  return std::nullopt;
}

StationRun::MaybeEvent StationRun::abort_table() {
  abort_sent_ = true;
  phase_deadline_s_ = devices_.clock.now_s() + job_.station.motion.deadline_margin_s;
  // Whether it was taken is judged by what the axes do until the deadline.
  if (Status status = devices_.table.abort_all(); !status) link_down_ = true;
  return std::nullopt;
}

StationRun::MaybeEvent StationRun::begin_segment(SegmentKind kind) {
  if (!recording_) return std::nullopt;
  const Segment segment{.step = job_.sequence.steps[step_].number,
                        .kind = kind,
                        .start_sample = next_sample_,
                        .end_sample = next_sample_,
                        .heading_deg = commanded_deg_[Axis::heading],
                        .pitch_deg = commanded_deg_[Axis::pitch],
                        .roll_deg = commanded_deg_[Axis::roll]};
  segment_open_ = true;
  return keep(sink_.begin_segment(segment));
}

StationRun::MaybeEvent StationRun::end_segment(SegmentKind kind) {
  if (!segment_open_) return std::nullopt;
  segment_open_ = false;
  return keep(sink_.end_segment(kind, next_sample_, commanded_deg_));
}

std::string StationRun::place() const {
  std::string text;
  if (enabled_) {
    text = "step " + std::to_string(job_.sequence.steps[step_].number) + " (" + std::to_string(step_ + 1) + "/" +
           std::to_string(job_.sequence.steps.size()) + ") ";
  }
  text += to_string(state_);
  if (!enabled_) return text;
  char angles[200];
  if ((state_ == RunState::moving || state_ == RunState::settling) && arrival_.move()) {
    const Move& move = *arrival_.move();
    std::snprintf(angles, sizeof angles, ", %s at %.4f deg, target %.4f deg", to_string(move.axis),
                  status_[static_cast<std::size_t>(move.axis)].position_deg, move.target_deg);
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
  for (Axis axis : all_axes) {
    s.position_deg[axis] = status_[static_cast<std::size_t>(axis)].position_deg;
    s.rate_degps[axis] = status_[static_cast<std::size_t>(axis)].rate_degps;
  }
  if ((state_ == RunState::moving || state_ == RunState::settling) && arrival_.move()) {
    s.axis = arrival_.move()->axis;
    s.target_deg = arrival_.move()->target_deg;
  }
  s.repeats = repeats_;
  s.lost_samples = outcome_.lost_samples;
  double planned_s = job_.plan.station_s;
  if (item_ < job_.plan.items.size()) {
    const PlannedItem& item = job_.plan.items[item_];
    planned_s = item.start_s;
    if (state_ == RunState::dwelling) {
      s.dwell_kind = item.dwell_kind;
      s.phase_fraction = 1.0 - static_cast<double>(dwell_->remaining()) / static_cast<double>(item.samples);
    } else if (item_running_ && (state_ == RunState::moving || state_ == RunState::settling)) {
      s.phase_fraction = std::clamp(
          (s.position_deg[item.axis] - item.from_deg) / (item.to_deg - item.from_deg) + 0.0, 0.0, 1.0);
    }
    planned_s += s.phase_fraction * item.duration_s;
    if (state_ == RunState::dwelling || (state_ == RunState::moving && item_running_)) {
      s.item_end_utc_s = s.utc_s + (1.0 - s.phase_fraction) * item.duration_s / job_.station.clock_speed_up;
    }
  }
  s.run_fraction = job_.plan.station_s > 0.0 ? planned_s / job_.plan.station_s : 0.0;
  s.eta_s = std::max(0.0, job_.plan.station_s - planned_s);
  s.moves_left = static_cast<std::size_t>(
      std::count_if(job_.plan.items.begin() + static_cast<std::ptrdiff_t>(std::min(item_, job_.plan.items.size())), job_.plan.items.end(),
                    [](const PlannedItem& item) { return item.kind == SequenceItem::Kind::move; }));
  return s;
}

void StationRun::tell_progress() {
  if (hooks_.observer) hooks_.observer->on_progress(snapshot());
}

}  // namespace turncal
