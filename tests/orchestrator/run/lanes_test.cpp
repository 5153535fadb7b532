// Several units in one run of the station, in memory: who is asked for what, who drops out, what the others get.

#include "imu_io/recordings/recording_source.h"
#include "orchestrator/jobs/command_context.h"
#include "orchestrator/run/station_run.h"
#include "tests/imu_io/recording_samples.h"
#include "tests/orchestrator/program.h"
#include "tests/orchestrator/rig_station.h"

namespace turncal {
namespace {

// A unit whose samples come some periods late, as those of another line do.
class LateImu : public FrontImu {
 public:
  LateImu(ImuSource& source, std::size_t periods) : FrontImu(source), late(periods) {}
  Result<std::size_t> read(std::span<ImuSample> out, double timeout_s) override {
    std::vector<ImuSample> fresh(out.size());
    const Result<std::size_t> got = imu_.read(fresh, timeout_s);
    if (!got) return got;
    under_way_.insert(under_way_.end(), fresh.begin(), fresh.begin() + std::ptrdiff_t(*got));
    const std::size_t arrived = std::min(out.size(), under_way_.size() - std::min(late, under_way_.size()));
    std::copy_n(under_way_.begin(), arrived, out.begin());
    under_way_.erase(under_way_.begin(), under_way_.begin() + std::ptrdiff_t(arrived));
    return arrived;
  }
  std::size_t late;

