// For tests: a whole station on the rig, with the recording in memory.
#pragma once

#include "orchestrator/devices/dry_run_devices.h"
#include "orchestrator/run/station_run.h"
#include "orchestrator/watch/progress.h"
#include "tests/test.h"
#include "turntable_drivers/table/limited_turntable.h"

namespace turncal {

// Two steps, two moves with a dwell each. In time, with the built-in station (settle 0.5 s) and 10 deg/s, 20 deg/s^2:
//   homing 2 s (table.home_time_s); align 5 s: 2..7; move 90 deg, 10 s: 7..17; dwell 10 s: 17..27; move back: 27..37;
//   step 2 align 5 s: 37..42
inline const char* const two_steps_text =
    "format = 1\nname = short\nrate_degps = 10\nacceleration_degps2 = 20\n"
    "step 1 \"there and back\"\n  initial H 0 P 0 R 0\n  align 1000\n  rotate P +90\n  dwell 2000\n  rotate P -90\n"
    "step 2 \"again\"\n  initial H 0 P 0 R 0\n  align 1000\n";
inline constexpr std::int64_t two_steps_samples = 1000 + 2000 + 2000 + 2000 + 1000;

// Faults of the table and of the unit, for a rig that two_steps_text turns.
inline constexpr double homing_s = 2.0;  // two_steps_text begins then

inline RigFault table_fault(RigFaultKind kind, double time_s, Axis axis = Axis::pitch) {
  return {.kind = kind, .time_s = time_s, .axis = int(axis)};
}

inline RigFault unit_fault(RigFaultKind kind, std::int64_t sample_of_recording, std::int64_t count = 1) {
  return {.kind = kind, .sample = sample_of_recording + std::int64_t(homing_s / 0.005), .count = count};
}

inline RigConfig rig_with(std::vector<RigFault> faults) {
  RigConfig config = default_rig_config();
  config.faults = std::move(faults);
  return config;
}

// What came of a run that ended in this state; any other ends the test.
inline RunOutcome ended(RunOutcome outcome, RunState state) {
  if (outcome.state != state)
    throw std::runtime_error("ended in state " + std::string(to_string(outcome.state)) + ": " + outcome.error.message);
  return outcome;
}

// A table in front of which a test puts something: what is not set is passed on.
class FrontTable : public LimitedTurntable {
 public:
  explicit FrontTable(Turntable& table) : LimitedTurntable(table, {}) {}
  Status home() override { return on_home ? on_home() : LimitedTurntable::home(); }
  Status move_absolute(Axis axis, double position_deg, double rate_degps, double acceleration_degps2) override {
    if (on_sent) on_sent(axis, position_deg);
    if (on_move) return on_move(axis, position_deg);
    return LimitedTurntable::move_absolute(axis, position_deg, rate_degps, acceleration_degps2);
  }
  Status stop_all() override {
    ++stops;
    return on_stop ? on_stop() : LimitedTurntable::stop_all();
  }
  Status abort_all() override {
    ++aborts;
    return on_abort ? on_abort() : LimitedTurntable::abort_all();
  }
  Result<AxisStatus> status(Axis axis) override {
    if (on_status)
      if (Status given = on_status(); !given) return given.error();
    Result<AxisStatus> status = LimitedTurntable::status(axis);
    if (status && on_read) on_read(axis, *status);
    return status;
  }
  bool needs_operator() const override { return by_hand; }

  std::function<Status()> on_home, on_stop, on_abort, on_status;
  std::function<Status(Axis, double)> on_move;
  std::function<void(Axis, double)> on_sent;  // and is passed on
  std::function<void(Axis, AxisStatus&)> on_read;
  bool by_hand = false;
  int stops = 0, aborts = 0;
};

// A unit in front of which a test puts something: how it is read.
struct FrontUnit : FrontImu {
  using Read = std::function<Result<std::size_t>(std::span<ImuSample>, double)>;
  FrontUnit(ImuSource& unit, Read how) : FrontImu(unit), on_read(std::move(how)) {}
  Result<std::size_t> read(std::span<ImuSample> out, double timeout_s) override { return on_read(out, timeout_s); }
  Read on_read;
};

// Counts what comes, keeps the segments; fails on demand.
class MemorySink : public RunSink {
 public:
  Status start(const RecordingInfo& info_in) override {
    info = info_in;
    return step();
  }
  // Keeps what ended at or before end_sample, as the recording on disk does.
  Status resume(const RecordingInfo& info_in, std::int64_t end_sample, std::optional<std::uint32_t>) override {
    EXPECT_EQ(info_in.unit_serial, info.unit_serial);
    open = false;
    while (!segments.empty() &&
           (segments.back().end_sample > end_sample || segments.back().end_sample <= segments.back().start_sample)) {
      segments.pop_back();
    }
    EXPECT_EQ(segments.empty() ? -1 : segments.back().end_sample, end_sample) << "a completed dwell is lost";
    last_counter = end_sample - 1;
    return step();
  }
  Status begin_segment(const Segment& segment) override {
    EXPECT_FALSE(open) << "a segment was begun inside another";
    EXPECT_EQ(segment.start_sample, segments.empty() ? 0 : segments.back().end_sample);
    open = true;
    segments.push_back(segment);
    return step();
  }
  Status add(std::span<const ImuSample> samples) override {
    EXPECT_TRUE(open) << "samples outside a segment";
    for (const ImuSample& sample : samples) {
      EXPECT_GT(sample.counter, last_counter);
      last_counter = sample.counter;
    }
    sample_count += std::int64_t(samples.size());
    return step();
  }
  Status end_segment(SegmentKind kind, std::int64_t end_sample, const AxisTriple& angles_deg) override {
    EXPECT_TRUE(open);
    open = false;
    segments.back().kind = kind;
    segments.back().end_sample = end_sample;
    EXPECT_EQ(segments.back().heading_deg, angles_deg[Axis::heading]);
    EXPECT_EQ(end_sample, last_counter + 1);
    return step();
  }
  Status sync() override {
    ++syncs;
    return step();
  }
  Status finish() override {
    EXPECT_FALSE(open);
    finished = true;
    return step();
  }
  Status step() {
    if (++calls == fail_at_call) return device_error("disk full (on demand)");
    return {};
  }

