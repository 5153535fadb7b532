#include "imu_io/units/serial_imu.h"

#include "frame_streams.h"
#include "tests/said.h"

namespace turncal {
namespace {

using namespace test;  // NOLINT

Result<SerialImuConfig> parse(const std::string& text, const std::string& name = "a.station") {
  auto file = KeyValueFile::parse(text, name);
  EXPECT_TRUE(file.ok());
  auto config = read_serial_imu_config(*file);
  if (config)
    if (Status status = file->check_all_used(); !status) return status.error();
  return config;
}

TEST(SerialImuConfig, ReadsEveryKey) {
  const auto config = good(
      parse("imu.device = /dev/serial/by-id/x\nimu.frame = laser_gyro\nimu.unit_serial = RLG-7\nimu.baud = 460800\n"
            "imu.accel_pulse_mps = 0.00049\nimu.simulated = true\nimu.speedup = 20\n"));
  EXPECT_EQ(config->settings.device, "/dev/serial/by-id/x");
  EXPECT_EQ(config->frame.name, "laser_gyro");
  EXPECT_EQ(config->settings.unit_serial, "RLG-7");
  EXPECT_EQ(config->frame.line.baud, 460800U);
  EXPECT_EQ(config->settings.speedup, 20.0);
  RecordingInfo info;
  SerialImu(config->frame, config->settings).describe(info);
  EXPECT_EQ(info.accel_pulse_mps, 0.00049);
  EXPECT_TRUE(info.simulated);
}

TEST(SerialImuConfig, AFileIsRelativeToTheStationFile) {
  const TemporaryFolder folder;
  write_file(folder / "own.frame", std::string(builtin_frame_text("stim300")));
  const auto config = good(parse("imu.device = /dev/x\nimu.frame = own.frame\n", folder / "a.station"));
  EXPECT_EQ(config->frame.name, "stim300");
  EXPECT_EQ(config->frame.line.baud, 921600U);
  RecordingInfo info;
  SerialImu(config->frame, config->settings).describe(info);
  EXPECT_FALSE(info.simulated);
}

TEST(SerialImuConfig, OneLineForEachMistake) {
  expect_said("imu_io/serial_units.said", [](const std::string& frame, const std::string&, const std::string& with) {
    return said_of(parse(with + "\nimu.frame = " + frame + "\n"));
  });
}

}  // namespace
}  // namespace turncal
