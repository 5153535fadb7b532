// The loop of a run, its actions and its displays. station_watch.cpp judges the table and the units.
#include "orchestrator/run/station_run.h"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <limits>
#include <utility>

#include "imu_io/base/text.h"

namespace turncal {

namespace {

constexpr double check_period_s = 1.0;

// A person turning the table has no deadline; the driver has its own limit for an answer.
MotionConfig patient(MotionConfig motion, bool needs_operator) {
  if (!needs_operator) return motion;
  motion.stall_s = motion.deadline_margin_s = std::numeric_limits<double>::infinity();
  return motion;
}

RunGuard cause_of(RunEvent event) {
  if (event == RunEvent::operator_stop) return RunGuard::by_operator;
  const bool interruption = event == RunEvent::pause_wanted || event == RunEvent::end_wanted;
  return interruption ? RunGuard::by_interruption : RunGuard::by_error;
}

constexpr double homing_deadline_s = 300.0;
// Moves back to where the table should stand, where the sequence gives no rate.
constexpr double return_rate_degps = 10.0;
constexpr double return_acceleration_degps2 = 20.0;

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
  outcome_.repeated_dwells = dwell.repeated_dwells;
  rest_due_ = !resume.no_time_passed;
  for (std::size_t i = 0; i < lanes_.size(); ++i) {
    lanes_[i].resume_at(dwell.units[i], resume.no_time_passed);
    if (i < resume.dropped.size() && resume.dropped[i])
      lanes_[i].drop(device_error("dropped out before the interruption"));
  }
}

RunOutcome StationRun::run() {
  // The table outlives this object, and may be polled after it.
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
  RunOutcome outcome = outcome_;
  outcome.state = state_;
  if (first_error_) outcome.error = *first_error_;
  for (const UnitLane& lane : lanes_) outcome.units.push_back({lane.point(), lane.failure()});
  return outcome;
}

void StationRun::handle(RunEvent event) {
  for (MaybeEvent pending = event; pending;) pending = take(*pending);
}

StationRun::MaybeEvent StationRun::take(RunEvent now) {
  const bool repeats_left =
      any_living([this](const UnitLane& lane) { return lane.repeats < job_.station.dwell.max_repeats; });
  const Transition transition = next(state_, now, guards_of(rest_due_ || devices_.chamber, repeats_left, stop_cause_));
  if (transition.outcome == Transition::Outcome::ignored) {
    detail_.clear();
    return std::nullopt;
  }
  const bool unexpected = transition.outcome == Transition::Outcome::unexpected;
  if (unexpected)
    raise(now, {ErrorKind::internal,
                fmt::format("event {} was not expected in state {}", to_string(now), to_string(state_))});
  TransitionRecord record{snapshot(), state_, now, transition.to, transition.action, unexpected, detail_};
  detail_.clear();
  // Every stop reports one error, the first; later reasons are its consequences.
  if (transition.to == RunState::stopping || (is_final(transition.to) && transition.to != RunState::done)) {
    if (!first_error_) {
      const std::string reason = record.detail.empty() ? std::string(to_string(now)) : record.detail;
      first_error_ = Error{raised_kind_, place() + ": " + reason};
      stop_cause_ = cause_of(now);
    } else if (now == RunEvent::operator_stop && stop_cause_ == RunGuard::by_interruption) {
      first_error_ = Error{raised_kind_, place() + ": " + record.detail};
      stop_cause_ = RunGuard::by_operator;
    } else if (now == RunEvent::stopped_verified && !devices_.table.needs_operator()) {
      first_error_->message += "; " + how_it_rests(devices_.table);
    }
    if (transition.to == RunState::failed && now == RunEvent::deadline) {
      outcome_.stop_failed = !outcome_.left;
      record.detail = outcome_.left ? devices_.chamber->not_verified() : stop_.not_verified("");
      first_error_ = Error{ErrorKind::device, record.detail + "; " + first_error_->message};
    }
  }
  // Without a change of state the next poll stays due.
  const bool changed = transition.to != state_;
  state_ = transition.to;
  // A stop goes out at once: neither disk nor terminal may hold it up.
  const bool stop = transition.action == RunAction::stop_table || transition.action == RunAction::abort_table;
  MaybeEvent pending;
  if (stop) pending = perform(transition.action, now);
  for (RunObserver* const one : hooks_.observers) one->on_transition(record);
  if (is_final(state_) && first_error_) record.detail = first_error_->message;
  if (changed && state_ == RunState::selecting) hold();
  const auto write = [journal = hooks_.journal, record = std::move(record)] {
    return journal ? journal->transition(record) : Status{};
  };
  if (stop || is_final(state_)) {  // a failed write changes nothing any more
    storage_.post([write] { static_cast<void>(write()); });
  } else {  // no other action is taken unless it is in the journal
    pending = keep(write);
    if (!pending) pending = perform(transition.action, now);
  }
  if (changed) schedule_poll(devices_.clock.now_s());
  return pending;
}

RunEvent StationRun::raise(RunEvent event, const Error& why) {
  raised_kind_ = why.kind;
  detail_ = why.message;
  return event;
}

StationRun::MaybeEvent StationRun::fault_of(const std::optional<std::string>& said) {
  return said ? MaybeEvent(raise(RunEvent::table_fault, *said)) : std::nullopt;
}

RunEvent StationRun::raise_table(RunEvent event, const Error& error, const std::string& before) {
  if (state_ == RunState::stopping) return raise(event, {error.kind, before + error.message});
  if (error.kind == ErrorKind::interrupted) return raise(RunEvent::end_wanted, error);
  if (error.kind != ErrorKind::aborted) {
    // A configuration that has moved the table is valid, so a refusal in mid-run is a device error.
    const bool in_mid_run = error.kind == ErrorKind::input && outcome_.moved;
    return raise(event, {in_mid_run ? ErrorKind::device : error.kind, before + error.message});
  }
  if (asked_to_stop_anew()) ++stops_seen_;
  return raise_stop();
}

StationRun::MaybeEvent StationRun::taken(const Status& command, const std::string& what) {
  return command ? std::nullopt : MaybeEvent(raise_table(RunEvent::table_fault, command.error(), what));
}

Error asked_to_stop(bool ended) {
  return ended ? Error{ErrorKind::interrupted, "told to end (SIGTERM, SIGHUP or the like)"}
               : Error{ErrorKind::aborted, "stopped by the operator"};
}

RunEvent StationRun::raise_stop() {
  const int ends = hooks_.end_requests ? hooks_.end_requests->load() : 0;
  const bool ended = ends > 0 && hooks_.stop_requests && ends >= hooks_.stop_requests->load();
  return raise(ended ? RunEvent::end_wanted : RunEvent::operator_stop, asked_to_stop(ended));
}

StationRun::MaybeEvent StationRun::asked() {
  if (asked_to_stop_anew()) {
    ++stops_seen_;
    return raise_stop();
  }
  if (!pause_asked() || pause_told_) return std::nullopt;
  pause_told_ = true;
  // A table turned by hand is at rest; whoever pauses while asked for a turn need not make it.
  if (devices_.table.needs_operator() && in({RunState::homing, RunState::moving}))
    return raise(RunEvent::end_wanted, {ErrorKind::interrupted, "paused"});
  return raise(RunEvent::pause_wanted, {ErrorKind::interrupted, format_pause(snapshot())});
}

RunEvent StationRun::pause() {
  pause_told_ = true;
  return raise(RunEvent::pause_wanted, {ErrorKind::interrupted, "paused"});
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
    case RunAction::abort_table: static_cast<void>(stop_.abort(devices_.clock.now_s()).ok()); return std::nullopt;
  }
  return std::nullopt;
}

