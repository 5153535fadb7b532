// The station's loop on the rig: an undisturbed run to the sample, and a unit, a disk or an operator that ends it.

#include "orchestrator/run/station_run.h"
#include "imu_io/recordings/recording_source.h"
#include "orchestrator/jobs/command_context.h"
#include "tests/orchestrator/rig_station.h"

namespace turncal {
namespace {

std::string line_of(const Segment& s) {
  std::ostringstream text;
  text << s.step << ' ' << static_cast<int>(s.kind) << ' ' << s.start_sample << ' ' << s.end_sample << ' '
       << s.heading_deg << ' ' << s.pitch_deg << ' ' << s.roll_deg;
  return text.str();
}
void expect_same(const Segments& found, const Segments& expected) {
  ASSERT_EQ(found.size(), expected.size());
  for (std::size_t i = 0; i < found.size(); ++i) ASSERT_EQ(line_of(found[i]), line_of(expected[i])) << "segment " << i;
}

TEST(StationRun, UndisturbedRunIsThePlanToTheSample) {
  RigStation s(two_steps_text);
  bool calibrated = false;
  s.calibrate = [&]() -> Status {
    calibrated = true;
    EXPECT_TRUE(s.sink.finished) << "calibrated before the recording was sealed";
    return {};
  };
  const RunOutcome outcome = ended(s.run(), RunState::done);
  EXPECT_TRUE(calibrated);
  EXPECT_EQ(outcome.units[0].recorded_samples, two_steps_samples);
  EXPECT_EQ(s.sink.sample_count, two_steps_samples);
  EXPECT_EQ(s.sink.syncs, 3 + 2) << "after every dwell, and every step";
  expect_same(s.sink.segments, planned_segments(s.plan));
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
  EXPECT_EQ(outcome.units[0].recorded_samples, 1268400);  // 6342 s
  expect_same(s.sink.segments, planned_segments(s.plan));
  expect_same(s.sink.segments, (*good(RecordingSource::open(recording)))->segments());
}

// Rates and angles whose motion is no multiple of the poll interval: the plan holds to the sample all the same.
TEST(StationRun, OddMotionTimesFollowThePlan) {
  RigStation s(
      "format = 1\nname = odd\nrate_degps = 7\nacceleration_degps2 = 13\nstep 1\n  initial H 0 P 0 R 0\n  align 200\n"
      "  rotate H +33.3\n  dwell 777\n  rotate R -1.5\n  dwell 200\n  rotate P +45 rate 40 acceleration 60\n  dwell "
      "200\n");
  ended(s.run(), RunState::done);
  expect_same(s.sink.segments, planned_segments(s.plan));
}

TEST(StationRun, GoesToTheStartPositionBeforeTheRecordingBegins) {
  RigConfig config = default_rig_config();
  config.table.power_on_deg = {12.0, -3.0, 5.0};
  RigStation s(
      "format = 1\nname = away\nrate_degps = 10\nacceleration_degps2 = 20\nstep 1\n  initial H -90 P 0 R 30\n"
      "  align 1000\n  dwell 200\n",
      config);
  ended(s.run(), RunState::done);
  ASSERT_EQ(s.sink.segments.size(), 2U);
  EXPECT_EQ(line_of(s.sink.segments[0]), "1 0 0 1000 -90 0 30");
  EXPECT_EQ(s.watcher.count(RunEvent::move_next), 2);
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
  s.calibrate = []() -> Status { return Error{ErrorKind::unit_failed, "does not settle"}; };
  const RunOutcome outcome = ended(s.run(), RunState::failed);
  EXPECT_EQ(exit_code(outcome.error.kind), 20);
  EXPECT_TRUE(s.sink.finished);
}

}  // namespace
}  // namespace turncal
