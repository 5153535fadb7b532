#include "imu_io/units/serial_imu.h"

#include "frame_streams.h"
#include "tests/test.h"

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
  EXPECT_ERROR(parse("imu.frame = laser_gyro\n"), "a.station: key 'imu.device' is missing: expected a text");
  for (const char* line : {"usb:1", "udp:", "udp:0", "udp:host:5000", "udp:1.2.3:5", "udp_to:5000", "udp_to::5",
                           "tcp:5000", "tcp:host:70000", "tcp::1"}) {
    EXPECT_ERROR(parse("imu.device = " + std::string(line) + "\nimu.frame = laser_gyro\n"),
                 "a.station:1: key 'imu.device' = '" + std::string(line) +
                     "': expected a serial device such as /dev/serial/by-id/..., tcp:HOST:PORT, udp:PORT, "
                     "udp:ADDRESS:PORT or udp_to:HOST:PORT");
  }
  for (const char* line : {"udp:5000", "udp:127.0.0.1:5000", "tcp:host:1", "tcp:10.0.0.5:4001"})
    ASSERT_OK(parse("imu.device = " + std::string(line) + "\nimu.frame = laser_gyro\n"));
  EXPECT_ERROR(
      parse("imu.device = udp:5000\nimu.frame = f64_55aa34\n"),
      "a.station:1: key 'imu.device' = 'udp:5000': expected a frame with a counter: only it tells of datagrams "
      "that were lost");
  EXPECT_ERROR(
      parse("imu.device = udp_to:h:1\nimu.frame = laser_gyro\n"),
      "a.station:1: key 'imu.device' = 'udp_to:h:1': expected udp:PORT, or a frame with a request: without one "
      "nothing is sent there");
  EXPECT_ERROR(parse("imu.device = tcp:h:1\nimu.frame = laser_gyro\nimu.baud = 9600\n"),
               "a.station:3: key 'imu.baud' = '9600': expected no such key unless the device is a serial line");
  EXPECT_ERROR(parse("imu.device = /dev/x\nimu.frame = laser_gyro\nimu.speedup = 20\n"),
               "a.station:3: key 'imu.speedup' = '20': expected 1 unless imu.simulated is true");
  EXPECT_ERROR(parse("imu.device = /dev/x\nimu.frame = laser_gyro\nimu.clock_max_ppm = 2e-10\n"),
               "a.station:3: key 'imu.clock_max_ppm' = '2e-10': expected a number between 0.1 and 2000");
  EXPECT_ERROR(parse("imu.device = /dev/x\nimu.frame = stim300\nimu.accel_pulse_mps = 1\n"),
               "a.station:3: key 'imu.accel_pulse_mps' = '1': expected no such key: the frame's accelerometers do not "
               "send pulses");
  EXPECT_ERROR(
      parse("imu.device = /dev/x\nimu.frame = laser_gyro\nimu.baud = 57600\n"),
      "a.station:3: key 'imu.baud' = '57600': expected a line of at least 72000 baud, for 36 bytes each 0.005 s; "
      "it has 57600");
  const auto unknown = parse("imu.device = /dev/x\nimu.frame = stim\n");
  ASSERT_FALSE(unknown.ok());
  EXPECT_TRUE(unknown.error().message.starts_with(
      "a.station:2: key 'imu.frame' = 'stim': expected a built-in frame or a file: frame 'stim' is not known"))
      << unknown.error().message;
}

}  // namespace
}  // namespace turncal
