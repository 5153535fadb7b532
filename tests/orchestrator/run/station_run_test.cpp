// The station's loop on the rig: an undisturbed run to the sample, and what it does about every fault the rig can make.
#include "orchestrator/run/station_run.h"
#include "orchestrator/jobs/exit_code.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <sstream>

#include "imu_io/recordings/recording_source.h"
#include "tests/orchestrator/rig_station.h"
#include "turntable_drivers/table/limited_turntable.h"

namespace turncal {
namespace {

constexpr double homing_s = 2.0;  // two_steps_text begins then

RigFault table_fault(RigFaultKind kind, double time_s, Axis axis = Axis::pitch) {
  RigFault fault;
  fault.kind = kind;
  fault.time_s = time_s;
  fault.axis = static_cast<int>(axis);
  return fault;
}
RigFault unit_fault(RigFaultKind kind, std::int64_t sample_of_recording, std::int64_t count = 1) {
  RigFault fault;
  fault.kind = kind;
  fault.sample = sample_of_recording + static_cast<std::int64_t>(homing_s / 0.005);
  fault.count = count;
  return fault;
}
RigConfig rig_with(std::vector<RigFault> faults) {
  RigConfig config = default_rig_config();
  config.faults = std::move(faults);
  return config;
}

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
  const RunOutcome outcome = s.run();
  EXPECT_EQ(outcome.state, RunState::done) << outcome.error.message;
  EXPECT_TRUE(calibrated);
  EXPECT_EQ(outcome.units[0].recorded_samples, two_steps_samples);
  EXPECT_EQ(s.sink.sample_count, two_steps_samples);
  EXPECT_EQ(s.sink.syncs, 2);
  expect_same(s.sink.segments, planned_segments(s.plan));
  EXPECT_TRUE(s.at_rest());
  EXPECT_EQ(s.sink.info.unit_serial, "SN1");
  EXPECT_TRUE(s.sink.info.simulated);
  // Progress is reported at every poll and never runs backwards beyond the plan.
  EXPECT_GT(s.watcher.progress_calls, 100);
  EXPECT_NEAR(s.watcher.last.run_fraction, 1.0, 1e-9);
}

TEST(StationRun, FourteenStepsAreTheIndependentRecordingsSegments) {
  const std::string recording = std::string(TURNCAL_SOURCE_DIR) + "/../shared/data/recordings/clean/segments.csv";
  if (!std::filesystem::exists(recording)) GTEST_SKIP() << recording << " is not here";
  std::ifstream text_file(std::string(TURNCAL_SOURCE_DIR) + "/sequences/fourteen_step.seq");
  std::stringstream text;
  text << text_file.rdbuf();
  RigStation s(text.str());
  const RunOutcome outcome = s.run();
  ASSERT_EQ(outcome.state, RunState::done) << outcome.error.message;
  EXPECT_EQ(outcome.units[0].recorded_samples, 1268400);  // 6342 s
  expect_same(s.sink.segments, planned_segments(s.plan));

  std::ifstream file(recording);
  std::string row;
  std::getline(file, row);
  std::size_t i = 0;
  for (; std::getline(file, row); ++i) {
    ASSERT_LT(i, s.sink.segments.size());
    const Segment& segment = s.sink.segments[i];
    const char* const kinds[] = {"align", "static", "rotate"};
    std::ostringstream found;
    found << segment.step << ',' << kinds[static_cast<int>(segment.kind)] << ',' << segment.start_sample << ','
          << segment.end_sample << ',' << segment.heading_deg << ',' << segment.pitch_deg << ',' << segment.roll_deg;
    ASSERT_EQ(found.str(), row) << "row " << i + 1;
  }
  EXPECT_EQ(i, s.sink.segments.size());
}

// Rates and angles whose motion is no multiple of the poll interval: the plan holds to the sample all the same.
TEST(StationRun, OddMotionTimesFollowThePlan) {
  RigStation s(
      "format = 1\nname = odd\nrate_degps = 7\nacceleration_degps2 = 13\nstep 1\n  initial H 0 P 0 R 0\n  align 200\n"
      "  rotate H +33.3\n  dwell 777\n  rotate R -1.5\n  dwell 200\n  rotate P +45 rate 40 acceleration 60\n  dwell "
      "200\n");
  const RunOutcome outcome = s.run();
  ASSERT_EQ(outcome.state, RunState::done) << outcome.error.message;
  expect_same(s.sink.segments, planned_segments(s.plan));
}

TEST(StationRun, GoesToTheStartPositionBeforeTheRecordingBegins) {
  RigConfig config = default_rig_config();
  config.table.power_on_deg = {12.0, -3.0, 5.0};
  RigStation s(
      "format = 1\nname = away\nrate_degps = 10\nacceleration_degps2 = 20\nstep 1\n  initial H -90 P 0 R 30\n"
      "  align 1000\n  dwell 200\n",
      config);
  const RunOutcome outcome = s.run();
  ASSERT_EQ(outcome.state, RunState::done) << outcome.error.message;
  ASSERT_EQ(s.sink.segments.size(), 2U);
  EXPECT_EQ(line_of(s.sink.segments[0]), "1 0 0 1000 -90 0 30");
  EXPECT_EQ(s.watcher.count(RunEvent::move_next), 2);
}

// --- Dwells that do not count.

TEST(StationRun, SampleLostInADwellRepeatsItWhole) {
  // Sample 3500 lies in the dwell 3000..5000.
  RigStation s(two_steps_text, rig_with({unit_fault(RigFaultKind::lost_sample, 3500, 3)}));
  const RunOutcome outcome = s.run();
  ASSERT_EQ(outcome.state, RunState::done) << outcome.error.message;
  EXPECT_EQ(outcome.repeated_dwells, 1);
  EXPECT_EQ(outcome.units[0].lost_samples, 3U);
  // align, move, what became of the dwell (rotate), settling (rotate), the dwell again, move, align
  ASSERT_EQ(s.sink.segments.size(), 7U);
  const Segment& bad = s.sink.segments[2];
  EXPECT_EQ(bad.kind, SegmentKind::rotate);
  EXPECT_EQ(bad.start_sample, 3000);
  EXPECT_GT(bad.end_sample, 3500);
  EXPECT_LT(bad.end_sample, 3700) << "the rest of a dwell that cannot count is not waited for";
  EXPECT_EQ(s.sink.segments[3].kind, SegmentKind::rotate);
  EXPECT_EQ(s.sink.segments[3].end_sample - s.sink.segments[3].start_sample, 100);  // settle 0.5 s
  const Segment& good = s.sink.segments[4];
  EXPECT_EQ(good.kind, SegmentKind::still);
  EXPECT_EQ(good.end_sample - good.start_sample, 2000) << "repeated whole, never spliced";
  EXPECT_EQ(good.pitch_deg, 90.0);
}

TEST(StationRun, FlaggedDataRepeatsTheDwell) {
  RigStation s(two_steps_text, rig_with({unit_fault(RigFaultKind::invalid_sample, 4999)}));
  const RunOutcome outcome = s.run();
  ASSERT_EQ(outcome.state, RunState::done) << outcome.error.message;
  EXPECT_EQ(outcome.repeated_dwells, 1);
  EXPECT_EQ(s.watcher.count(RunEvent::dwell_bad), 1);
}

TEST(StationRun, AlignmentIsRepeatedLikeAnyDwell) {
  RigStation s(two_steps_text, rig_with({unit_fault(RigFaultKind::lost_sample, 10)}));
  const RunOutcome outcome = s.run();
  ASSERT_EQ(outcome.state, RunState::done) << outcome.error.message;
  EXPECT_EQ(outcome.repeated_dwells, 1);
  EXPECT_EQ(s.sink.segments[0].kind, SegmentKind::rotate);
  EXPECT_EQ(s.sink.segments[2].kind, SegmentKind::align);
}

TEST(StationRun, TableThatMovedInADwellGoesBackAndRepeats) {
  RigFault moved = table_fault(RigFaultKind::table_moved, 21.0);
  moved.size = 0.05;  // deg, by itself, and it stays there: encoder shows it
  RigStation s(two_steps_text, rig_with({moved}));
  const RunOutcome outcome = s.run();
  ASSERT_EQ(outcome.state, RunState::done) << outcome.error.message;
  EXPECT_EQ(outcome.repeated_dwells, 1);
  // Back to 90 deg: one move more than the sequence has.
  EXPECT_EQ(s.watcher.count(RunEvent::move_next), 3);
  Segment good;
  for (const Segment& segment : s.sink.segments) {
    if (segment.kind == SegmentKind::still) good = segment;
  }
  EXPECT_EQ(good.end_sample - good.start_sample, 2000);
}

TEST(StationRun, HiddenMotionIsSeenByTheUnitItself) {
  RigFault moved = table_fault(RigFaultKind::table_moved, 21.0);
  moved.size = 0.05;
  moved.hidden = true;  // the encoder shows nothing; 0.05 deg within a second are 0.05 deg/s in the means
  RigStation s(two_steps_text, rig_with({moved}));
  const RunOutcome outcome = s.run();
  ASSERT_EQ(outcome.state, RunState::done) << outcome.error.message;
  EXPECT_EQ(outcome.repeated_dwells, 1);
  bool told = false;
  for (const TransitionRecord& record : s.watcher.transitions) {
    told = told || (record.event == RunEvent::dwell_bad && record.detail.find("gyro") != std::string::npos);
  }
  EXPECT_TRUE(told);
}

TEST(StationRun, KnockRepeatsTheDwell) {
  RigFault knock = unit_fault(RigFaultKind::velocity_knock, 4000);
  knock.axis = 0;
  knock.size = 0.05;
  RigStation s(two_steps_text, rig_with({knock}));
  const RunOutcome outcome = s.run();
  ASSERT_EQ(outcome.state, RunState::done) << outcome.error.message;
  EXPECT_EQ(outcome.repeated_dwells, 1);
}

TEST(StationRun, TooManyRepeatsEndTheRun) {
  std::vector<RigFault> faults;
  for (std::int64_t sample = 3000; sample < 12000; sample += 300)
    faults.push_back(unit_fault(RigFaultKind::lost_sample, sample));
  RigStation s(two_steps_text, rig_with(faults));
  const RunOutcome outcome = s.run();
  EXPECT_EQ(outcome.state, RunState::failed);
  EXPECT_EQ(exit_code(outcome.error.kind), 50);
  EXPECT_EQ(outcome.repeated_dwells, 2);  // dwell.max_repeats
  EXPECT_EQ(s.watcher.count(RunEvent::dwell_bad), 3);
  EXPECT_NE(outcome.error.message.find("step 1"), std::string::npos) << outcome.error.message;
  EXPECT_NE(outcome.error.message.find("samples lost"), std::string::npos) << outcome.error.message;
  EXPECT_TRUE(s.at_rest());
}

// max_repeats is for one dwell: two dwells that need two repeats each are no failure.
TEST(StationRun, RepeatsAreCountedADwell) {
  std::vector<RigFault> faults;
  // The dwell begins at 3000; every try ends at the poll after its loss, then 100 samples of settling.
  for (std::int64_t sample : {3010, 3410, 8010, 8410}) faults.push_back(unit_fault(RigFaultKind::lost_sample, sample));
  RigStation s(two_steps_text, rig_with(faults));
  const RunOutcome outcome = s.run();
  ASSERT_EQ(outcome.state, RunState::done) << outcome.error.message;
  EXPECT_EQ(outcome.repeated_dwells, 4);
}

// From +0.006 to -0.006 deg: never out of the tolerance of 0.01 deg around the target, and yet the table moved by more.
TEST(StationRun, MotionFromOneSideOfTheTargetToTheOther) {
  RigFault before = table_fault(RigFaultKind::table_moved, 16.7);  // while settling
  before.size = 0.006;
  RigFault within = table_fault(RigFaultKind::table_moved, 21.001);
  within.size = -0.012;
  RigConfig config = rig_with({before, within});
  config.table.in_position_tolerance_deg = 0.02;
  RigStation s(two_steps_text, config);
  s.station.dwell.max_gyro_peak_degps = s.station.dwell.max_gyro_std_degps = 1.0;  // the unit itself is not asked
  const RunOutcome outcome = s.run();
  ASSERT_EQ(outcome.state, RunState::done) << outcome.error.message;
  EXPECT_EQ(outcome.repeated_dwells, 1);
}

TEST(StationRun, UnitThatKeepsFlaggingItsDataFailed) {
  RigStation s(two_steps_text, rig_with({unit_fault(RigFaultKind::invalid_sample, 3500, 1'000'000)}));
  const RunOutcome outcome = s.run();
  EXPECT_EQ(outcome.state, RunState::failed);
  EXPECT_EQ(exit_code(outcome.error.kind), 20);
}

// --- Data lost while the table turns.

std::vector<std::pair<SegmentKind, double>> kinds_and_pitch(const Segments& segments) {
  std::vector<std::pair<SegmentKind, double>> result;
  for (const Segment& segment : segments) result.emplace_back(segment.kind, segment.pitch_deg);
  return result;
}

TEST(StationRun, SamplesLostInAMoveRepeatIt) {
  // Samples 1000..3000 are the move; the motion itself ends with 2899, so that the loss comes up together with the arrival.
  RigStation s(two_steps_text,
               rig_with({unit_fault(RigFaultKind::lost_sample, 2895), unit_fault(RigFaultKind::invalid_sample, 2900)}));
  const RunOutcome outcome = s.run();
  ASSERT_EQ(outcome.state, RunState::done) << outcome.error.message;
  EXPECT_EQ(s.watcher.count(RunEvent::motion_data_lost), 1) << "said once a move";
  EXPECT_EQ(s.watcher.count(RunEvent::move_bad), 1);
  EXPECT_EQ(outcome.repeated_moves, 1);
  EXPECT_EQ(outcome.repeated_dwells, 0);
  EXPECT_EQ(outcome.units[0].lost_samples, 1U);
  // There, back, and there again, all of it in the recording; then the plan as it was.
  using enum SegmentKind;
  const std::vector<std::pair<SegmentKind, double>> expected = {
      {align, 0.0},  {rotate, 90.0}, {rotate, 0.0}, {rotate, 90.0}, {SegmentKind::still, 90.0},
      {rotate, 0.0}, {align, 0.0}};
  EXPECT_EQ(kinds_and_pitch(s.sink.segments), expected);
  EXPECT_EQ(s.sink.segments[3].end_sample - s.sink.segments[3].start_sample, 2000) << "as planned, and whole";
  EXPECT_EQ(s.sink.sample_count, s.sink.segments.back().end_sample - 1);
}

TEST(StationRun, AMoveThatKeepsLosingSamplesFails) {
  std::vector<RigFault> faults;
  for (std::int64_t sample = 1500; sample < 60000; sample += 1500) {
    faults.push_back(unit_fault(RigFaultKind::lost_sample, sample));
  }
  RigStation s(two_steps_text, rig_with(faults));
  const RunOutcome outcome = s.run();
  EXPECT_EQ(outcome.state, RunState::failed);
  EXPECT_EQ(exit_code(outcome.error.kind), 50);
  EXPECT_EQ(outcome.repeated_moves, s.station.dwell.max_repeats);
  EXPECT_NE(outcome.error.message.find("the move was repeated"), std::string::npos) << outcome.error.message;
}

// Stopped while the table goes back, and taken up: the move is done once more, from where the last dwell stood.
TEST(StationRun, AMoveThatIsRepeatedIsTakenUp) {
  RigStation s(two_steps_text, rig_with({unit_fault(RigFaultKind::lost_sample, 2000)}));
  DwellJournal kept;
  s.journal = &kept;
  s.station.resume_rest_s = 1.0;
  s.watcher.on_tick = [&](const RunSnapshot& at) {
    if (s.watcher.saw(RunEvent::move_bad) && at.state == RunState::moving) s.stop_requests = 1;
  };
  ASSERT_EQ(s.run().state, RunState::aborted);
  ASSERT_EQ(kept.dwells.size(), 1u);
  s.resume = ResumePoint{kept.dwells.back(), false};
  s.stop_requests = 0;
  s.watcher.on_tick = nullptr;
  const RunOutcome outcome = s.run();
  ASSERT_EQ(outcome.state, RunState::done) << outcome.error.message;
  EXPECT_EQ(outcome.units[0].lost_samples, 0U) << "those were cut away with the move";
  using enum SegmentKind;
  const std::vector<std::pair<SegmentKind, double>> expected = {
      {align, 0.0}, {rotate, 0.0}, {rotate, 90.0}, {SegmentKind::still, 90.0}, {rotate, 0.0}, {align, 0.0}};
  EXPECT_EQ(kinds_and_pitch(s.sink.segments), expected);
}

// Gives one sample a second time with another content.
class TwoTongued : public ImuSource {
 public:
  TwoTongued(ImuSource& source, std::int64_t counter) : source_(source), counter_(counter) {}
  Status open() override { return source_.open(); }
  Result<ImuIdentity> identify() override { return source_.identify(); }
  void describe(RecordingInfo& info) const override { source_.describe(info); }
  Result<std::size_t> read(std::span<ImuSample> out, double timeout_s) override {
    if (again_) {
      out[0] = *again_;
      out[0].accel[0] += 1.0;
      again_.reset();
      return std::size_t{1};
    }
    const Result<std::size_t> got = source_.read(out, timeout_s);
    if (!got || *got == 0) return got;
    if (!told_ && out[*got - 1].counter >= counter_) {
      told_ = true;
      again_ = out[*got - 1];
    }
    return got;
  }
  ImuLinkCounters counters() const override { return source_.counters(); }
  void close() override { source_.close(); }