 private:
  std::deque<ImuSample> under_way_;
};

struct Lanes : TestRun {
  explicit Lanes(std::size_t units, const RigConfig& config = default_rig_config())
      : TestRun(two_steps_text), devices(config, units), sinks(units) {
    for (std::size_t i = 0; i < units; ++i) sources.push_back(&devices.group.imu(i));
  }
  RunOutcome run_all() {
    std::vector<StationUnit> lanes;
    for (std::size_t i = 0; i < sources.size(); ++i)
      lanes.push_back({*sources[i], {&sinks[i]}, "SN" + std::to_string(i + 1)});
    return run(devices.devices(), lanes);
  }
  DryRunDevices devices;
  std::vector<MemorySink> sinks;
  std::vector<ImuSource*> sources;
};

RigConfig with_fault(RigFaultKind kind, std::int64_t sample_of_recording, std::int64_t count, int unit) {
  RigFault fault = unit_fault(kind, sample_of_recording, count);
  fault.unit = unit;
  return rig_with({fault});
}

TEST(Lanes, UnitsAFewSamplesApartHaveDwellsOfFullLength) {
  Lanes s(3);
  LateImu second(s.devices.group.imu(1), 7), third(s.devices.group.imu(2), 3);
  s.sources[1] = &second;
  s.sources[2] = &third;
  const RunOutcome outcome = ended(s.run_all(), RunState::done);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(outcome.units[i].lost_samples, 0u) << i;
    for (const Segment& segment : s.sinks[i].segments) {
      if (segment.kind == SegmentKind::rotate) continue;
      const std::int64_t expected = segment.kind == SegmentKind::align ? 1000 : 2000;
      EXPECT_EQ(segment.end_sample - segment.start_sample, expected) << "unit " << i;
    }
  }
  EXPECT_TRUE(s.kept.dropped.empty());
}

// A line that stalls during the move: what the unit sent while the table turned must not come into the dwell. A unit that is alone holds the
// turn even when its line is silent once the table has settled.
TEST(Lanes, ADwellWaitsForAUnitThatIsFarBehind) {
  for (const auto& [units, behind] : {std::pair<std::size_t, std::size_t>{2, 400}, {1, 1'000'000}}) {
    Lanes s(units);
    if (units == 1) s.station.imu_timeout_s = 20.0;
    LateImu last(s.devices.group.imu(units - 1), 0);
    s.sources.back() = &last;
    s.watcher.on_tick = [&, behind = behind](const RunSnapshot& at) {
      last.late = at.time_s > 10.0 && at.time_s < 19.0 ? behind : std::size_t{0};
    };
    const RunOutcome outcome = ended(s.run_all(), RunState::done);
    EXPECT_EQ(outcome.repeated_dwells, 0);
    EXPECT_EQ(outcome.units.back().lost_samples, 0u);
    EXPECT_TRUE(s.kept.dropped.empty());
  }
}

TEST(Lanes, DefectInTheFirstSamplesOfADwellLeavesTheOthersWhole) {
  // Bad for the whole run from the middle of the second dwell on: its second and third attempt fail with their first samples.
  for (const int bad : {1, 2}) {
    Lanes s(2, with_fault(RigFaultKind::invalid_sample, 3500, 1'000'000, bad));
    const RunOutcome outcome = ended(s.run_all(), RunState::done);
    EXPECT_EQ(s.kept.dropped, std::vector<std::string>{"SN" + std::to_string(bad)});
    EXPECT_EQ(outcome.repeated_dwells, 2);
    const RunOutcome::Unit& good = outcome.units[bad == 1 ? 1 : 0];
    EXPECT_FALSE(good.dropped_out);
    EXPECT_EQ(good.lost_samples, 0u);
    EXPECT_TRUE(outcome.units[std::size_t(bad - 1)].dropped_out);
    EXPECT_EQ(outcome.units[std::size_t(bad - 1)].dropped_out->kind, ErrorKind::unit_failed);
  }
}

TEST(Lanes, RepeatsAreCountedForTheUnitThatNeedsThem) {
  // One needs two repeats, then the other two of the same dwell: more than max_repeats in all, not for either.
  RigConfig config = with_fault(RigFaultKind::invalid_sample, 100, 1, 1);
  for (const auto& [sample, unit] : {std::pair{800, 2}, {1100, 1}, {1400, 2}}) {
    config.faults.push_back(config.faults.front());
    config.faults.back().sample = sample;
    config.faults.back().unit = unit;
  }
  Lanes s(2, config);
  const RunOutcome outcome = ended(s.run_all(), RunState::done);
  EXPECT_EQ(outcome.repeated_dwells, 4);
  EXPECT_TRUE(s.kept.dropped.empty()) << s.kept.dropped.front();
}

TEST(Lanes, ARecordingThatCannotBeWrittenIsOneUnitsFailure) {
  Lanes whole(2);
  ASSERT_EQ(whole.run_all().state, RunState::done);
  const int calls = whole.sinks[0].calls;
  for (std::size_t unit : {0u, 1u}) {
    for (int call = 1; call <= calls; call += call < 12 ? 1 : calls / 20) {
      SCOPED_TRACE("unit " + std::to_string(unit) + ", call " + std::to_string(call));
      Lanes s(2);
      s.sinks[unit].fail_at_call = call;
      const RunOutcome outcome = ended(s.run_all(), RunState::done);
      ASSERT_TRUE(outcome.units[unit].dropped_out);
      ASSERT_SAYS(outcome.units[unit].dropped_out->message, "disk full");
      ASSERT_EQ(s.kept.dropped, std::vector<std::string>{"SN" + std::to_string(unit + 1)});
      ASSERT_EQ(outcome.units[1 - unit].next_sample, two_steps_samples);
      ASSERT_EQ(s.sinks[1 - unit].sample_count, two_steps_samples);
      ASSERT_TRUE(s.sinks[1 - unit].finished);
      ASSERT_FALSE(s.sinks[unit].finished && call < calls);
    }
  }
}

TEST(Lanes, ADropoutThatCannotBeJournalledStopsTheRun) {
  Lanes s(2);
  s.sinks[1].fail_at_call = 5;
  s.kept.on_call = [&] { return s.kept.dropped.empty() ? Status() : device_error("journal: disk full (on demand)"); };
  const RunOutcome outcome = ended(s.run_all(), RunState::failed);
  EXPECT_SAYS(outcome.error.message, "journal: disk full");
}

// --- The station's places ---

Result<StationConfig> station_of(const std::string& keys) {
  return parse_station_config(live_station("imu.unit_serial = SN1\n" + keys, "/dev/a"), "x.station");
}

TEST(Places, AreTheLinesOfTheStation) {
  EXPECT_EQ(station_of("")->imu_places(), 1u);
  const Result<StationConfig> three = good(station_of("imu.3.device = /dev/c\nimu.2.device = /dev/b\n"));
  EXPECT_EQ(three->imu_places(), 3u);
  EXPECT_EQ(three->imu_settings(0).device, "/dev/a");
  EXPECT_EQ(three->imu_settings(0).unit_serial, "SN1");
  EXPECT_EQ(three->imu_settings(2).device, "/dev/c");
  EXPECT_EQ(three->imu_settings(2).unit_serial, "");
}

// ---- station run ----

// The station's loop on the rig: an undisturbed run to the sample, and a unit, a disk or an operator that ends it.

TEST(StationRun, UndisturbedRunIsThePlanToTheSample) {
  RigStation s(two_steps_text);
  bool calibrated = false;
  s.calibrate = [&](const RunOutcome&) -> Status {
    calibrated = true;
    EXPECT_TRUE(s.sink.finished) << "calibrated before the recording was sealed";
    return {};
  };
  const RunOutcome outcome = ended(s.run(), RunState::done);
  EXPECT_TRUE(calibrated);
  EXPECT_EQ(outcome.units[0].next_sample, two_steps_samples);
  EXPECT_EQ(s.sink.sample_count, two_steps_samples);
  EXPECT_EQ(s.sink.syncs, 3 + 2) << "after every dwell, and every step";
  test::expect_same(s.sink.segments, planned_segments(s.plan));
  EXPECT_TRUE(s.at_rest());
  EXPECT_EQ(s.sink.info.unit_serial, "SN1");
  EXPECT_TRUE(s.sink.info.simulated);
  // Progress is reported at every poll and never runs backwards beyond the plan.
  EXPECT_GT(s.watcher.progress_calls, 100);
  EXPECT_NEAR(s.watcher.last.run_fraction, 1.0, 1e-9);
}

TEST(StationRun, FourteenStepsAreTheIndependentRecordingsSegments) {
  const std::string recording = std::string(TURNCAL_SOURCE_DIR) + "/../shared/data/recordings/clean";
  if (!std::filesystem::exists(recording)) GTEST_SKIP() << recording << " is not here";
  RigStation s(file_text(std::string(TURNCAL_SOURCE_DIR) + "/sequences/fourteen_step.seq"));
  const RunOutcome outcome = ended(s.run(), RunState::done);
  EXPECT_EQ(outcome.units[0].next_sample, 1268400);  // 6342 s
  test::expect_same(s.sink.segments, planned_segments(s.plan));
  test::expect_same(s.sink.segments, (*good(RecordingSource::open(recording)))->segments());
}

// Rates and angles whose motion is no multiple of the poll interval; and a start away from where the table is homed, of which nothing is
// recorded.
TEST(StationRun, OddMotionsFollowThePlanFromItsStartPosition) {
  RigConfig left_elsewhere = default_rig_config();
  left_elsewhere.table.power_on_deg = {12.0, -3.0, 5.0};
  for (const auto& [start, moves] : {std::pair{"H 0 P 0 R 0", 3}, {"H -90 P 0 R 30", 5}}) {
    RigStation s(std::string("format = 1\nname = odd\nrate_degps = 7\nacceleration_degps2 = 13\nstep 1\n  initial ") +
                     start +
                     "\n  align 200\n  rotate H +33.3\n  dwell 777\n  rotate R -1.5\n  dwell 200\n"
                     "  rotate P +45 rate 40 acceleration 60\n  dwell 200\n",
                 left_elsewhere);
    ended(s.run(), RunState::done);
    test::expect_same(s.sink.segments, planned_segments(s.plan));
    EXPECT_EQ(s.watcher.count(RunEvent::move_next), moves);
  }
}

// --- The unit, the disk, the operator.

TEST(StationRun, SilentOrUnpluggedUnitIsLostAndTheTableStopped) {
  const RigFault silent{.kind = RigFaultKind::imu_silent, .time_s = 9.0, .duration_s = 100.0};
  for (const auto& [fault, at_s] : {std::pair{silent, 9.0 + default_station_config().imu_timeout_s},
                                    {table_fault(RigFaultKind::imu_unplugged, 9.0), 9.5}}) {
    RigStation s(two_steps_text, rig_with({fault}));
    const RunOutcome outcome = ended(s.run(), RunState::failed);
    EXPECT_EQ(exit_code(outcome.error.kind), 50);
    EXPECT_TRUE(s.watcher.saw(RunEvent::imu_lost));
    EXPECT_TRUE(s.watcher.saw(RunEvent::stopped_verified));
    EXPECT_TRUE(s.at_rest());
    EXPECT_NEAR(s.clock.now_s(), at_s, 1.5);
  }
}

TEST(StationRun, AnotherUnitIsRefusedBeforeAnythingMoves) {
  RigConfig config = default_rig_config();
  config.unit_serial = "SN2";
  RigStation s(two_steps_text, config);
  const RunOutcome outcome = ended(s.run(), RunState::failed);
  EXPECT_EQ(exit_code(outcome.error.kind), 1);
  EXPECT_SAYS(outcome.error.message, "'SN2'");
  EXPECT_EQ(s.clock.now_s(), 0.0);
}

// Whichever call to the disk fails, the table stops and the run says so; nothing counts as done.
TEST(StationRun, EveryFailureOfTheDiskStopsTheRun) {
  RigStation whole(two_steps_text);
  ASSERT_EQ(whole.run().state, RunState::done);
  int tried = 0;
  for (int call = 1; call <= whole.sink.calls; call += call < 40 ? 1 : 37) {
    RigStation s(two_steps_text);
    s.sink.fail_at_call = call;
    const RunOutcome outcome = s.run();
    ASSERT_EQ(outcome.state, RunState::failed) << call;
    ASSERT_SAYS(outcome.error.message, "disk full") << call;
    ASSERT_TRUE(s.at_rest()) << call;
    ++tried;
  }
  EXPECT_GT(tried, 40);
}

TEST(StationRun, FailedCalibrationIsNoSuccess) {
  RigStation s(two_steps_text);
  s.calibrate = [](const RunOutcome&) -> Status { return Error{ErrorKind::unit_failed, "does not settle"}; };
  const RunOutcome outcome = ended(s.run(), RunState::failed);
  EXPECT_EQ(exit_code(outcome.error.kind), 20);
  EXPECT_TRUE(s.sink.finished);
}

}  // namespace
}  // namespace turncal
