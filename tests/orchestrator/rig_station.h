// For tests: a whole station on the rig, with the recording in memory.
#pragma once

#include "orchestrator/devices/dry_run_devices.h"
#include "orchestrator/run/station_run.h"
#include "orchestrator/watch/progress.h"
#include "tests/test.h"

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
  RigFault fault;
  fault.kind = kind;
  fault.time_s = time_s;
  fault.axis = static_cast<int>(axis);
  return fault;
}

inline RigFault unit_fault(RigFaultKind kind, std::int64_t sample_of_recording, std::int64_t count = 1) {
  RigFault fault;
  fault.kind = kind;
  fault.sample = sample_of_recording + static_cast<std::int64_t>(homing_s / 0.005);
  fault.count = count;
  return fault;
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

// Another unit in front of which a test puts something.
class FrontImu : public ImuSource {
 public:
  explicit FrontImu(ImuSource& imu) : imu_(imu) {}
  Status open() override { return imu_.open(); }
  Result<ImuIdentity> identify() override { return imu_.identify(); }
  void describe(RecordingInfo& info) const override { imu_.describe(info); }
  Result<std::size_t> read(std::span<ImuSample> out, double timeout_s) override { return imu_.read(out, timeout_s); }
  ImuLinkCounters counters() const override { return imu_.counters(); }
  void close() override { imu_.close(); }

 protected:
  ImuSource& imu_;
};

// Counts what comes, keeps the segments; fails on demand.
class MemorySink : public RunSink {
 public:
  Status start(const RecordingInfo& info_in) override {
    info = info_in;
    return step();
  }
  // Keeps what ended at or before end_sample, as the recording on disk does.
  std::optional<std::uint32_t> written() const override { return {}; }
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
    sample_count += static_cast<std::int64_t>(samples.size());
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
  int count(RunEvent event) const {
    int n = 0;
    for (const TransitionRecord& record : transitions) n += record.event == event ? 1 : 0;
    return n;
  }
  std::vector<TransitionRecord> transitions;
  std::vector<std::string> text;
  RunSnapshot last;
  int progress_calls = 0;
  std::function<void(const RunSnapshot&)> on_tick;
};

// Keeps the completed dwells.
class DwellJournal : public RunJournal {
 public:
  Status transition(const TransitionRecord&) override { return {}; }
  Status home(double) override {
    ++homings;
    return {};
  }
  Status move(const Move&, double) override { return {}; }
  Status dwell(const CompletedDwell& dwell) override {
    dwells.push_back(dwell);
    return {};
  }
  Status dropout(const Dropout&) override { return {}; }
  Status seal(double, const std::vector<std::string>&) override { return {}; }
  std::vector<CompletedDwell> dwells;
  int homings = 0;
};

struct RigStation {
  explicit RigStation(const std::string& sequence_text, RigConfig rig_config = default_rig_config())
      : devices(rig_config), rig(devices.rig), clock(devices.clock), station(default_station_config()) {
    Result<Sequence> parsed = parse_sequence(sequence_text, "test.seq");
    EXPECT_TRUE(parsed.ok()) << (parsed.ok() ? "" : parsed.error().message);
    if (parsed) sequence = std::move(*parsed);
  }

  RunOutcome run() { return run(devices.devices()); }
  // With other devices in the place of the rig's, or around them.
  RunOutcome run(const StationDevices& with) {
    with.imu.describe(info);
    plan = make_plan(sequence, plan_limits(station, info.sample_period_s));
    EXPECT_TRUE(plan.ok()) << plan.violations.front();
    StationRun station_run(
        with, {sequence, plan, station, "SN1", resume, taken_up, temperature_c}, sink,
        {&watcher, &stop_requests, calibrate, journal, &pause_requests, &end_requests, {}, go_on_with});
    return station_run.run();
  }
  // Every axis of the rig itself, not of what the table says.
  bool at_rest() const {
    for (Axis axis : all_axes)
      if (rig.axis(axis).rate_degps != 0.0 || rig.axis(axis).moving) return false;
    return true;
  }

  DryRunDevices devices;
  Rig& rig;
  Clock& clock;
  StationConfig station;
  Sequence sequence;
  RecordingInfo info;
  Plan plan;
  MemorySink sink;
  Watcher watcher;
  std::atomic<int> stop_requests{0}, pause_requests{0}, end_requests{0};
  std::function<Status()> calibrate;
  RunJournal* journal = nullptr;
  decltype(StationHooks::go_on_with) go_on_with;
  std::optional<ResumePoint> resume;
  bool taken_up = false;
  std::optional<double> temperature_c;
};

}  // namespace turncal
