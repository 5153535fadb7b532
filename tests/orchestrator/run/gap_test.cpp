// A run that goes on while time passed: the unit ran on or began its counter anew, the table was switched off, and the
// parameters are still those of the unit.

#include "imu_io/recordings/recording_source.h"
#include "orchestrator/jobs/calibration_job.h"
#include "orchestrator/records/journal.h"
#include "tests/orchestrator/program.h"
#include "tests/orchestrator/rig_station.h"

namespace turncal {
namespace {

// The demo sequence on the rig, in sessions that each go on where the one before was stopped.
struct GapStation : RigStation {
  explicit GapStation(double rest_s)
      : RigStation(file_text(std::string(TURNCAL_SOURCE_DIR) + "/sequences/short_demo.seq")) {
    station.resume_rest_s = rest_s;
  }
  RunOutcome session() {
    RecordingSink on_disk(folder.path());
    into = &on_disk;
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
      EXPECT_LT(std::abs(output->file.parameters[static_cast<Eigen::Index>(i)] - truth[i]),
                5.0 * *output->file.sigma[i])
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
  EXPECT_EQ(std::ranges::count(s.kept.commands, false, [](const JournalCommand& c) { return c.move.has_value(); }), 4);
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
