// Dwells and moves that do not count are done again, whole.
#include <gtest/gtest.h>

#include <algorithm>
#include <optional>
#include <utility>
#include <vector>

#include "imu_io/recordings/recording_source.h"
#include "orchestrator/jobs/command_context.h"
#include "orchestrator/run/station_run.h"
#include "tests/orchestrator/run/rig_faults.h"

namespace turncal {
namespace {

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

TEST(StationRun, ADwellThatIsNotBelievedIsMadeOnceMore) {
  RigStation s(two_steps_text);
  DwellJournal journal;
  s.journal = &journal;
  std::vector<std::size_t> asked;
  s.go_on_with = [&](std::size_t next_item) {
    asked.push_back(next_item);
    const bool again = next_item == 3 && std::ranges::count(asked, 3U) < 3;
    return Result<std::optional<std::size_t>>(again ? next_item - 1 : next_item);
  };
  const RunOutcome outcome = s.run();
  ASSERT_EQ(outcome.state, RunState::done) << outcome.error.message;
  EXPECT_EQ(asked, (std::vector<std::size_t>{1, 3, 3, 3, 5})) << "after each time that it is made";
  std::vector<SegmentKind> kinds;
  for (const Segment& segment : s.sink.segments) kinds.push_back(segment.kind);
  EXPECT_EQ(std::ranges::count(kinds, SegmentKind::still), 3);
  for (const Segment& segment : s.sink.segments)
    if (segment.kind == SegmentKind::still) {
      EXPECT_EQ(segment.end_sample - segment.start_sample, 2000);
      EXPECT_EQ(segment.pitch_deg, 90.0);
    }
  ASSERT_EQ(journal.dwells.size(), 5U);
  EXPECT_EQ(journal.dwells[1].item, journal.dwells[3].item);
  EXPECT_EQ(s.watcher.count(RunEvent::move_next), 2) << "the table stays where it is";
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
  for (const bool in_move : {false, true}) {
    RigStation t(two_steps_text);
    TwoTongued imu(t.devices.imu, (in_move ? 1700 : 3500) + 400);
    StationDevices devices = t.devices.devices();
    const RunOutcome outcome = t.run({devices.table, imu, devices.clock, devices.wait});
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

}  // namespace
}  // namespace turncal