RunEvent StationRun::not_stored() const {
  return state_ == RunState::connecting    ? RunEvent::connect_failed
         : state_ == RunState::calibrating ? RunEvent::calibration_failed
                                           : RunEvent::storage_failed;
}

StationRun::MaybeEvent StationRun::kept(const Status& status) {
  return status ? std::nullopt : MaybeEvent(raise(not_stored(), status.error()));
}

StationRun::MaybeEvent StationRun::keep(std::function<Status()> write) {
  const PendingWrite written(storage_, std::move(write));
  for (; !written.done(); BackgroundQueue::wait_a_little())
    if (const MaybeEvent event = look_around()) return event;
  return kept(written.status());
}

StationRun::MaybeEvent StationRun::journalled(std::function<Status(RunJournal&)> write) {
  if (!hooks_.journal) return std::nullopt;
  return keep([journal = hooks_.journal, write = std::move(write)] { return write(*journal); });
}

StationRun::MaybeEvent StationRun::look_at_storage() {
  if (state_ == RunState::stopping) return std::nullopt;
  if (const MaybeEvent hangs = kept(storage_.status())) return hangs;
  const double now_s = devices_.clock.now_s();
  if (check_ && check_->done())
    if (const MaybeEvent lost = kept(std::exchange(check_, std::nullopt)->status())) return lost;
  if (!check_ && hooks_.check_kept && in(live_states) && now_s >= next_check_s_) {
    next_check_s_ = now_s + check_period_s;
    check_.emplace(storage_, hooks_.check_kept);
  }
  return std::nullopt;
}