 private:
  ImuSource& source_;
  std::int64_t counter_;
  bool told_ = false;
  std::optional<ImuSample> again_;
};

TEST(StationRun, DuplicatesThatDifferRepeatTheDwell) {
  RigStation s(two_steps_text);
  s.devices.imu.describe(s.info);
  s.plan = make_plan(s.sequence, plan_limits(s.station, s.info.sample_period_s));
  for (const bool in_move : {false, true}) {
    RigStation t(two_steps_text);
    TwoTongued imu(t.devices.imu, (in_move ? 1700 : 3500) + 400);
    StationDevices devices = t.devices.devices();
    StationRun run({devices.table, imu, devices.clock, devices.wait}, {t.sequence, s.plan, t.station, "SN1"}, t.sink,
                   {&t.watcher, &t.stop_requests, {}, nullptr});
    const RunOutcome outcome = run.run();
    ASSERT_EQ(outcome.state, RunState::done) << outcome.error.message;
    EXPECT_EQ(outcome.repeated_dwells, in_move ? 0 : 1);
    EXPECT_EQ(outcome.repeated_moves, in_move ? 1 : 0);
    EXPECT_EQ(outcome.units[0].duplicate_samples, 1U);
  }
}

TEST(StationRun, DuplicateSamplesAreDropped) {
  RigStation s(two_steps_text, rig_with({unit_fault(RigFaultKind::duplicated_sample, 3500)}));
  const RunOutcome outcome = s.run();
  ASSERT_EQ(outcome.state, RunState::done) << outcome.error.message;
  EXPECT_EQ(outcome.repeated_dwells, 0);
  EXPECT_EQ(s.sink.sample_count, two_steps_samples);
}

// --- The table.

TEST(StationRun, StuckAxisIsAStall) {
  RigStation s(two_steps_text, rig_with({table_fault(RigFaultKind::stuck_axis, 9.0)}));
  const RunOutcome outcome = s.run();
  EXPECT_EQ(outcome.state, RunState::failed);
  EXPECT_EQ(exit_code(outcome.error.kind), 50);
  EXPECT_TRUE(s.watcher.saw(RunEvent::stall));
  // 7 s: command; stuck at 9 s; 2 s without progress, seen at the next poll.
  EXPECT_LT(s.clock.now_s(), 11.5);
  EXPECT_NE(outcome.error.message.find("pitch at 1"), std::string::npos) << outcome.error.message;
  EXPECT_NE(outcome.error.message.find("no progress for 2 s"), std::string::npos) << outcome.error.message;
}

TEST(StationRun, NeverInPositionRunsIntoTheDeadline) {
  RigStation s(two_steps_text, rig_with({table_fault(RigFaultKind::never_in_position, 8.0)}));
  const RunOutcome outcome = s.run();
  EXPECT_EQ(outcome.state, RunState::failed);
  EXPECT_EQ(exit_code(outcome.error.kind), 50);
  EXPECT_TRUE(s.watcher.saw(RunEvent::deadline));
  EXPECT_FALSE(s.watcher.saw(RunEvent::arrived));
  // 90/10 + 2 * 10/20 + 10 = 20 s after the command at 7 s.
  EXPECT_NEAR(s.clock.now_s(), 27.0, 0.5);
}

TEST(StationRun, LyingInPositionFlagsDoNotFoolIt) {
  for (const InPositionFlag flag : {InPositionFlag::servo_on, InPositionFlag::after_stop, InPositionFlag::stale,
                                    InPositionFlag::late, InPositionFlag::flicker}) {
    RigConfig config = default_rig_config();
    config.table.in_position = flag;
    RigStation s(two_steps_text, config);
    const RunOutcome outcome = s.run();
    ASSERT_EQ(outcome.state, RunState::done) << static_cast<int>(flag) << ": " << outcome.error.message;
    for (const Segment& segment : s.sink.segments) {
      if (segment.kind != SegmentKind::rotate) continue;
      const std::int64_t length = segment.end_sample - segment.start_sample;
      EXPECT_GE(length, 2000) << "flag " << static_cast<int>(flag) << ": arrival was believed too early";
      EXPECT_LE(length, 2000 + 500) << static_cast<int>(flag);
    }
  }
}

TEST(StationRun, AxisFaultStops) {
  RigStation s(two_steps_text, rig_with({table_fault(RigFaultKind::axis_fault, 9.0)}));
  const RunOutcome outcome = s.run();
  EXPECT_EQ(outcome.state, RunState::failed);
  EXPECT_EQ(exit_code(outcome.error.kind), 50);
  EXPECT_TRUE(s.watcher.saw(RunEvent::table_fault));
  EXPECT_TRUE(s.at_rest());
  EXPECT_LT(s.clock.now_s(), 11.0);
}

TEST(StationRun, EmergencyStopEndsTheRun) {
  for (const double time_s : {1.0, 9.0, 16.8, 20.0}) {  // homing, moving, settling, dwelling
    RigStation s(two_steps_text, rig_with({table_fault(RigFaultKind::emergency_stop, time_s)}));
    const RunOutcome outcome = s.run();
    EXPECT_EQ(outcome.state, RunState::failed) << time_s;
    EXPECT_EQ(exit_code(outcome.error.kind), 50);
    EXPECT_TRUE(s.watcher.saw(RunEvent::e_stop)) << time_s;
    EXPECT_TRUE(s.watcher.saw(RunEvent::stopped_verified)) << time_s;
    EXPECT_TRUE(s.at_rest());
    EXPECT_LT(s.clock.now_s(), time_s + 1.5);
  }
}

TEST(StationRun, LostTableLinkIsTriedAgainForTheStopOnly) {
  RigFault lost = table_fault(RigFaultKind::link_lost, 9.0);
  lost.duration_s = 2.0;
  RigStation s(two_steps_text, rig_with({lost}));
  const RunOutcome outcome = s.run();
  EXPECT_EQ(outcome.state, RunState::failed);
  EXPECT_EQ(exit_code(outcome.error.kind), 50);
  EXPECT_TRUE(s.watcher.saw(RunEvent::link_lost));
  EXPECT_TRUE(s.watcher.saw(RunEvent::stopped_verified));
  EXPECT_TRUE(s.at_rest());
  EXPECT_LT(s.rig.axis(Axis::pitch).position_deg, 80.0) << "stopped before the target: the stop was sent again";
}

TEST(StationRun, StopThatCannotBeVerifiedIsSaid) {
  RigStation s(two_steps_text, rig_with({table_fault(RigFaultKind::link_lost, 9.0)}));
  const RunOutcome outcome = s.run();
  EXPECT_EQ(outcome.state, RunState::failed);
  EXPECT_EQ(exit_code(outcome.error.kind), 50);
  EXPECT_FALSE(s.watcher.saw(RunEvent::stopped_verified));
  EXPECT_NE(outcome.error.message.find("COULD NOT BE VERIFIED"), std::string::npos) << outcome.error.message;
  EXPECT_EQ(outcome.error.message.find('\n'), std::string::npos);
}

// A table that acknowledges the braking stop and turns on gets the fastest one, long before it is given up.
class UnbrakedTable : public LimitedTurntable {
 public:
  explicit UnbrakedTable(Turntable& table) : LimitedTurntable(table, {}) {}
  Status stop_all() override { return {}; }
};

TEST(StationRun, ATableThatDoesNotBrakeGetsTheFastestStop) {
  RigStation s(two_steps_text);
  const StationDevices devices = s.devices.devices();
  UnbrakedTable table(devices.table);
  s.devices.imu.describe(s.info);
  s.plan = make_plan(s.sequence, plan_limits(s.station, s.info.sample_period_s));
  double asked_s = 0.0;
  s.watcher.on_tick = [&](const RunSnapshot& at) {
    if (asked_s > 0.0 || at.state != RunState::moving) return;
    asked_s = at.time_s;
    ++s.stop_requests;
  };
  StationRun run({table, devices.imu, devices.clock, devices.wait}, {s.sequence, s.plan, s.station, "SN1"}, s.sink,
                 {&s.watcher, &s.stop_requests, {}, nullptr});
  const RunOutcome outcome = run.run();
  EXPECT_EQ(outcome.state, RunState::aborted) << outcome.error.message;
  EXPECT_TRUE(s.watcher.saw(RunEvent::stopped_verified));
  EXPECT_TRUE(s.at_rest());
  EXPECT_LT(s.clock.now_s() - asked_s, 2.0 * 10.0 / 20.0 + s.station.motion.stall_s + 1.0)
      << "twice the ramp, and a little";
}

// --- The unit, the disk, the operator.

TEST(StationRun, SilentUnitIsLost) {
  RigFault silent = table_fault(RigFaultKind::imu_silent, 9.0);
  silent.duration_s = 100.0;
  RigStation s(two_steps_text, rig_with({silent}));
  const RunOutcome outcome = s.run();
  EXPECT_EQ(outcome.state, RunState::failed);
  EXPECT_EQ(exit_code(outcome.error.kind), 50);
  EXPECT_TRUE(s.watcher.saw(RunEvent::imu_lost));
  EXPECT_TRUE(s.watcher.saw(RunEvent::stopped_verified));
  EXPECT_TRUE(s.at_rest());
  EXPECT_NEAR(s.clock.now_s(), 9.0 + s.station.imu_timeout_s, 1.5);
}

TEST(StationRun, UnpluggedUnitIsLostAndTheTableStopped) {
  RigStation s(two_steps_text, rig_with({table_fault(RigFaultKind::imu_unplugged, 9.0)}));
  const RunOutcome outcome = s.run();
  EXPECT_EQ(outcome.state, RunState::failed);
  EXPECT_TRUE(s.watcher.saw(RunEvent::imu_lost));
  EXPECT_TRUE(s.watcher.saw(RunEvent::stopped_verified));
  EXPECT_TRUE(s.at_rest());
}

TEST(StationRun, AnotherUnitIsRefusedBeforeAnythingMoves) {
  RigConfig config = default_rig_config();
  config.unit_serial = "SN2";
  RigStation s(two_steps_text, config);
  const RunOutcome outcome = s.run();
  EXPECT_EQ(outcome.state, RunState::failed);
  EXPECT_EQ(exit_code(outcome.error.kind), 1);
  EXPECT_NE(outcome.error.message.find("'SN2'"), std::string::npos);
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
    ASSERT_NE(outcome.error.message.find("disk full"), std::string::npos) << call << ": " << outcome.error.message;
    ASSERT_TRUE(s.at_rest()) << call;
    ++tried;
  }
  EXPECT_GT(tried, 40);
}

