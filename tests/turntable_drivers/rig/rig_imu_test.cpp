// The simulated unit as a source: time, counters, and its faults.
#include "turntable_drivers/rig/rig_devices.h"

#include "tests/test.h"
#include "tests/turntable_drivers/rig/perfect_rig.h"

namespace turncal {
namespace {

struct Source {
  explicit Source(const RigConfig& config) : rig(config), imu(rig) { EXPECT_TRUE(imu.open().ok()); }
  std::vector<ImuSample> read(std::size_t room, double timeout_s) {
    std::vector<ImuSample> out(room);
    const Result<std::size_t> count = imu.read(out, timeout_s);
    EXPECT_TRUE(count.ok());
    out.resize(count.ok() ? *count : 0);
    return out;
  }
  Rig rig;
  RigImu imu;
};

RigConfig quiet_config() {
  RigConfig config = perfect_rig_config();
  config.first_counter = 1000;
  return config;
}

RigConfig with_fault(const RigFault& fault) {
  RigConfig config = quiet_config();
  config.faults.push_back(fault);
  return config;
}

TEST(RigImu, ReadingPassesTimeAndNothingElseDoes) {
  Source s(quiet_config());
  EXPECT_EQ(s.read(100, 0.1).size(), 20u);
  EXPECT_NEAR(s.rig.time_s(), 0.1, 1e-12);
  EXPECT_EQ(s.read(7, 10.0).size(), 7u);
  EXPECT_EQ(s.rig.samples_passed(), 27);
  EXPECT_EQ(s.read(100, 0.004).size(), 0u);
  EXPECT_EQ(s.read(100, 0.005).size(), 1u);
  EXPECT_EQ(s.read(0, 1.0).size(), 0u);
  EXPECT_EQ(s.rig.samples_passed(), 28);
  EXPECT_EQ(s.read(1, 1.0)[0].counter, 1028);
  EXPECT_EQ(s.imu.counters().samples, 29u);
}

TEST(RigImu, DescribesItself) {
  RigConfig config = default_rig_config();
  config.unit_serial = "RG-7";
  Source s(config);
  RecordingInfo info;
  info.latitude_deg = 12.0;
  s.imu.describe(info);
  EXPECT_EQ(info.sample_period_s, 0.005);
  EXPECT_EQ(info.gyro_increment, IncrementKind::pulses);
  EXPECT_EQ(info.accel_increment, IncrementKind::pulses);
  EXPECT_EQ(info.accel_pulse_mps, 0.0005);
  EXPECT_TRUE(info.has_temperature);
  EXPECT_TRUE(info.simulated);
  EXPECT_EQ(info.latitude_deg, 12.0);
  EXPECT_EQ(s.imu.identify()->unit_serial, "RG-7");
  EXPECT_TRUE(Source(default_rig_config()).imu.identify()->unit_serial.empty());
}

TEST(RigImu, ClosedSourceIsAnError) {
  Rig rig(quiet_config());
  RigImu imu(rig);
  std::vector<ImuSample> out(3);
  EXPECT_FALSE(imu.read(out, 1.0).ok());
  EXPECT_FALSE(imu.identify().ok());
  EXPECT_EQ(rig.samples_passed(), 0);
}

// A lost sample takes its 97.914 pulses of gravity with it.
TEST(RigImuFaults, LostSampleLeavesAGap) {
  Source s(with_fault({.kind = RigFaultKind::lost_sample, .sample = 5, .count = 2}));
  const auto samples = s.read(100, 0.05);
  ASSERT_EQ(samples.size(), 8u);
  EXPECT_EQ(samples[4].counter, 1004);
  EXPECT_EQ(samples[5].counter, 1007);
  EXPECT_NEAR(samples[5].accel[1], 97.914, 1e-9);
  EXPECT_EQ(s.rig.samples_passed(), 10);
  EXPECT_EQ(s.imu.counters().lost_samples, 2u);
}

TEST(RigImuFaults, HiddenLossLeavesNoGap) {
  Source s(with_fault({.kind = RigFaultKind::lost_sample, .sample = 5, .hidden = true}));
  const auto samples = s.read(100, 0.05);
  ASSERT_EQ(samples.size(), 9u);
  for (std::size_t i = 0; i < samples.size(); ++i) EXPECT_EQ(samples[i].counter, 1000 + static_cast<std::int64_t>(i));
  EXPECT_EQ(s.imu.counters().lost_samples, 0u);
}

TEST(RigImuFaults, DuplicatedSample) {
  for (const bool hidden : {false, true}) {
    Source s(with_fault({.kind = RigFaultKind::duplicated_sample, .sample = 3, .hidden = hidden}));
    auto samples = s.read(4, 1.0);  // the duplicate no longer has room: it comes first next time
    for (const ImuSample& sample : s.read(4, 1.0)) samples.push_back(sample);
    ASSERT_EQ(samples.size(), 8u);
    EXPECT_EQ(samples[3].counter, 1003);
    EXPECT_EQ(samples[4].counter, hidden ? 1004 : 1003);
    EXPECT_EQ(samples[4].accel, samples[3].accel);
    EXPECT_EQ(samples[5].counter, hidden ? 1005 : 1004);
    EXPECT_EQ(s.rig.samples_passed(), 7);
    EXPECT_EQ(s.imu.counters().duplicates, hidden ? 0u : 1u);
  }
}

TEST(RigImuFaults, GlitchKnockAndInvalidFlag) {
  RigConfig config = quiet_config();
  // 1 mrad = 206.264806 arcsec = 221.095920 pulses; -0.05 m/s = -100 pulses
  config.faults = {{.kind = RigFaultKind::gyro_glitch, .sample = 2, .axis = 2, .size = 1.0},
                   {.kind = RigFaultKind::velocity_knock, .sample = 3, .axis = 0, .size = -0.05},
                   {.kind = RigFaultKind::invalid_sample, .sample = 4, .count = 2}};
  Source s(config);
  const auto samples = s.read(8, 1.0);
  for (std::size_t i = 0; i < samples.size(); ++i) {
    EXPECT_NEAR(samples[i].gyro[2], i == 2 ? 221.095920 : 0.0, 1e-5) << i;
    EXPECT_NEAR(samples[i].accel[0], i == 3 ? -100.0 : 0.0, 1e-9) << i;
    EXPECT_EQ(samples[i].flags, i == 4 || i == 5 ? sample_flag_invalid : 0u) << i;
    EXPECT_NEAR(samples[i].accel[1], 97.914, 1e-9) << i;
  }
}

}  // namespace
}  // namespace turncal
