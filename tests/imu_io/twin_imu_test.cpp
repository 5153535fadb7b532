// The rig's unit as a unit on a line: what the receiver gets is what the rig made.
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <thread>

#include "frame_streams.h"
#include "imu_io/base/deadline.h"
#include "imu_io/lines/pty.h"
#include "imu_io/units/frame_streamer.h"
#include "imu_io/units/serial_imu.h"
#include "turntable_drivers/rig/rig.h"
#include "turntable_drivers/rig/rig_imu.h"

namespace turncal {
namespace {

TEST(TwinImu, TheRigsSamplesComeOverTheLineUnchanged) {
  const RigConfig config = default_rig_config();
  Rig rig(config);
  RigImu unit(rig);
  auto pty = Pty::create();
  ASSERT_OK(pty);
  const FrameDescription frame = test::frame_named("laser_gyro");
  constexpr double speedup = 50.0;
  FrameStreamer streamer(unit, frame, *pty, speedup);
  SerialImuSettings settings;
  settings.device = pty->device();
  settings.simulated = true;
  settings.speedup = speedup;
  SerialImu imu(frame, settings);
  ASSERT_OK(imu.open());
  RecordingInfo info;
  imu.describe(info);
  EXPECT_TRUE(info.simulated);
  ASSERT_OK(streamer.start(monotonic_s()));
  Status sent;
  const std::atomic<bool> stop = false;
  std::atomic<bool> all_sent = false;
  std::thread sender([&] {
    sent = streamer.run(0.6, stop);
    all_sent = true;
  });
  std::vector<ImuSample> received;
  std::array<ImuSample, 256> block;
  Status reading;
  for (const Deadline deadline(20.0); !deadline.passed() && reading.ok();) {
    const bool last = all_sent;  // then what there is has been sent before it is read
    const auto n = imu.read(block, 0.05);
    if (!n) {
      reading = n.error();
    } else {
      received.insert(received.end(), block.begin(), block.begin() + static_cast<std::ptrdiff_t>(*n));
      if (last && *n == 0) break;
    }
  }
  sender.join();
  ASSERT_OK(sent);
  ASSERT_OK(reading);
  ASSERT_EQ(received.size(), streamer.frames_sent());
  ASSERT_GT(received.size(), 1000U);  // 0.6 s are 6000 on a quiet machine

  Rig same(config);
  std::vector<ImuSample> expected(received.size());
  same.advance(expected);
  for (std::size_t i = 0; i < expected.size(); ++i) {
    ASSERT_EQ(received[i].counter, expected[i].counter);
    ASSERT_EQ(received[i].gyro, expected[i].gyro);
    ASSERT_EQ(received[i].accel, expected[i].accel);
    ASSERT_NEAR(received[i].temperature_c, expected[i].temperature_c, 0.0051);  // the frame has 0.01 C
  }
  EXPECT_EQ(imu.counters().lost_samples, 0U);
}

}  // namespace
}  // namespace turncal
