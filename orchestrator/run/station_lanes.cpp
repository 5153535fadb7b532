// The units of a run: reading them, what is made of their samples, and what becomes of one that fails.
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

#include "orchestrator/run/station_run.h"

namespace turncal {

namespace {

constexpr std::size_t read_samples = 1024;       // at a time
constexpr std::size_t catch_up_samples = 65536;  // more than any line holds

}  // namespace

StationRun::MaybeEvent StationRun::fail(UnitLane& lane, RunEvent event, const Error& error) {
  const bool others = any_living([&lane](const UnitLane& other) { return &other != &lane; });
  const bool going_on =
      live_states.contains(state_) || state_ == RunState::connecting || state_ == RunState::calibrating;
  if (!others || !going_on) {
    // Of a run of several the last one: whatever it was, all have dropped out.
    return raise(event, lanes_.size() > 1 ? ErrorKind::device : error.kind, named(lane, error.message));
  }
  const Error why{error.kind, place() + ": " + error.message};
  lane.drop(why);
  const Dropout dropout{static_cast<std::size_t>(&lane - lanes_.data()), lane.serial(), why, snapshot()};
  if (hooks_.observer) hooks_.observer->on_dropout(dropout);
  if (!hooks_.journal) return std::nullopt;
  return keep([journal = hooks_.journal, dropout] { return journal->dropout(dropout); });
}

StationRun::MaybeEvent StationRun::in_every_lane(RunEvent event,
                                                 const std::function<UnitLane::Write(UnitLane&)>& step) {
  std::vector<UnitLane::Write> writes;
  for (UnitLane& lane : lanes_) writes.push_back(lane.alive() ? step(lane) : UnitLane::Write());
  const auto results = std::make_shared<std::vector<Status>>(lanes_.size());
  const MaybeEvent first = keep([results, writes = std::move(writes)] {
    for (std::size_t i = 0; i < writes.size(); ++i) {
      if (writes[i]) (*results)[i] = writes[i]();
    }
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
  auto count = static_cast<std::size_t>(std::max(1.0, std::ceil((wanted_s - time_slack_s) / period_s)));
  if (state_ == RunState::dwelling) count = std::min(count, static_cast<std::size_t>(lead_lane->dwell_remaining()));
  count = std::clamp<std::size_t>(count, 1, read_samples);
  // Half a period more, so that rounding cannot cost a sample.
  const Result<std::size_t> got = lead_lane->receive(count, (static_cast<double>(count) + 0.5) * period_s);
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
  const double allowed = std::max(late_s / period_s, 2.0);
  return least <= most && static_cast<double>(most - least) > allowed;
}

StationRun::MaybeEvent StationRun::record_all() {
  for (UnitLane& lane : lanes_)
    if (const MaybeEvent event = record(lane)) return event;
  if (state_ != RunState::dwelling) return std::nullopt;
  if (any_living([](const UnitLane& lane) { return !lane.dwell_complete(); })) return std::nullopt;
  // The last word on whether the table stood still is the table's.
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
  return raise(RunEvent::motion_data_lost, ErrorKind::device,
               named(lane, (recorded->gap ? "samples lost" : recorded->what) +
                               " while the table turned, before sample " + std::to_string(lane.next_sample())));
}

// Settled, but what the unit sent of the way is not whole. A lane that has no repeat left drops out, and the others do not repeat it.
StationRun::MaybeEvent StationRun::judge_move() {
  if (!item_running_) return std::nullopt;
  const std::string what =
      std::string("samples lost, flagged or doubled while ") + to_string(job_.plan.items[item_].axis) + " turned";
  for (UnitLane& lane : lanes_) {
    if (!lane.alive() || !lane.motion_lost || lane.repeats < job_.station.dwell.max_repeats) continue;
    const Error error = device_error(what + ", and the move was repeated " + std::to_string(lane.repeats) + " times");
    if (const MaybeEvent event = fail(lane, RunEvent::move_bad, error)) return event;
  }
  if (!any_living([](const UnitLane& lane) { return lane.motion_lost; })) return std::nullopt;
  return raise(RunEvent::move_bad, ErrorKind::device, what + ": goes back and repeats the move");
}

StationRun::MaybeEvent StationRun::judge_defect(UnitLane& lane, const DwellMonitor::Defect& defect) {
  bad_lane_ = &lane;
  if (lane.repeats >= job_.station.dwell.max_repeats)
    return fail(lane, RunEvent::dwell_bad, {defect.kind, defect.reason});
  return raise(RunEvent::dwell_bad, defect.kind, named(lane, defect.reason));
}

}  // namespace turncal
