// For tests: a table and a unit in the wall clock's time, 100 times faster, and a journal and a recording that hang when they are told to.
#pragma once

#include <time.h>

#include <array>
#include <atomic>
#include <cmath>
#include <new>
#include <string>
#include <utility>
#include <vector>

#include "imu_io/base/clock.h"
#include "orchestrator/devices/live_devices.h"
#include "orchestrator/run/station_run.h"

namespace turncal {

inline constexpr double speed_up = 100.0;

inline void pause_ms(double ms) {
  timespec t{static_cast<time_t>(ms / 1e3), long(1e6 * std::fmod(ms, 1e3))};
  ::nanosleep(&t, nullptr);
}

// What may hang: whoever comes waits until it is released. And what may have no memory left.
struct Hook {
  std::atomic<bool> hangs{false}, throws{false};
  void pass() const {
    while (hangs) pause_ms(0.5);
    if (throws) throw std::bad_alloc();
  }
  Status write() const { return pass(), Status(); }
};

// Axes that turn at their rate at once, by the wall clock; deaf: a braking stop makes them run on.
class DrawnTable : public Turntable {
 public:
  DrawnTable(const Clock& clock, bool deaf) : clock_(clock), deaf_(deaf) {}
  Status connect() override { return {}; }
  Result<TableIdentity> identify() override { return TableIdentity{"drawn", true}; }
  Status enable() override {
    on_ = true;
    return {};
  }
  Status home() override {
    home_until_s_ = clock_.now_s() + 3.0;
    return {};
  }
  Status move_absolute(Axis axis, double position_deg, double rate_degps, double) override {
    AxisMotion& motion = motion_[index(axis)];
    const double from_deg = at(motion);
    motion = {from_deg, position_deg, clock_.now_s(), std::copysign(rate_degps, position_deg - from_deg)};
    return {};
  }
  Status stop_all() override {
    note(stop_s);
    if (deaf_)
      run_away();
    else
      hold();
    return {};
  }
  Status abort_all() override {
    note(abort_s);
    hold();
    on_ = false;
    return {};
  }
  Status clear_fault() override { return {}; }
  Result<AxisStatus> status(Axis axis) override {
    const AxisMotion& motion = motion_[index(axis)];
    AxisStatus now;
    if (turn_by_itself.exchange(false)) run_away();
    now.position_deg = at(motion);
    const bool homing = home_until_s_ > clock_.now_s();
    const bool turns = now.position_deg != motion.to_deg;
    now.moving = homing || turns;
    now.rate_degps = turns ? motion.rate_degps : 0.0;
    now.enabled = now.drive_on = on_;
    now.homed = home_until_s_ >= 0.0 && !homing;
    now.in_position = !now.moving;
    now.remote = true;
    now.time_s = clock_.now_s();
    return now;
  }
  bool was_switched_on() const override { return on_; }

  std::atomic<double> asked_s{0.0}, stop_s{0.0}, abort_s{0.0};  // wall
  std::atomic<bool> turn_by_itself{false};                      // from the next reading on

 private:
  struct AxisMotion {
    double from_deg = 0.0, to_deg = 0.0, began_s = 0.0, rate_degps = 0.0;
  };
  double at(const AxisMotion& motion) const {
    const double way_deg = motion.to_deg - motion.from_deg;
    const double gone_deg = std::abs(motion.rate_degps) * (clock_.now_s() - motion.began_s);
    return gone_deg >= std::abs(way_deg) ? motion.to_deg : motion.from_deg + std::copysign(gone_deg, way_deg);
  }
  void hold() {
    home_until_s_ = std::min(home_until_s_, clock_.now_s());
    for (AxisMotion& motion : motion_) motion = {at(motion), at(motion), clock_.now_s(), 0.0};
  }
  void run_away() {
    for (AxisMotion& motion : motion_) motion = {at(motion), at(motion) + 1e9, clock_.now_s(), 60.0};
  }
  // The first one after the request.
  void note(std::atomic<double>& time_s) const {
    if (asked_s != 0.0 && time_s == 0.0) time_s = monotonic_s();
  }
  const Clock& clock_;
  bool deaf_;
  bool on_ = false;
  double home_until_s_ = -1.0;
  std::array<AxisMotion, 3> motion_{};
};

// A resting unit, sample by sample of the wall clock. As a real line it is waited for, and a signal ends the wait.
class DrawnUnit : public ImuSource {
 public:
  explicit DrawnUnit(const Clock& clock) : clock_(clock) {}
  Status open() override {
    next_ = due();
    return {};
  }
  Result<ImuIdentity> identify() override { return ImuIdentity{}; }
  void describe(RecordingInfo& info) const override {
    info.sample_period_s = period_s;
    info.gyro_increment = info.accel_increment = IncrementKind::pulses;
    info.accel_pulse_mps = 1e-3;
    info.simulated = true;
  }
  Result<std::size_t> read(std::span<ImuSample> out, double timeout_s) override {
    const std::int64_t wanted = next_ + std::int64_t(out.size());
    const double wait_s = std::min(timeout_s, double(wanted - due()) * period_s);
    if (timeout_s > 0.0 && wait_s > 0.0) pause_ms(1e3 * wait_s / speed_up);
    std::size_t got = 0;
    for (; got < out.size() && next_ < due(); ++got) {
      out[got] = {};
      out[got].counter = next_++;
      out[got].gyro[0] = double(next_ % 2);
      out[got].accel[2] = 49.0 + double(next_ % 2);
    }
    return got;
  }
  ImuLinkCounters counters() const override { return {}; }
  void close() override {}

