// The rig's unit as a unit on a line: what the receiver gets is what the rig made.

#include <thread>

#include "frame_streams.h"
#include "imu_io/base/clock.h"
#include "imu_io/lines/unit_end.h"
#include "imu_io/units/serial_imu.h"
#include "tests/imu_io/counting_source.h"
#include "tests/imu_io/loopback.h"
#include "turntable_drivers/rig/rig.h"
#include "turntable_drivers/rig/rig_devices.h"

namespace turncal {
namespace {

// Every form of frame over every kind of line, as a station's imu.device and imu.frame name them.
struct Spoken {
  const char* name;
  const char* line;  // %d: a free port
  std::vector<std::string> keys;
  double speedup = 1.0;
};

class TwinForms : public testing::TestWithParam<Spoken> {};

TEST_P(TwinForms, WhatTheTwinSpeaksIsUnderstood) {
  const std::string line(GetParam().line);
  std::string device = line;
  if (const std::size_t at = line.find("%d"); at != std::string::npos)
    device.replace(at, 2, std::to_string(test::free_port(line[0] == 't' ? SOCK_STREAM : SOCK_DGRAM)));
  const TemporaryFolder folder;
  if (device == "pty") device = folder / "imu";
  const FrameDescription frame = test::frame_with("laser_gyro", GetParam().keys);
  const bool asked = !frame.request.empty();
  Rig rig(default_rig_config());
  RigImu unit(rig);
  auto end = good(open_unit_end(device));
  FrameStreamer streamer(unit, frame, **end, GetParam().speedup);
  SerialImuSettings settings;
  settings.device = device;
  settings.simulated = true;
  settings.speedup = GetParam().speedup;
  SerialImu imu(frame, settings);
  RecordingInfo info;
  imu.describe(info);
  EXPECT_TRUE(info.simulated);
  EXPECT_FALSE((*end)->has_peer());
  ASSERT_OK(imu.open());
  for (const Deadline deadline(2.0); !(*end)->has_peer() && !deadline.passed();) ::usleep(1000);
  EXPECT_TRUE((*end)->has_peer());
  ASSERT_OK(streamer.start(monotonic_s()));
  const std::atomic<bool> stop = false;
  std::atomic<bool> ended = false;
  Status sent;
  std::thread sender([&] {
    sent = test::run(streamer, 0.5, stop);
    ended = true;
  });
  std::vector<ImuSample> received;
  std::array<ImuSample, 256> block;
  for (const Deadline deadline(10.0); !deadline.passed();) {
    const bool last = ended;
    const auto n = good(imu.read(block, 0.05));
    received.insert(received.end(), block.begin(), block.begin() + static_cast<std::ptrdiff_t>(*n));
    if (last && *n == 0) break;
  }
  sender.join();
  ASSERT_OK(sent);
  const double made_samples = 100.0 * GetParam().speedup;
  ASSERT_GT(static_cast<double>(received.size()),
            made_samples * (asked ? 0.2 : 0.6) / (GetParam().speedup > 1.0 ? 3.0 : 1.0));
  Rig same(default_rig_config());
  std::vector<ImuSample> made(static_cast<std::size_t>(received.back().counter) + 1);
  same.advance(made);
  for (const ImuSample& sample : received) {
    ASSERT_EQ(sample.gyro, made[static_cast<std::size_t>(sample.counter)].gyro) << sample.counter;
    ASSERT_EQ(sample.accel, made[static_cast<std::size_t>(sample.counter)].accel) << sample.counter;
    // The frame has 0.01 C.
    ASSERT_NEAR(sample.temperature_c, made[static_cast<std::size_t>(sample.counter)].temperature_c, 0.0051);
  }
  const auto span = static_cast<std::size_t>(received.back().counter - received.front().counter) + 1;
  EXPECT_TRUE(asked || received.size() == span) << "lost on the way";
  EXPECT_TRUE(asked || received.size() == streamer.frames_sent());
}

const std::vector<std::string> no_keys;
const std::vector<std::string> asked_keys = {"request = 05 4D", "request.period_s = 0.002"};
const std::vector<std::string> asked_totals = {"request = 05 4D", "request.period_s = 0.002", "gyro.kind = cumulative"};
INSTANTIATE_TEST_SUITE_P(
    All, TwinForms,
    testing::Values(Spoken{"pty_escape", "pty", {"stuffing = escape", "sync = 7E 90"}},
                    Spoken{"pty_slip", "pty", {"stuffing = slip", "sync = C0 01"}},
                    Spoken{"pty_repeat", "pty", {"stuffing = repeat", "stuffing.byte = 10", "sync = 10 02"}},
                    Spoken{"pty_cobs", "pty", {"stuffing = cobs", "sync = 00"}}, Spoken{"pty_asked", "pty", asked_keys},
                    Spoken{"pty_asked_totals", "pty", asked_totals},
                    Spoken{"pty_fifty_times_faster", "pty", no_keys, 50.0}, Spoken{"tcp", "tcp:127.0.0.1:%d", no_keys},
                    Spoken{"tcp_asked", "tcp:127.0.0.1:%d", asked_keys}, Spoken{"udp", "udp:%d", no_keys},
                    Spoken{"udp_cobs", "udp:127.0.0.1:%d", {"stuffing = cobs", "sync = 00"}},
                    Spoken{"udp_asked", "udp_to:127.0.0.1:%d", asked_keys}),
    [](const auto& form) { return std::string(form.param.name); });

}  // namespace
}  // namespace turncal
