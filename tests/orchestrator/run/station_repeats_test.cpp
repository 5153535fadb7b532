// Dwells and moves that do not count are done again, whole.

#include "imu_io/recordings/recording_source.h"
#include "orchestrator/jobs/calibration_job.h"
#include "orchestrator/jobs/command_context.h"
#include "orchestrator/records/journal.h"
#include "orchestrator/run/station_run.h"
#include "tests/orchestrator/program.h"
#include "tests/orchestrator/rig_station.h"

namespace turncal {
namespace {

TEST(StationRun, SampleLostInADwellRepeatsItWhole) {
  // Sample 3500 lies in the dwell 3000..5000.
  RigStation s(two_steps_text, rig_with({unit_fault(RigFaultKind::lost_sample, 3500, 3)}));
  const RunOutcome outcome = ended(s.run(), RunState::done);
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

RigFault moved_by(double time_s, double size_deg, bool hidden = false) {
  return {.kind = RigFaultKind::table_moved, .time_s = time_s, .axis = 1, .size = size_deg, .hidden = hidden};
}
const RigFault knock{.kind = RigFaultKind::velocity_knock, .sample = 4400, .size = 0.05};
// As many as come before `end`, `step` samples apart.
std::vector<RigFault> lost_over_and_over(std::int64_t first, std::int64_t end, std::int64_t step) {
  std::vector<RigFault> faults;
  for (std::int64_t sample = first; sample < end; sample += step)
    faults.push_back(unit_fault(RigFaultKind::lost_sample, sample));
  return faults;
}

// A dwell begins at sample 3000; every try ends at the poll after its defect, then 100 samples of settling.
TEST(StationRun, ADisturbedDwellIsRepeatedAndTheRunGoesOn) {
  struct Disturbance {
    const char* what;
    std::vector<RigFault> faults;
    int repeats;
    int moves;
    const char* says;  // why it was bad
  };
  const Disturbance disturbances[] = {
      {"flagged sample", {unit_fault(RigFaultKind::invalid_sample, 4999)}, 1, 2, "flagged its data"},
      {"lost in the alignment", {unit_fault(RigFaultKind::lost_sample, 10)}, 1, 2, " lost at sample"},
      {"knock", {knock}, 1, 2, "accelerometer x"},
      {"moved by itself: back to 90 deg", {moved_by(21.0, 0.05)}, 1, 3, "pitch"},
      {"moved, and no encoder shows it: 0.05 deg/s in the means", {moved_by(21.0, 0.05, true)}, 1, 2, "gyro"},
      {"two repeats each of two dwells are no failure",
       {unit_fault(RigFaultKind::lost_sample, 3010), unit_fault(RigFaultKind::lost_sample, 3410),
        unit_fault(RigFaultKind::lost_sample, 8010), unit_fault(RigFaultKind::lost_sample, 8410)},
       4,
       2,
       " lost at sample"},
      {"told twice", {unit_fault(RigFaultKind::duplicated_sample, 3500)}, 0, 2, ""},
  };
  for (const Disturbance& d : disturbances) {
    SCOPED_TRACE(d.what);
    RigStation s(two_steps_text, rig_with(d.faults));
    const RunOutcome outcome = ended(s.run(), RunState::done);
    EXPECT_EQ(outcome.repeated_dwells, d.repeats);
    EXPECT_EQ(s.watcher.count(RunEvent::dwell_bad), d.repeats);
    EXPECT_EQ(s.watcher.count(RunEvent::move_next), d.moves);
    for (const TransitionRecord& record : s.watcher.transitions) {
      if (record.event == RunEvent::dwell_bad) {
        EXPECT_SAYS(record.detail, d.says);
      }
    }
    for (const Segment& segment : s.sink.segments) {
      const std::int64_t length = segment.end_sample - segment.start_sample;
      if (segment.kind == SegmentKind::still) {
        EXPECT_EQ(length, 2000) << "repeated whole";
      }
      if (segment.kind == SegmentKind::align) {
        EXPECT_EQ(length, 1000);
      }
    }
    if (d.repeats == 0) {
      EXPECT_EQ(s.sink.sample_count, two_steps_samples);
    }
  }
}

// From +0.006 to -0.006 deg: never out of the tolerance of 0.01 deg around the target, and yet the table moved by more.
TEST(StationRun, MotionFromOneSideOfTheTargetToTheOther) {
  RigConfig config = rig_with({moved_by(16.7, 0.006), moved_by(21.001, -0.012)});  // the first while settling
  config.table.in_position_tolerance_deg = 0.02;
  RigStation s(two_steps_text, config);
  s.station.dwell.max_gyro_peak_degps = s.station.dwell.max_gyro_std_degps = 1.0;  // the unit itself is not asked
  const RunOutcome outcome = ended(s.run(), RunState::done);
  EXPECT_EQ(outcome.repeated_dwells, 1);
}

TEST(StationRun, ADwellThatIsNotBelievedIsMadeOnceMore) {
  RigStation s(two_steps_text);
  std::vector<std::size_t> asked;
  s.go_on_with = [&](std::size_t next_item, const RunOutcome&) {
    asked.push_back(next_item);
    const bool again = next_item == 3 && std::ranges::count(asked, 3U) < 3;
    return Result<std::optional<std::size_t>>(again ? next_item - 1 : next_item);
  };
  ended(s.run(), RunState::done);
  EXPECT_EQ(asked, (std::vector<std::size_t>{1, 3, 3, 3, 5})) << "after each time that it is made";
  EXPECT_EQ(std::ranges::count(s.sink.segments, SegmentKind::still, &Segment::kind), 3);
  for (const Segment& segment : s.sink.segments)
    if (segment.kind == SegmentKind::still) {
      EXPECT_EQ(segment.end_sample - segment.start_sample, 2000);
      EXPECT_EQ(segment.pitch_deg, 90.0);
    }
  ASSERT_EQ(s.kept.dwells.size(), 5U);
  EXPECT_EQ(s.kept.dwells[1].item, s.kept.dwells[3].item);
  EXPECT_EQ(s.watcher.count(RunEvent::move_next), 2) << "the table stays where it is";
}

TEST(StationRun, TooManyRepeatsEndTheRun) {
  RigStation s(two_steps_text, rig_with(lost_over_and_over(3000, 12000, 300)));
  const RunOutcome outcome = ended(s.run(), RunState::failed);
  EXPECT_EQ(exit_code(outcome.error.kind), 50);
  EXPECT_EQ(outcome.repeated_dwells, 2);  // dwell.max_repeats
  EXPECT_EQ(s.watcher.count(RunEvent::dwell_bad), 3);
  EXPECT_SAYS(outcome.error.message, "step 1");
  EXPECT_SAYS(outcome.error.message, " lost at sample");
  EXPECT_TRUE(s.at_rest());
}

TEST(StationRun, UnitThatKeepsFlaggingItsDataFailed) {
  RigStation s(two_steps_text, rig_with({unit_fault(RigFaultKind::invalid_sample, 3500, 1'000'000)}));
  const RunOutcome outcome = ended(s.run(), RunState::failed);
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
  const RunOutcome outcome = ended(s.run(), RunState::done);
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
  RigStation s(two_steps_text, rig_with(lost_over_and_over(1500, 60000, 1500)));
  const RunOutcome outcome = ended(s.run(), RunState::failed);
  EXPECT_EQ(exit_code(outcome.error.kind), 50);
  EXPECT_EQ(outcome.repeated_moves, s.station.dwell.max_repeats);
  EXPECT_SAYS(outcome.error.message, "the move was repeated");
}

// Stopped while the table goes back, and taken up: the move is done once more, from where the last dwell stood.
TEST(StationRun, AMoveThatIsRepeatedIsTakenUp) {
  RigStation s(two_steps_text, rig_with({unit_fault(RigFaultKind::lost_sample, 2000)}));
  s.station.resume_rest_s = 1.0;
  s.watcher.on_tick = [&](const RunSnapshot& at) {
    if (s.watcher.saw(RunEvent::move_bad) && at.state == RunState::moving) s.stop_requests = 1;
  };
  ASSERT_EQ(s.run().state, RunState::aborted);
  ASSERT_EQ(s.kept.dwells.size(), 1u);
  s.resume = ResumePoint{s.kept.dwells.back(), false};
  s.stop_requests = 0;
  s.watcher.on_tick = nullptr;
  const RunOutcome outcome = ended(s.run(), RunState::done);
  EXPECT_EQ(outcome.units[0].lost_samples, 0U) << "those were cut away with the move";
  using enum SegmentKind;
  const std::vector<std::pair<SegmentKind, double>> expected = {
      {align, 0.0}, {rotate, 0.0}, {rotate, 90.0}, {SegmentKind::still, 90.0}, {rotate, 0.0}, {align, 0.0}};
  EXPECT_EQ(kinds_and_pitch(s.sink.segments), expected);
}

// One sample comes a second time with another content.
TEST(StationRun, DuplicatesThatDifferRepeatTheDwell) {
  for (const bool in_move : {false, true}) {
    RigStation t(two_steps_text);
    std::int64_t from = (in_move ? 1700 : 3500) + 400;
    ImuSample last;
    FrontUnit imu(t.devices.imu, [&](std::span<ImuSample> out, double timeout_s) -> Result<std::size_t> {
      if (last.counter >= from) {
        from = std::numeric_limits<std::int64_t>::max();
        out[0] = last;
        out[0].accel[0] += 1.0;
        return std::size_t{1};
      }
      const Result<std::size_t> got = t.devices.imu.read(out, timeout_s);
      if (got && *got > 0) last = out[*got - 1];
      return got;
    });
    const RunOutcome outcome = ended(t.run_with(imu), RunState::done);
    EXPECT_EQ(outcome.repeated_dwells, in_move ? 0 : 1);
    EXPECT_EQ(outcome.repeated_moves, in_move ? 1 : 0);
    EXPECT_EQ(outcome.units[0].duplicate_samples, 1U);
  }
}

// ---- gap ----

// A run that goes on while time passed: the unit ran on or began its counter anew, the table was switched off, and the
// parameters are still those of the unit.

// The demo sequence on the rig, in sessions that each go on where the one before was stopped.
struct GapStation : RigStation {
  explicit GapStation(double rest_s)
      : RigStation(file_text(std::string(TURNCAL_SOURCE_DIR) + "/sequences/short_demo.seq")) {
    station.resume_rest_s = rest_s;
  }
  RunOutcome session() {
    RecordingSink on_disk(folder.path());
    sinks = {&on_disk};
    return run();
  }
  // Stopped at stop_s of the session, after a dwell at least, and left alone for away_s.
  void interrupted_session(double stop_s, double away_s) {
    stop_requests = 0;
    watcher.on_tick = [this, stop_s](const RunSnapshot& at) {
      if (at.time_s >= stop_s && !kept.dwells.empty()) stop_requests = 1;
    };
    ASSERT_EQ(session().state, RunState::aborted);
    ASSERT_FALSE(kept.dwells.empty());
    resume = ResumePoint{kept.dwells.back(), false};
    devices.devices().wait(away_s);
    watcher.on_tick = nullptr;
    stop_requests = 0;
  }
  std::string recording() const { return RecordingSink(folder.path()).path(); }
  void expect_truth(RecordingSource& source) const {
    const Result<LoadedRecording> loaded = good(load_recording(source));
    const Result<CalibrationOutput> output = good(calibrate_recording(*loaded, {}));
    const std::array<double, 24> truth = rig.truth_at_reference(output->mean_temperature_c.value_or(24.0));
    for (std::size_t i = 0; i < truth.size(); ++i) {
      if (!output->file.sigma[i]) continue;
      EXPECT_LT(std::abs(output->file.parameters[Eigen::Index(i)] - truth[i]), 5.0 * *output->file.sigma[i])
          << parameter_keys[i];
    }
  }

  TemporaryFolder folder;
};

class Gap : public testing::TestWithParam<double> {};

// Stopped after some dwells, and taken up by another program after GetParam() seconds.
TEST_P(Gap, RestsSettlesAndIsCutThere) {
  GapStation s(30.0);
  // In a dwell that follows a dwell, in a move from where homing does not leave the table, and in another.
  for (const double stop_s : {9.0, 60.0, 130.0}) ASSERT_NO_FATAL_FAILURE(s.interrupted_session(stop_s, GetParam()));
  const double began_s = s.clock.now_s();
  const RunOutcome outcome = ended(s.session(), RunState::done);
  EXPECT_EQ(std::ranges::count(s.kept.commands, false, [](const TableCommand& c) { return c.move.has_value(); }), 4);
  EXPECT_TRUE(s.watcher.saw(RunEvent::rest_over));
  EXPECT_GT(s.clock.now_s() - began_s, 30.0);
  EXPECT_EQ(outcome.units[0].lost_samples, 0u) << "the gap is no loss of the link";

  Result<std::unique_ptr<RecordingSource>> source = good(RecordingSource::open(s.recording()));
  // Every dwell of the plan is there once and whole; each gap is one sample, in a rotate segment.
  std::vector<std::int64_t> dwells, planned, gaps;
  for (const Segment& segment : (*source)->segments())
    if (segment.kind != SegmentKind::rotate) dwells.push_back(segment.end_sample - segment.start_sample);
  for (const PlannedItem& item : s.plan.items)
    if (item.kind == SequenceItem::Kind::dwell) planned.push_back(item.samples);
  EXPECT_EQ(dwells, planned);
  std::int64_t next = 0;
  const Status read = (*source)->read([&](std::span<const ImuSample> samples) {
    for (const ImuSample& sample : samples) {
      if (sample.counter != next) gaps.push_back(sample.counter - next);
      next = sample.counter + 1;
    }
    return Status{};
  });
  ASSERT_TRUE(read.ok());
  EXPECT_EQ(gaps, (std::vector<std::int64_t>{1, 1, 1}));

  s.expect_truth(**source);
}

// Cut in several places among dwells of 5 s, in which the noise hardly shows: the fit must find its way from the start values.
TEST(Gap, SeveralAmongTheFirstDwells) {
  for (const std::vector<double>& stops_s :
       {std::vector<double>{8.757, 41.560, 15.676, 55.946}, {27.087, 37.770, 13.896, 52.318}}) {
    GapStation s(2.0);
    for (const double stop_s : stops_s) ASSERT_NO_FATAL_FAILURE(s.interrupted_session(stop_s, 5.0));
    ASSERT_EQ(s.session().state, RunState::done);
    Result<std::unique_ptr<RecordingSource>> source = good(RecordingSource::open(s.recording()));
    s.expect_truth(**source);
  }
}

INSTANTIATE_TEST_SUITE_P(SecondsAndHours, Gap, testing::Values(5.0, 7200.0));

}  // namespace
}  // namespace turncal