 private:
  static constexpr double period_s = 0.005;
  std::int64_t due() const { return std::int64_t(clock_.now_s() / period_s); }
  const Clock& clock_;
  std::int64_t next_ = 0;
};

// The civil clock may be set.
class SteppedClock : public Clock {
 public:
  double now_s() const override { return clock_.now_s(); }
  double utc_s() const override { return clock_.utc_s() + step_s; }
  std::atomic<double> step_s{0.0};

 private:
  LiveClock clock_{speed_up};
};

// Counts what is missing between the samples.
class HangingSink : public RunSink {
 public:
  explicit HangingSink(const Hook& disk) : disk_(disk) {}
  Status start(const RecordingInfo&) override { return disk_.write(); }
  Status resume(const RecordingInfo&, std::int64_t, std::optional<std::uint32_t>) override { return disk_.write(); }
  Status begin_segment(const Segment&) override { return disk_.write(); }
  Status add(std::span<const ImuSample> samples) override {
    for (const ImuSample& sample : samples)
      missing += std::size_t(sample.counter - std::exchange(next, sample.counter + 1));
    return disk_.write();
  }
  Status end_segment(SegmentKind, std::int64_t, const AxisTriple&) override { return disk_.write(); }
  Status sync() override { return disk_.write(); }
  Status finish() override { return disk_.write(); }

  std::int64_t next = 0;
  std::size_t missing = 0;

 private:
  const Hook& disk_;
};

class HangingJournal : public RunJournal {
 public:
  explicit HangingJournal(const Hook& disk) : disk_(disk) {}
  Status transition(const TransitionRecord&) override { return disk_.write(); }
  Status command(const TableCommand&) override { return disk_.write(); }
  Status dwell(const CompletedDwell&) override { return disk_.write(); }
  Status dropout(const Dropout&) override { return disk_.write(); }
  Status seal(double, const std::vector<std::string>&) override { return disk_.write(); }

 private:
  const Hook& disk_;
};

// A whole station of them. Journal and recording go through the queue.
struct HangingStation {
  HangingStation(bool deaf, double limit_s) : table(clock, deaf), storage(BackgroundQueue::By::thread, limit_s) {
    station.clock_speed_up = speed_up;
    station.imu_timeout_s = 1000.0;
  }
  RunOutcome run(RunObserver& observer) {
    StationHooks hooks{.observers = {&observer},
                       .stop_requests = &stop_requests,
                       .calibrate = nullptr,
                       .journal = &journal,
                       .storage = &storage};
    const Plan planned = plan();
    StationRun station_run({table, unit, clock, LiveDevices::wait_a_little}, {sequence, planned, station},
                           {{unit, {&sink}, "SN1"}}, hooks);
    return station_run.run();
  }
  Plan plan() const {
    RecordingInfo info;
    unit.describe(info);
    return make_plan(sequence, plan_limits(station, info.sample_period_s));
  }
  Sequence sequence = *parse_sequence(
      "format = 1\nname = there\nrate_degps = 60\nacceleration_degps2 = 200\n"
      "step 1 \"there\"\n  initial H 0 P 0 R 0\n  align 600\n  rotate P +90\n  dwell 600\n  rotate P -90\n"
      "  dwell 400\n",
      "there.seq");
  Hook disk;
  SteppedClock clock;
  DrawnTable table;
  DrawnUnit unit{clock};
  HangingSink sink{disk};
  HangingJournal journal{disk};
  StationConfig station = default_station_config();
  std::atomic<int> stop_requests{0};
  BackgroundQueue storage;  // last, so that it is gone first
};

}  // namespace turncal