TEST(StationRun, OperatorStopsAtOnce) {
  for (const double time_s : {0.5, 1.0, 5.0, 9.0, 16.8, 20.0, 40.0}) {
    RigStation s(two_steps_text);
    s.watcher.on_tick = [&](const RunSnapshot& at) {
      if (at.time_s >= time_s) s.stop_requests = 1;
    };
    const RunOutcome outcome = s.run();
    EXPECT_EQ(outcome.state, RunState::aborted) << time_s << ": " << outcome.error.message;
    EXPECT_EQ(exit_code(outcome.error.kind), 30);
    EXPECT_TRUE(s.at_rest()) << time_s;
    EXPECT_LT(s.clock.now_s(), time_s + 2.0);
    EXPECT_FALSE(s.sink.finished);
  }
}

TEST(StationRun, OperatorBeforeTheStart) {
  RigStation s(two_steps_text);
  s.stop_requests = 1;
  EXPECT_EQ(s.run().state, RunState::aborted);
}

TEST(StationRun, FailedCalibrationIsNoSuccess) {
  RigStation s(two_steps_text);
  s.calibrate = []() -> Status { return Error{ErrorKind::unit_failed, "does not settle"}; };
  const RunOutcome outcome = s.run();
  EXPECT_EQ(outcome.state, RunState::failed);
  EXPECT_EQ(exit_code(outcome.error.kind), 20);
  EXPECT_TRUE(s.sink.finished);
}

}  // namespace
}  // namespace turncal
