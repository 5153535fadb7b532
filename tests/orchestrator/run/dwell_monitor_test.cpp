// Which dwells count: by the unit's counter, its flags, and its own account of standing still.
#include "orchestrator/run/dwell_monitor.h"
#include "tests/test.h"

namespace turncal {
namespace {

RecordingInfo info() {
  RecordingInfo i;
  i.accel_pulse_mps = 0.0005;
  return i;
}

// 10 s at rest: 15 deg/h on x (0.0224 pulses of 0.93292" a sample), +9.79 m/s^2 on y (97.9 pulses).
std::vector<ImuSample> at_rest(std::int64_t first, std::int64_t count) {
  std::vector<ImuSample> samples(static_cast<std::size_t>(count));
  for (std::int64_t i = 0; i < count; ++i) {
    ImuSample& s = samples[std::size_t(i)];
    s.counter = first + i;
    s.gyro = {std::floor(0.0224 * double(i + 1)) - std::floor(0.0224 * double(i)), 0.0, 0.0};
    s.accel = {0.0, 97.9, 0.0};
  }
  return samples;
}

std::string verdict(const std::vector<ImuSample>& samples, const DwellConfig& config = {}) {
  DwellMonitor monitor(config, info());
  monitor.start(500, 2000);
  const auto& defect = monitor.add(samples);
  if (defect) return defect->reason;
  return monitor.complete() ? "complete" : "incomplete";
}

TEST(DwellMonitor, CountsByTheCounter) {
  EXPECT_EQ(verdict(at_rest(500, 2000)), "complete");
  EXPECT_EQ(verdict(at_rest(500, 1999)), "incomplete");
  DwellMonitor monitor({}, info());
  monitor.start(500, 2000);
  EXPECT_EQ(monitor.remaining(), 2000);
  EXPECT_FALSE(monitor.add(at_rest(500, 1500)));
  EXPECT_EQ(monitor.remaining(), 500);
}

TEST(DwellMonitor, EveryLostSampleIsSeen) {
  for (const std::size_t lost : {0U, 1U, 777U, 1998U}) {
    std::vector<ImuSample> samples = at_rest(500, 2000);
    samples.erase(samples.begin() + std::ptrdiff_t(lost));
    EXPECT_EQ(verdict(samples), "1 sample lost at sample " + std::to_string(500 + lost));
  }
}

// A turn of 0.02 deg within the sixth second is 0.02 deg/s in its mean: 77.2 pulses of 0.93292" more. It stands off the
// mean of six by 5/6 of that, 0.01667 deg/s. Limit 0.01 deg/s. In ten samples: in one it would be a glitch.
TEST(DwellMonitor, JumpOfTheGyroMean) {
  std::vector<ImuSample> samples = at_rest(500, 2000);
  for (std::size_t i = 0; i < 10; ++i) samples[1100 + i].gyro[1] += 7.72;
  EXPECT_EQ(verdict(samples).rfind("not still: gyro y mean jumps by 0.01667 deg/s", 0), 0U) << verdict(samples);
  // Limits apart the same data are fine.
  EXPECT_EQ(verdict(samples, {.max_gyro_std_degps = 0.03, .max_gyro_peak_degps = 0.03}), "complete");
}

// A count that is held for a while and then catches up by two pulses is the unit's resolution, in every sample of a dwell.
TEST(DwellMonitor, PulsesThatComeTogetherAreNoKnock) {
  std::vector<ImuSample> samples = at_rest(500, 2000);
  for (std::size_t i = 0; i + 2 < samples.size(); i += 3) {
    samples[i].accel = samples[i + 1].accel = {0.0, 97.0, -1.0};
    samples[i + 2].accel = {0.0, 99.7, 2.0};
    samples[i].gyro[1] -= 1.0;
    samples[i + 2].gyro[1] += 1.0;
  }
  EXPECT_EQ(verdict(samples), "complete");
  DwellConfig sample_by_sample;
  sample_by_sample.stillness_window_s = 0.005;
  EXPECT_NE(verdict(samples, sample_by_sample), "complete");
}

// Neither large enough to be impossible, nor a knock of the table: one sample, in any window, the first included.
TEST(DwellMonitor, OneSampleAloneIsNamedAsAGlitch) {
  for (const std::size_t at : {30U, 777U, 1990U}) {
    std::vector<ImuSample> samples = at_rest(500, 2000);
    samples[at].gyro[1] = -900.0;
    EXPECT_EQ(verdict(samples).find("glitch: gyro y gave -900 in sample " + std::to_string(500 + at) + " ("), 0U)
        << verdict(samples);
    // Two of them are a motion as well as anything.
    samples[at - 1].gyro[1] = -900.0;
    EXPECT_EQ(verdict(samples).find("not still: gyro y"), 0U) << verdict(samples);
  }
}

// Slow swaying stays below the peak limit but scatters: 0.004 deg/s amplitude, 0.0772 pulses a sample, has a standard deviation of
// 0.0028 > 0.002. A knock of 0.03 m/s in one sample: 60 pulses, 0.03 m/s^2 in one second's mean; limit 0.02 m/s^2.
TEST(DwellMonitor, WhatIsNotStillIsNamed) {
  std::vector<ImuSample> swaying = at_rest(500, 2000), knocked = swaying, unknown = swaying;
  for (std::size_t i = 0; i < swaying.size(); ++i)
    swaying[i].gyro[2] += 0.0772 * (i / 400 % 2 == 0 ? 1.0 : -1.0) + (i % 2 == 0 ? 0.5 : -0.5);
  knocked[900].accel[2] += 60.0;
  unknown[10].accel[0] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_SAYS(verdict(swaying), "gyro z means scatter");
  EXPECT_SAYS(verdict(knocked), "accelerometer z");
  EXPECT_NE(verdict(unknown), "complete");
}

// A unit that froze in a turn gives 4 deg/s for a whole dwell: nothing of that dwell shows it.
TEST(DwellMonitor, ADwellOfOneSampleIsNone) {
  std::vector<ImuSample> frozen = at_rest(2500, 2000);
  for (ImuSample& sample : frozen) sample.gyro = {0.0, 77.0, 0.0};
  DwellMonitor monitor({}, info());
  monitor.start(500, 2000);
  std::vector<ImuSample> lives = at_rest(500, 2000);
  for (std::size_t i = 0; i < lives.size(); i += 3) lives[i].accel[1] += 1.0;
  EXPECT_FALSE(monitor.add(lives));
  monitor.start(2500, 2000);
  const auto& defect = monitor.add(frozen);
  ASSERT_TRUE(defect);
  EXPECT_EQ(defect->reason, "all six channels gave the same in 2000 samples, 2500 to 4499 (10.000 s)");
  // A unit that seldom changes at rest may have stood as still as that.
  DwellMonitor coarse({}, info());
  coarse.start(500, 2000);
  EXPECT_FALSE(coarse.add(at_rest(500, 2000)));
  coarse.start(2500, 2000);
  EXPECT_FALSE(coarse.add(frozen));
}

TEST(DwellMonitor, StartsAfreshAfterFlaggedData) {
  DwellMonitor monitor({}, info());
  monitor.start(0, 2000);
  std::vector<ImuSample> bad = at_rest(0, 400);
  bad.back().flags = sample_flag_invalid;
  const auto& defect = monitor.add(bad);
  ASSERT_TRUE(defect);
  EXPECT_EQ(defect->kind, ErrorKind::unit_failed);
  monitor.start(400, 2000);
  EXPECT_FALSE(monitor.add(at_rest(400, 2000)));
  EXPECT_TRUE(monitor.complete());
}

}  // namespace
}  // namespace turncal