StationRun::MaybeEvent StationRun::look_around() {
  if (const MaybeEvent hangs = kept(storage_.status())) return hangs;
  if (asked_to_stop_anew()) return asked();
  receive_meanwhile();
  if (const MaybeEvent wrong = look_at_chamber()) return wrong;
  if (!in(live_states) || devices_.clock.now_s() < next_poll_s_ - time_slack_s) return std::nullopt;
  MaybeEvent event = read_table();
  if (!event) event = judge_motion();
  schedule_poll(devices_.clock.now_s());
  return event;
}

// ---- before the first item of the sequence and after the last: connect, home, rest after an interruption, stop

StationRun::MaybeEvent StationRun::connect() {
  if (devices_.chamber) {  // first, so that a chamber that was left on goes off whatever else fails
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
    if (unit)
      found += "; " + named(lane, *unit);
    else if (const MaybeEvent event = fail(lane, RunEvent::connect_failed, unit.error()))
      return event;
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
    const bool as_left = std::ranges::all_of(all_axes, [this](Axis axis) {
      const AxisStatus& status = status_[index(axis)];
      return status.homed && !status.moving && !out_of_tolerance(axis, commanded_deg_[axis]);
    });
    if (as_left) {
      detail_ = "the encoders stand as the last completed dwell left them";
      return RunEvent::homed;
    }
    rest_due_ = true;
    for (UnitLane& lane : lanes_) lane.expect_gap();
  }
  if (const MaybeEvent event = read_table()) return event;
  if (!table_stands()) {  // the program that commanded this motion is gone
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
  const TableCommand home{devices_.clock.now_s(), std::nullopt};
  if (const MaybeEvent event = journalled([home](RunJournal& journal) { return journal.command(home); })) return event;
  outcome_.moved = true;
  return taken(devices_.table.home(), "homing: ");
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
  // The motion of the axes until the deadline shows whether the stop was obeyed; a refusal is reported with the outcome.
  if (const Status stopped = stop_.stop(now_s); !stopped)
    detail_ = "the braking stop was refused: " + stopped.error().message;
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
    detail_ = fmt::format("{}, {:.6g} s", item.dwell_kind == SegmentKind::align ? "align" : "dwell", item.duration_s);
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
    const Result<std::optional<std::size_t>> next = hooks_.go_on_with(item_, outcome());
    if (!next) return kept(next.error());
    if (*next && **next < item_) {  // repeats the dwell
      --item_;
      ++outcome_.repeated_dwells;
      asked_of_item_ = item_;
    } else if (*next && **next > item_) {
      item_ = std::min(**next, items.size());
      asked_of_item_ = item_;
      continue;  // asks about that item, too
    }
    // After skipped items the table first goes to where the next one begins.
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
  const TableCommand sent{devices_.clock.now_s(), move};
  if (const MaybeEvent event = journalled([sent](RunJournal& journal) { return journal.command(sent); })) return event;
  arrival_.start_move(move, from_deg, devices_.clock.now_s());
  speed_.restart(status_, asked_s_, answered_s_);
  for (UnitLane& lane : lanes_)
    if (lane.alive()) lane.felt().begin_turn(SpeedWatch::factor * move.acceleration_degps2);
  outcome_.moved = true;
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
  ++outcome_.repeated_moves;
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
                         .repeated_dwells = outcome_.repeated_dwells,
                         .time_s = devices_.clock.now_s(),
                         .utc_s = devices_.clock.utc_s()};
    std::vector<const RunSink*> sinks;
    for (const UnitLane& lane : lanes_) {
      dwell.units.push_back(lane.point());
      sinks.push_back(&lane.recording());
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
  ++outcome_.repeated_dwells;
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
    Result<std::vector<std::string>> read = hooks_.content_hashes(outcome());
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
    if (const MaybeEvent event = kept(hooks_.calibrate(outcome()))) return event;
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

// ---- where it is, in words and numbers

std::string StationRun::place() const {
  std::string text = enabled_ ? fmt::format("step {} ({}/{}) ", job_.sequence.steps[step_].number, step_ + 1,
                                            job_.sequence.steps.size())
                              : "";
  text += state_words(to_string(state_));
  if (!angles_known_) return text;
  if (in({RunState::moving, RunState::settling}) && arrival_.move()) {
    const Move& move = *arrival_.move();
    return text + fmt::format(", {} at {:.4f} deg, target {:.4f} deg", to_string(move.axis),
                              status_[index(move.axis)].position_deg, move.target_deg);
  }
  return text + fmt::format(" at heading {:.4f} pitch {:.4f} roll {:.4f} deg", status_[0].position_deg,
                            status_[1].position_deg, status_[2].position_deg);
}

std::string format_pause(const RunSnapshot& at) {
  std::string when;
  switch (at.state) {
    case RunState::homing: when = "after homing"; break;
    case RunState::moving: when = "after this move"; break;
    case RunState::settling: when = "after settling"; break;
    case RunState::dwelling: when = "after this dwell"; break;
    case RunState::parking:
    case RunState::calibrating: return "pause asked for: everything is recorded, the run finishes";
    default: return "paused";
  }
  if (at.item_end_utc_s > 0.0) when += ", at " + format_utc(at.item_end_utc_s).substr(11);
  return "pause asked for: " + when;
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
  s.table = unread_ ? state_unread(devices_.table) : state_of(status_, in({RunState::stopping, RunState::parking}));
  for (Axis axis : all_axes) {
    s.position_deg[axis] = status_[index(axis)].position_deg;
    s.rate_degps[axis] = status_[index(axis)].rate_degps;
  }
  if (in({RunState::moving, RunState::settling}) && arrival_.move()) {
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
      s.phase_fraction = 1.0 - double(dwell_left) / double(item.samples);
    } else if (item_running_ && in({RunState::moving, RunState::settling})) {
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
  } else if (rest_due_ && !recording_ && in({RunState::connecting, RunState::homing})) {
    s.eta_s += job_.station.resume_rest_s;
  }
  s.end_utc_s = s.utc_s + s.eta_s / job_.station.clock_speed_up;
  for (std::size_t i = item_; i < job_.plan.items.size(); ++i)
    s.moves_left += job_.plan.items[i].kind == SequenceItem::Kind::move;
  return s;
}

void StationRun::tell_progress() {
  const RunSnapshot at = hooks_.observers.empty() ? RunSnapshot{} : snapshot();
  for (RunObserver* const one : hooks_.observers) one->on_progress(at);
}

}  // namespace turncal
