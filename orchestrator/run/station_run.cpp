// The loop of a run. Its actions: station_table.cpp, station_items.cpp. What the table says is judged in station_watch.cpp, what the
// units do in station_lanes.cpp.
#include "orchestrator/run/station_run.h"

#include <limits>
#include <utility>

#include "imu_io/base/format_number.h"

namespace turncal {

namespace {

constexpr double check_period_s = 1.0;

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
    : storage_(hooks.storage ? *hooks.storage : in_the_loop_),
      devices_(std::move(devices)),
      job_(std::move(job)),
      hooks_(std::move(hooks)),
      lanes_(units.begin(), units.end()),
      commanded_deg_(job_.sequence.start_deg),
      arrival_(patient(job_.station.motion, devices_.table.needs_operator())),
      speed_(job_.station.axis, job_.station.clock_speed_up),
      stop_(devices_.table, job_.station.motion.settle_rate_degps) {
  if (job_.resume) resume_at(*job_.resume);
}

void StationRun::resume_at(const ResumePoint& resume) {
  const CompletedDwell& dwell = resume.after;
  const PlannedItem& item = job_.plan.items[dwell.item];
  item_ = dwell.item + 1;
  step_ = item.step_index;
  commanded_deg_ = item.commanded_deg;
  repeated_dwells_ = dwell.repeated_dwells;
  rest_due_ = !resume.no_time_passed;
  for (std::size_t i = 0; i < lanes_.size(); ++i) {
    lanes_[i].resume_at(dwell.units[i], resume.no_time_passed);
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
    if (const MaybeEvent lost = look_at_storage()) handle(*lost);
    if (const MaybeEvent wrong = look_at_chamber()) handle(*wrong);
    if (const MaybeEvent event = pump()) {
      handle(*event);
    } else if (devices_.clock.now_s() >= next_poll_s_ - time_slack_s) {
      if (const MaybeEvent judged = poll()) handle(*judged);
    }
    tell_progress();
  }
  leave_chamber();
  for (UnitLane& lane : lanes_) lane.close();
  RunOutcome end = outcome();
  end.storage_hangs = !storage_.drain();
  return end;
}

RunOutcome StationRun::outcome() const {
  RunOutcome outcome;
  outcome.state = state_;
  if (first_error_) outcome.error = *first_error_;
  outcome.repeated_dwells = repeated_dwells_;
  outcome.repeated_moves = repeated_moves_;
  outcome.moved = commanded_to_move_;
  outcome.left = left_;
  outcome.stop_failed = stop_failed_;
  for (const UnitLane& lane : lanes_) {
    const RecordingPoint at = lane.point();
    outcome.units.push_back({at.next_sample, at.lost_samples, at.duplicate_samples, lane.failure()});
  }
  return outcome;
}

void StationRun::handle(RunEvent event) {
  for (MaybeEvent pending = event; pending;) pending = take(*pending);
}

StationRun::MaybeEvent StationRun::take(RunEvent now) {
  const RunGuards guards{.rest_due = rest_due_ || devices_.chamber,
                         .repeats_left = any_living(
                             [this](const UnitLane& lane) { return lane.repeats < job_.station.dwell.max_repeats; }),
                         .stop_cause = stop_cause_};
  const Transition transition = next(state_, now, guards);
  if (transition.outcome == Transition::Outcome::ignored) {
    detail_.clear();
    return std::nullopt;
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
    } else if (now == RunEvent::stopped_verified && !devices_.table.needs_operator()) {
      first_error_->message += "; " + how_it_rests(devices_.table);
    }
    if (transition.to == RunState::failed && now == RunEvent::deadline) {
      stop_failed_ = !left_;
      record.detail = left_ ? devices_.chamber->not_verified() : stop_.not_verified("");
      first_error_ = Error{ErrorKind::device, first_error_->message + "; " + record.detail};
    }
  }
  // Where nothing changes, the poll that is due stays due.
  const bool changed = transition.to != state_;
  state_ = transition.to;
  // A stop goes out at once: neither disk nor terminal may hold it up.
  const bool stop = transition.action == RunAction::stop_table || transition.action == RunAction::abort_table;
  MaybeEvent pending;
  if (stop) pending = perform(transition.action, now);
  if (hooks_.observer) hooks_.observer->on_transition(record);
  if (changed && state_ == RunState::selecting) hold();
  const auto write = [journal = hooks_.journal, record = std::move(record)] {
    return journal ? journal->transition(record) : Status{};
  };
  if (stop || is_final(state_)) {  // whether it can be written changes nothing any more
    storage_.post([write] { static_cast<void>(write()); });
  } else {  // anything else does not happen unless it is in the journal
    pending = keep(write);
    if (!pending) pending = perform(transition.action, now);
  }
  if (changed) schedule_poll(devices_.clock.now_s());
  return pending;
}

RunEvent StationRun::raise(RunEvent event, ErrorKind kind, const std::string& reason) {
  raised_kind_ = kind;
  detail_ = reason;
  return event;
}

RunEvent StationRun::raise_table(RunEvent event, const Error& error, const std::string& before) {
  if (state_ == RunState::stopping) return raise(event, error.kind, before + error.message);
  if (error.kind == ErrorKind::interrupted) return raise(RunEvent::end_wanted, error.kind, error.message);
  if (error.kind != ErrorKind::aborted) {
    // A configuration that has moved the table was in order: in mid-run a refusal is the device's.
    const bool in_mid_run = error.kind == ErrorKind::input && commanded_to_move_;
    return raise(event, in_mid_run ? ErrorKind::device : error.kind, before + error.message);
  }
  if (hooks_.stop_requests && hooks_.stop_requests->load() > stops_seen_) ++stops_seen_;
  return raise_stop();
}

Error asked_to_stop(bool ended) {
  return ended ? Error{ErrorKind::interrupted, "told to end (SIGTERM, SIGHUP or the like)"}
               : Error{ErrorKind::aborted, "stopped by the operator"};
}

RunEvent StationRun::raise_stop() {
  const int ends = hooks_.end_requests ? hooks_.end_requests->load() : 0;
  const bool ended = ends > 0 && hooks_.stop_requests && ends >= hooks_.stop_requests->load();
  const Error why = asked_to_stop(ended);
  return raise(ended ? RunEvent::end_wanted : RunEvent::operator_stop, why.kind, why.message);
}

StationRun::MaybeEvent StationRun::asked() {
  if (hooks_.stop_requests && hooks_.stop_requests->load() > stops_seen_) {
    ++stops_seen_;
    return raise_stop();
  }
  if (!pause_asked() || pause_told_) return std::nullopt;
  pause_told_ = true;
  // A table turned by hand stands when nobody turns it: who pauses while asked for a turn need not make it.
  if (devices_.table.needs_operator() && (state_ == RunState::homing || state_ == RunState::moving))
    return raise(RunEvent::end_wanted, ErrorKind::interrupted, "paused");
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

RunEvent StationRun::not_stored() const {
  return state_ == RunState::connecting    ? RunEvent::connect_failed
         : state_ == RunState::calibrating ? RunEvent::calibration_failed
                                           : RunEvent::storage_failed;
}

StationRun::MaybeEvent StationRun::kept(const Status& status) {
  if (status) return std::nullopt;
  return raise(not_stored(), status.error().kind, status.error().message);
}

StationRun::MaybeEvent StationRun::keep(std::function<Status()> write) {
  const PendingWrite written(storage_, std::move(write));
  for (; !written.done(); BackgroundQueue::wait_a_little())
    if (const MaybeEvent event = look_around()) return event;
  return kept(written.status());
}

StationRun::MaybeEvent StationRun::look_at_storage() {
  if (state_ == RunState::stopping) return std::nullopt;
  if (const MaybeEvent hangs = kept(storage_.status())) return hangs;
  const double now_s = devices_.clock.now_s();
  if (check_ && check_->done())
    if (const MaybeEvent lost = kept(std::exchange(check_, std::nullopt)->status())) return lost;
  if (!check_ && hooks_.check_kept && live_states.contains(state_) && now_s >= next_check_s_) {
    next_check_s_ = now_s + check_period_s;
    check_.emplace(storage_, hooks_.check_kept);
  }
  return std::nullopt;
}

StationRun::MaybeEvent StationRun::look_around() {
  if (const MaybeEvent hangs = kept(storage_.status())) return hangs;
  if (hooks_.stop_requests && hooks_.stop_requests->load() > stops_seen_) return asked();
  receive_meanwhile();
  if (const MaybeEvent wrong = look_at_chamber()) return wrong;
  if (!live_states.contains(state_) || devices_.clock.now_s() < next_poll_s_ - time_slack_s) return std::nullopt;
  MaybeEvent event = read_table();
  if (!event) event = judge_motion();
  schedule_poll(devices_.clock.now_s());
  return event;
}

}  // namespace turncal
