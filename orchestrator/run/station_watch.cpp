// Watches table and units for a run: polls the table and judges it; reads the units, judges their samples, and drops
// those that fail.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

#include "orchestrator/run/station_run.h"
#include "turntable_drivers/table/table_state.h"

namespace turncal {

namespace {

constexpr std::size_t read_samples = 1024;       // at a time
constexpr std::size_t catch_up_samples = 65536;  // more than any line holds
constexpr int status_tries = 3;

bool by_operator(const Error& error) {
  return error.kind == ErrorKind::aborted || error.kind == ErrorKind::interrupted;
}

}  // namespace

StationRun::MaybeEvent StationRun::poll() {
  const double now_s = devices_.clock.now_s();
  MaybeEvent event = read_table();
  if (state_ == RunState::stopping) {
    detail_.clear();  // a link that fails now is not a new reason
    event = judge_stop(now_s);
  } else if (!event) {
    event = judge(now_s);
  }
  // Timed from now, so that a slow line never keeps the units from being read.
  schedule_poll(devices_.clock.now_s());
  return event;
}

// Judges the motion without waiting for the commanded axis to stall. A person who turns the table may touch any axis.
StationRun::MaybeEvent StationRun::judge_motion() {
  if (devices_.table.needs_operator() || state_ == RunState::parking) return std::nullopt;
  const bool searches = state_ == RunState::homing;
  const std::optional<Move> move = in({RunState::moving, RunState::settling}) ? arrival_.move() : std::nullopt;
  const double tolerance_deg = job_.station.motion.position_tolerance_deg;
  // A slip is corrected by a move, but not during another move or rest.
  const bool put_right = !move && state_ != RunState::resting;
  const double standing_deg = put_right ? least_runaway_deg(tolerance_deg) : tolerance_deg;
  auto said = searches ? std::nullopt : stray_axis(status_, held_deg_, move, standing_deg, tolerance_deg);
  if (!said) said = speed_.add(status_, asked_s_, answered_s_, move, searches);
  if (!said) said = speed_.add_felt(felt(), status_, move, searches);
  return fault_of(said);
}

std::vector<const FeltRate*> StationRun::felt() const {
  std::vector<const FeltRate*> units;
  for (const UnitLane& lane : lanes_)
    if (lane.alive()) units.push_back(&lane.felt());
  return units;
}

StationRun::MaybeEvent StationRun::judge(double now_s) {
  if (const MaybeEvent event = judge_motion()) return event;
  switch (state_) {
    case RunState::homing: return judge_homing(now_s);
    case RunState::resting:
      if (now_s < rest_until_s_ - time_slack_s || (devices_.chamber && !devices_.chamber->settled()))
        return std::nullopt;
      if (devices_.chamber) detail_ = devices_.chamber->text() + ", settled";
      return RunEvent::rest_over;
    case RunState::parking: return judge_stop(now_s);
    case RunState::dwelling: return judge_dwell();
    case RunState::moving:
    case RunState::settling: break;
    default: return std::nullopt;
  }
  const MaybeEvent event = arrival_.update(status_, now_s);
  if (event == RunEvent::settled) {
    // Samples sent while the table still turned belong to the move, not to the next dwell.
    if (const MaybeEvent late = catch_up()) return late;
    if (!unit_awaited_) await_until_s_ = now_s + job_.station.imu_timeout_s;
    unit_awaited_ = recording_ && apart() && now_s < await_until_s_;
    if (unit_awaited_) return std::nullopt;
    if (const MaybeEvent bad = judge_move()) return bad;
  }
  const char* axis = arrival_.move() ? to_string(arrival_.move()->axis) : "table";
  if (event == RunEvent::stall)
    return raise(*event, fmt::format("{} has made no progress for {:g} s (stall)", axis, job_.station.motion.stall_s));
  if (event == RunEvent::deadline)
    return raise(*event, fmt::format("{} has not settled within the {:.1f} s it may take", axis, arrival_.allowed_s()));
  return event;
}

StationRun::MaybeEvent StationRun::read_table() {
  asked_s_ = devices_.clock.now_s();
  for (Axis axis : all_axes) {
    Error error;
    bool answered = false;
    for (int i = 0; i < status_tries && !answered; ++i) {
      if (Result<AxisStatus> status = devices_.table.status(axis)) {
        status_[index(axis)] = std::move(*status);
        answered = true;
      } else {
        error = status.error();
        if (by_operator(error)) break;
      }
    }
    if (!answered && by_operator(error)) return raise_table(RunEvent::link_lost, error);
    if (!answered) {
      unread_ = true;
      const bool answers = devices_.table.answers();
      return raise(answers ? RunEvent::table_fault : RunEvent::link_lost,
                   fmt::format("{} axis {}: {}", answers ? "no reading of" : "the table does not answer for",
                               to_string(axis), error.message));
    }
  }
  unread_ = false;
  angles_known_ = true;
  answered_s_ = devices_.clock.now_s();
  if (!in(live_states)) return std::nullopt;
  const bool in_use = !in({RunState::homing, RunState::parking});
  for (Axis axis : all_axes) {
    const AxisStatus& status = status_[index(axis)];
    const std::string trouble = trouble_of(axis, status, in_use);
    if (!trouble.empty()) return raise(status.emergency_stop ? RunEvent::e_stop : RunEvent::table_fault, trouble);
  }
  return std::nullopt;
}

bool StationRun::table_stands() const {
  return std::ranges::all_of(status_, [this](const AxisStatus& axis) {
    return !axis.moving && std::abs(axis.rate_degps) <= job_.station.motion.settle_rate_degps;
  });
}

StationRun::MaybeEvent StationRun::judge_homing(double now_s) {
  if (!home_sent_ && table_stands()) return send_home();
  for (Axis axis : all_axes) {
    const AxisStatus& status = status_[index(axis)];
    // home() found the drive on.
    if (home_sent_ && !status.enabled) return raise(RunEvent::table_fault, trouble_of(axis, status, true));
  }
  if (homing_)
    if (const MaybeEvent lost = fault_of(homing_->add(status_))) return lost;
  const bool homed =
      std::ranges::all_of(status_, [](const AxisStatus& axis) { return axis.homed && axis.enabled && !axis.moving; });
  if (home_sent_ && homed) return RunEvent::homed;
  if (now_s > phase_deadline_s_)
    return raise(RunEvent::deadline, home_sent_
                                         ? "the axes did not find their zero"
                                         : "the table was told to stop before it is homed, and does not come to rest");
  return std::nullopt;
}

StationRun::MaybeEvent StationRun::judge_dwell() {
  bad_lane_ = nullptr;
  // A slip is corrected and the dwell repeated. An axis that reads further away turns by itself, or its encoder lost count: no move back.
  if (!devices_.table.needs_operator()) {
    const double slip_deg = least_runaway_deg(job_.station.motion.position_tolerance_deg);
    const auto stray = stray_axis(status_, dwell_start_deg_, std::nullopt, slip_deg, slip_deg);
    if (const MaybeEvent fault = fault_of(stray)) return fault;
  }
  for (Axis axis : all_axes) {
    const AxisStatus& status = status_[index(axis)];
    if (out_of_tolerance(axis, dwell_start_deg_[axis]) || out_of_tolerance(axis, commanded_deg_[axis]))
      return raise(RunEvent::dwell_bad, fmt::format("the table moved: {} from {:.4f} to {:.4f} deg", to_string(axis),
                                                    dwell_start_deg_[axis], status.position_deg));
    if (status.moving || !(std::abs(status.rate_degps) <= job_.station.motion.settle_rate_degps))
      return raise(RunEvent::dwell_bad,
                   fmt::format("the table moves: {} at {:.4g} deg/s", to_string(axis), status.rate_degps));
  }
  if (devices_.clock.now_s() <= phase_deadline_s_) return std::nullopt;
  for (UnitLane& lane : lanes_) {
    // A table that answers late delays the count, not the unit.
    if (!lane.alive() || lane.dwell_received()) continue;
    const Error slow = device_error("the IMU's samples come too slowly for its period" + lane.came_instead());
    if (const MaybeEvent event = fail(lane, RunEvent::deadline, slow)) return event;
  }
  return std::nullopt;
}

StationRun::MaybeEvent StationRun::judge_stop(double now_s) {
  if (stop_.look(unread_ ? nullptr : &status_, now_s)) {
    outcome_.left = status_;
    if (chamber_rests()) return RunEvent::stopped_verified;
    if (now_s <= chamber_until_s_) return std::nullopt;
    return raise(RunEvent::deadline, "the chamber did not switch off");
  }
  if (now_s <= phase_deadline_s_) return std::nullopt;
  if (state_ == RunState::parking) return raise(RunEvent::deadline, "the drives did not switch off");
  return RunEvent::deadline;
}

bool StationRun::chamber_rests() const { return !devices_.chamber || devices_.chamber->is_off(); }

StationRun::MaybeEvent StationRun::look_at_chamber() {
  if (!devices_.chamber) return std::nullopt;
  std::optional<double> warmest_c;
  for (const UnitLane& lane : lanes_)
    if (lane.alive() && lane.temperature_c()) warmest_c = std::max(warmest_c.value_or(-1e3), *lane.temperature_c());
  const std::string fault = devices_.chamber->look(warmest_c, devices_.clock.now_s());
  if (fault.empty() || !in(live_states)) return std::nullopt;
  return raise(RunEvent::chamber_fault, fault);
}

// Switches the chamber off when no stop has done so: the run ended before it used the table.
void StationRun::leave_chamber() {
  if (!devices_.chamber || !devices_.chamber->is_connected() || chamber_rests()) return;
  if (chamber_until_s_ > 0.0 && devices_.clock.now_s() > chamber_until_s_) return;
  const auto off = leave_off(*devices_.chamber, {[this] { return devices_.clock.now_s(); }, devices_.wait, {}, {}, {}});
  if (off) return;
  state_ = RunState::failed;
  first_error_ = device_error((first_error_ ? first_error_->message + "; " : "") + off.error().message);
}

void StationRun::schedule_poll(double now_s) {
  const MotionConfig& motion = job_.station.motion;
  const bool resting = in({RunState::dwelling, RunState::homing, RunState::resting});
  next_poll_s_ = now_s + (resting ? motion.poll_idle_s : motion.poll_moving_s);
  if (in({RunState::moving, RunState::settling}) && !unit_awaited_)
    next_poll_s_ = std::min(next_poll_s_, arrival_.moment_of_interest_s(now_s));
}

std::optional<Axis> StationRun::displaced_axis() const {
  for (Axis axis : {Axis::roll, Axis::pitch, Axis::heading})
    if (out_of_tolerance(axis, commanded_deg_[axis])) return axis;
  return std::nullopt;
}

bool StationRun::out_of_tolerance(Axis axis, double from_deg) const {
  return !(std::abs(status_[index(axis)].position_deg - from_deg) <= job_.station.motion.position_tolerance_deg);
}

// ---- the units

StationRun::MaybeEvent StationRun::fail(UnitLane& lane, RunEvent event, const Error& error) {
  const bool others = any_living([&lane](const UnitLane& other) { return &other != &lane; });
  const bool going_on = in(live_states) || in({RunState::connecting, RunState::calibrating});
  // The last of several units: all have dropped out, for whatever reason.
  if (!others || !going_on)
    return raise(event, {lanes_.size() > 1 ? ErrorKind::device : error.kind, named(lane, error.message)});
  const Error why{error.kind, place() + ": " + error.message};
  lane.drop(why);
  const Dropout dropout{std::uint64_t(&lane - lanes_.data() + 1), lane.serial(), why, snapshot()};
  for (RunObserver* const one : hooks_.observers) one->on_dropout(dropout);
  return journalled([dropout](RunJournal& journal) { return journal.dropout(dropout); });
}

StationRun::MaybeEvent StationRun::in_every_lane(RunEvent event,
                                                 const std::function<UnitLane::Write(UnitLane&)>& step) {
  std::vector<UnitLane::Write> writes;
  for (UnitLane& lane : lanes_) writes.push_back(lane.alive() ? step(lane) : UnitLane::Write());
  const auto results = std::make_shared<std::vector<Status>>(lanes_.size());
  const MaybeEvent first = keep([results, writes = std::move(writes)] {
    for (std::size_t i = 0; i < writes.size(); ++i)
      if (writes[i]) (*results)[i] = writes[i]();
    return Status{};
  });
  if (first) return first;
  for (std::size_t i = 0; i < lanes_.size(); ++i) {
    if ((*results)[i]) continue;
    if (const MaybeEvent failed = fail(lanes_[i], event, (*results)[i].error())) return failed;
  }
  return std::nullopt;
}

std::string StationRun::named(const UnitLane& lane, const std::string& text) const {
  return lanes_.size() > 1 ? "unit " + lane.serial() + ": " + text : text;
}

UnitLane* StationRun::lead() {
  UnitLane* first = nullptr;
  for (UnitLane& lane : lanes_) {
    if (!lane.alive() || !lane.is_open()) continue;
    if (state_ != RunState::dwelling || !lane.dwell_complete()) return &lane;
    if (!first) first = &lane;
  }
  return first;
}

void StationRun::receive_meanwhile() {
  for (UnitLane& lane : lanes_) lane.receive_meanwhile(devices_.clock.now_s());
}

StationRun::MaybeEvent StationRun::pump() {
  for (UnitLane& lane : lanes_) {
    if (!lane.alive() || !lane.trouble() || state_ == RunState::stopping) continue;
    if (const MaybeEvent event = fail(lane, RunEvent::imu_lost, *lane.trouble())) return event;
  }
  UnitLane* const lead_lane = lead();
  const double period_s = lead_lane ? lead_lane->sample_period_s() : lanes_.front().sample_period_s();
  const double now_s = devices_.clock.now_s();
  const double wanted_s = std::max(next_poll_s_ - now_s, 0.0);
  if (!lead_lane) {
    devices_.wait(std::max(wanted_s, period_s));
    return std::nullopt;
  }
  // A poll that is due comes first; what has arrived meanwhile waits in the source.
  if (wanted_s < time_slack_s) return std::nullopt;
  auto count = std::size_t(std::max(1.0, std::ceil((wanted_s - time_slack_s) / period_s)));
  if (state_ == RunState::dwelling) count = std::min(count, std::size_t(lead_lane->dwell_remaining()));
  count = std::clamp<std::size_t>(count, 1, read_samples);
  // Half a period more, so that rounding costs no sample.
  const Result<std::size_t> got = lead_lane->receive(count, (double(count) + 0.5) * period_s);
  if (!got) return fail(*lead_lane, RunEvent::imu_lost, got.error());
  if (*got > 0) lead_lane->heard(devices_.clock.now_s());
  for (UnitLane& lane : lanes_) {
    if (&lane != lead_lane)
      if (const MaybeEvent event = receive_all(lane)) return event;
    const double silent_s = devices_.clock.now_s() - lane.last_sample_s();
    if (!lane.is_open() || state_ == RunState::stopping || silent_s <= job_.station.imu_timeout_s) continue;
    const Error silent = device_error("no sample from the IMU for " + std::to_string(std::lround(silent_s)) + " s" +
                                      lane.came_instead());
    if (const MaybeEvent event = fail(lane, RunEvent::imu_lost, silent)) return event;
  }
  return record_all();
}

StationRun::MaybeEvent StationRun::receive_all(UnitLane& lane) {
  for (std::size_t left = catch_up_samples; lane.is_open() && left > 0;) {
    const Result<std::size_t> got = lane.receive(std::min(left, read_samples), 0.0);
    if (!got) return fail(lane, RunEvent::imu_lost, got.error());
    if (*got == 0) break;
    left -= *got;
    lane.heard(devices_.clock.now_s());
  }
  return std::nullopt;
}

StationRun::MaybeEvent StationRun::catch_up() {
  for (UnitLane& lane : lanes_) {
    if (const MaybeEvent event = receive_all(lane)) return event;
    if (const MaybeEvent event = record(lane)) {
      if (*event != RunEvent::motion_data_lost) return event;
      handle(*event);
    }
  }
  return std::nullopt;
}

bool StationRun::apart() const {
  std::int64_t least = std::numeric_limits<std::int64_t>::max(), most = 0;
  double period_s = 1.0;
  const double late_s = 0.5 * job_.station.motion.settle_s, now_s = devices_.clock.now_s();
  for (const UnitLane& lane : lanes_) {
    if (!lane.alive() || !lane.is_open()) continue;
    if (now_s - lane.last_sample_s() > late_s) return true;
    least = std::min(least, lane.came_in_segment());
    most = std::max(most, lane.came_in_segment());
    period_s = lane.sample_period_s();
  }
  return least <= most && double(most - least) > std::max(late_s / period_s, 2.0);
}

StationRun::MaybeEvent StationRun::record_all() {
  for (UnitLane& lane : lanes_)
    if (const MaybeEvent event = record(lane)) return event;
  if (state_ != RunState::dwelling) return std::nullopt;
  if (any_living([](const UnitLane& lane) { return !lane.dwell_complete(); })) return std::nullopt;
  // The table decides last whether it stood still.
  if (const MaybeEvent event = read_table()) return event;
  if (const MaybeEvent event = judge_dwell()) return event;
  return RunEvent::dwell_complete;
}

StationRun::MaybeEvent StationRun::record(UnitLane& lane) {
  if (!lane.alive()) return std::nullopt;
  const bool dwelling = state_ == RunState::dwelling;
  const Result<UnitLane::Recorded> recorded = lane.record(dwelling, storage_);
  if (!recorded) return fail(lane, RunEvent::storage_failed, recorded.error());
  if (dwelling) return recorded->defect ? judge_defect(lane, *recorded->defect) : std::nullopt;
  if (!arrival_.move() || lane.motion_lost || (!recorded->gap && !recorded->flagged)) return std::nullopt;
  lane.motion_lost = true;
  return raise(RunEvent::motion_data_lost,
               named(lane, (recorded->gap ? "samples lost" : recorded->what) +
                               " while the table turned, before sample " + std::to_string(lane.next_sample())));
}

// Judges the samples of a move that has settled. A lane with lost samples and no repeat left drops out, and the others do not repeat the move.
StationRun::MaybeEvent StationRun::judge_move() {
  if (!item_running_) return std::nullopt;
  const std::string what =
      std::string("samples lost, flagged or doubled while ") + to_string(job_.plan.items[item_].axis) + " turned";
  for (UnitLane& lane : lanes_) {
    if (!lane.alive() || !lane.motion_lost || lane.repeats < job_.station.dwell.max_repeats) continue;
    const Error error = device_error(what + ", and the move was repeated " + counted(lane.repeats, "time"));
    if (const MaybeEvent event = fail(lane, RunEvent::move_bad, error)) return event;
  }
  if (!any_living([](const UnitLane& lane) { return lane.motion_lost; })) return std::nullopt;
  return raise(RunEvent::move_bad, what + ": goes back and repeats the move");
}

StationRun::MaybeEvent StationRun::judge_defect(UnitLane& lane, const DwellMonitor::Defect& defect) {
  bad_lane_ = &lane;
  if (lane.repeats >= job_.station.dwell.max_repeats)
    return fail(lane, RunEvent::dwell_bad, {defect.kind, defect.reason});
  return raise(RunEvent::dwell_bad, {defect.kind, named(lane, defect.reason)});
}

}  // namespace turncal