  RecordingInfo info;
  Segments segments;
  std::int64_t sample_count = 0;
  std::int64_t last_counter = -1;
  int syncs = 0;
  bool open = false;
  bool finished = false;
  int calls = 0;
  int fail_at_call = -1;
};

// Keeps every transition, and may act on the rig in the middle of a run.
class Watcher : public RunObserver {
 public:
  void on_transition(const TransitionRecord& record) override {
    transitions.push_back(record);
    text.push_back(format_transition(record));
  }
  void on_progress(const RunSnapshot& snapshot) override {
    ++progress_calls;
    last = snapshot;
    if (on_tick) on_tick(snapshot);
  }
  bool saw(RunEvent event) const { return count(event) > 0; }
  int count(RunEvent event) const { return int(std::ranges::count(transitions, event, &TransitionRecord::event)); }
  std::vector<TransitionRecord> transitions;
  std::vector<std::string> text;
  RunSnapshot last;
  int progress_calls = 0;
  std::function<void(const RunSnapshot&)> on_tick;
};

// Keeps what it is told. on_call: what becomes of each.
class TestJournal : public RunJournal {
 public:
  Status transition(const TransitionRecord& record) override {
    if (on_transition) on_transition(record);
    return called();
  }
  Status command(const TableCommand& command) override {
    commands.push_back(command);
    return called();
  }
  Status dwell(const CompletedDwell& dwell) override {
    Status kept = called();
    if (kept) dwells.push_back(dwell);
    return kept;
  }
  Status dropout(const Dropout& dropout) override {
    dropped.push_back(dropout.serial);
    return called();
  }
  Status seal(double, const std::vector<std::string>&) override {
    sealed = true;
    return called();
  }
  std::vector<TableCommand> commands;
  std::vector<CompletedDwell> dwells;
  std::vector<std::string> dropped;  // serials
  bool sealed = false;
  std::function<Status()> on_call;
  std::function<void(const TransitionRecord&)> on_transition;

 private:
  Status called() { return on_call ? on_call() : Status(); }
};

// A run whose recording and journal are in memory, on whatever devices.
struct TestRun {
  explicit TestRun(const std::string& sequence_text)
      : sequence(expect_value(parse_sequence(sequence_text, "test.seq"))) {}

  RunOutcome run(const StationDevices& with) { return run(with, {{with.imu, sinks, "SN1"}}); }
  RunOutcome run(const StationDevices& with, const std::vector<StationUnit>& units) {
    with.imu.describe(info);
    plan = make_plan(sequence, plan_limits(station, info.sample_period_s));
    EXPECT_TRUE(plan.ok()) << plan.violations.front();
    StationRun station_run(
        with, {sequence, plan, station, resume, taken_up, temperature_c}, units,
        {{&watcher}, &stop_requests, calibrate, &kept, &pause_requests, &end_requests, {}, go_on_with});
    return station_run.run();
  }

  StationConfig station = default_station_config();
  Sequence sequence;
  RecordingInfo info;
  Plan plan;
  MemorySink sink;
  std::vector<RunSink*> sinks = {&sink};
  TestJournal kept;
  Watcher watcher;
  std::atomic<int> stop_requests{0}, pause_requests{0}, end_requests{0};
  decltype(StationHooks::calibrate) calibrate;
  decltype(StationHooks::go_on_with) go_on_with;
  std::optional<ResumePoint> resume;
  bool taken_up = false;
  std::optional<double> temperature_c;
};

struct RigStation : TestRun {
  explicit RigStation(const std::string& sequence_text, const RigConfig& rig_config = default_rig_config())
      : TestRun(sequence_text), devices(rig_config), rig(devices.rig), clock(devices.clock) {}

  RunOutcome run() { return run_with(devices.imu); }
  RunOutcome run_on(Turntable& table) { return run_with(devices.imu, table); }
  RunOutcome run_with(ImuSource& imu) { return run_with(imu, devices.table); }
  RunOutcome run_with(ImuSource& imu, Turntable& table) {
    return TestRun::run({table, imu, clock, devices.devices().wait});
  }
  // Every axis of the rig itself, not of what the table says.
  bool at_rest() const {
    return std::ranges::none_of(
        all_axes, [this](Axis axis) { return rig.axis(axis).rate_degps != 0.0 || rig.axis(axis).moving; });
  }

  DryRunDevices devices;
  Rig& rig;
  Clock& clock;
};

}  // namespace turncal
