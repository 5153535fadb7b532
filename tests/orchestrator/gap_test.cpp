// A run that goes on while time passed: the unit ran on or began its counter anew, the table was switched off, and the
// parameters are still those of the unit.
#include <gtest/gtest.h>

#include <fstream>
#include <sstream>

#include "imu_io/recording_source.h"
#include "orchestrator/calibration_job.h"
#include "orchestrator/recording_sink.h"
#include "tests/orchestrator/rig_station.h"
#include "tests/imu_io/temporary_folder.h"

namespace turncal {
namespace {

class Gap : public testing::TestWithParam<double> {};

// Stopped after some dwells, and taken up by another program after GetParam() seconds.
TEST_P(Gap, RestsSettlesAndIsCutThere) {
  std::ifstream file(std::string(TURNCAL_SOURCE_DIR) + "/sequences/short_demo.seq");
  std::stringstream text;
  text << file.rdbuf();
  RigStation s(text.str());
  const test::TemporaryFolder folder;
  s.station.resume_rest_s = 30.0;
  s.devices.imu.describe(s.info);
  s.plan = make_plan(s.sequence, plan_limits(s.station, s.info.sample_period_s));
  DwellJournal journal;
  // In a dwell that follows a dwell, in a move from where homing does not leave the table, and in another.
  for (const double stop_s : {9.0, 60.0, 130.0}) {
    s.stop_requests = 0;
    s.watcher.on_tick = [&](const RunSnapshot& at) {
      if (at.time_s >= stop_s && !journal.dwells.empty()) s.stop_requests = 1;
    };
    RecordingSink sink(folder.path());
    StationRun run(s.devices.devices(), {s.sequence, s.plan, s.station, "SN1", s.resume}, sink,
                   {&s.watcher, &s.stop_requests, {}, &journal});
    ASSERT_EQ(run.run().state, RunState::aborted);
    ASSERT_FALSE(journal.dwells.empty());
    s.resume = ResumePoint{journal.dwells.back(), false};
    s.devices.devices().wait(GetParam());
  }
  s.watcher.on_tick = nullptr;
  s.stop_requests = 0;
  RecordingSink sink(folder.path());
  const double began_s = s.clock.now_s();
  StationRun run(s.devices.devices(), {s.sequence, s.plan, s.station, "SN1", s.resume}, sink,
                 {&s.watcher, &s.stop_requests, {}, &journal});
  const RunOutcome outcome = run.run();
  ASSERT_EQ(outcome.state, RunState::done) << outcome.error.message;
  EXPECT_EQ(journal.homings, 4);
  EXPECT_TRUE(s.watcher.saw(RunEvent::rest_over));
  EXPECT_GT(s.clock.now_s() - began_s, 30.0);
  EXPECT_EQ(outcome.units[0].lost_samples, 0u) << "the gap is no loss of the link";

  Result<std::unique_ptr<RecordingSource>> source = RecordingSource::open(sink.path());
  ASSERT_TRUE(source.ok()) << source.error().message;
  // Every dwell of the plan is there once and whole; each gap is one sample, in a rotate segment.
  std::vector<std::int64_t> dwells, planned, gaps;
  for (const Segment& segment : (*source)->segments()) {
    if (segment.kind != SegmentKind::rotate) dwells.push_back(segment.end_sample - segment.start_sample);
  }
  for (const PlannedItem& item : s.plan.items) {
    if (item.kind == SequenceItem::Kind::dwell) planned.push_back(item.samples);
  }
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

  const Result<CalibrationOutput> output = calibrate_recording(**source, {});
  ASSERT_TRUE(output.ok()) << output.error().message;
  const std::array<double, 24> truth = s.rig.truth_at_reference(output->mean_temperature_c.value_or(24.0));
  for (std::size_t i = 0; i < truth.size(); ++i) {
    if (!output->file.sigma[i]) continue;
    EXPECT_LT(std::abs(output->file.parameters[static_cast<Eigen::Index>(i)] - truth[i]), 5.0 * *output->file.sigma[i])
        << parameter_keys[i];
  }
}

// Cut in several places among dwells of 5 s, in which the noise hardly shows: the fit must find its way from the start values.
TEST(Gap, SeveralAmongTheFirstDwells) {
  std::ifstream file(std::string(TURNCAL_SOURCE_DIR) + "/sequences/short_demo.seq");
  std::stringstream text;
  text << file.rdbuf();
  for (const std::vector<double>& stops_s : {std::vector<double>{8.757, 41.560, 15.676, 55.946}, {27.087, 37.770, 13.896, 52.318}}) {
    RigStation s(text.str());
    const test::TemporaryFolder folder;
    s.station.resume_rest_s = 2.0;
    s.devices.imu.describe(s.info);
    s.plan = make_plan(s.sequence, plan_limits(s.station, s.info.sample_period_s));
    DwellJournal journal;
    for (const double stop_s : stops_s) {  // of the session
      s.stop_requests = 0;
      s.watcher.on_tick = [&](const RunSnapshot& at) {
        if (at.time_s >= stop_s && !journal.dwells.empty()) s.stop_requests = 1;
      };
      RecordingSink sink(folder.path());
      StationRun run(s.devices.devices(), {s.sequence, s.plan, s.station, "SN1", s.resume}, sink,
                     {&s.watcher, &s.stop_requests, {}, &journal});
      ASSERT_EQ(run.run().state, RunState::aborted);
      s.resume = ResumePoint{journal.dwells.back(), false};
      s.devices.devices().wait(5.0);
    }
    s.watcher.on_tick = nullptr;
    s.stop_requests = 0;
    RecordingSink sink(folder.path());
    StationRun run(s.devices.devices(), {s.sequence, s.plan, s.station, "SN1", s.resume}, sink,
                   {&s.watcher, &s.stop_requests, {}, &journal});
    ASSERT_EQ(run.run().state, RunState::done);
    Result<std::unique_ptr<RecordingSource>> source = RecordingSource::open(sink.path());
    ASSERT_TRUE(source.ok()) << source.error().message;
    const Result<CalibrationOutput> output = calibrate_recording(**source, {});
    ASSERT_TRUE(output.ok()) << output.error().message;
    const std::array<double, 24> truth = s.rig.truth_at_reference(output->mean_temperature_c.value_or(24.0));
    for (std::size_t i = 0; i < truth.size(); ++i) {
      if (!output->file.sigma[i]) continue;
      EXPECT_LT(std::abs(output->file.parameters[static_cast<Eigen::Index>(i)] - truth[i]), 5.0 * *output->file.sigma[i])
          << parameter_keys[i];
    }
  }
}

INSTANTIATE_TEST_SUITE_P(SecondsAndHours, Gap, testing::Values(5.0, 7200.0));

}  // namespace
}  // namespace turncal
