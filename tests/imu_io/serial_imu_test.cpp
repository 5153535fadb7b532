// A unit on a pseudo-terminal: the whole path from the line to the samples, and the faults that only a line has.
#include "imu_io/units/serial_imu.h"

#include <time.h>
#include "tests/test.h"

#include <thread>

#include "frame_streams.h"
#include "imu_io/base/clock.h"
#include "imu_io/lines/unit_end.h"
#include "tests/imu_io/counting_source.h"
#include "tests/imu_io/loopback.h"
#include "tests/said.h"
#include "turntable_drivers/rig/rig.h"
#include "turntable_drivers/rig/rig_devices.h"

namespace turncal {
namespace {

using namespace test;  // NOLINT

struct SerialImuTest : testing::Test {
  TemporaryFolder folder;
  std::string link = folder / "imu";
  FrameDescription frame = frame_named("laser_gyro");
  Pty pty;
  SerialImuSettings settings;
  std::vector<ImuSample> samples;
  FrameEncoder encoder{frame};

  void SetUp() override {
    settings.device = link;
    settings.unit_serial = "RLG-1";
    plug();
  }
  void plug() {
    auto made = good(Pty::create(link));
    pty = std::move(*made);
  }
  void send(std::int64_t first, std::int64_t count) {
    for (std::int64_t i = first; i < first + count; ++i) send(CountingSource::sample(i));
  }
  void send(const ImuSample& sample) {
    Bytes bytes(encoder.length());
    ASSERT_OK(encoder.encode(sample, bytes));
    ASSERT_OK(pty.write_all(bytes, 1.0));
  }
  // Reads until nothing came for 30 ms.
  Status drain(SerialImu& imu) {
    std::array<ImuSample, 64> block;
    for (;;) {
      const auto n = imu.read(block, 0.03);
      if (!n) return n.error();
      if (*n == 0) return {};
      samples.insert(samples.end(), block.begin(), block.begin() + std::ptrdiff_t(*n));
    }
  }
  void expect_true_samples() const {
    for (const ImuSample& sample : samples) EXPECT_EQ(sample.gyro, CountingSource::sample(sample.counter).gyro);
  }
};

// Whoever reads has a stop to look for, which must go out within 0.1 s.
TEST_F(SerialImuTest, ASilentUnitDoesNotHoldItsReader) {
  SerialImu imu(frame, settings);
  ASSERT_OK(imu.open());
  std::array<ImuSample, 8> block;
  double shortest_s = 1e9;
  for (int i = 0; i < 3; ++i) {
    const double began = monotonic_s();
    const auto n = good(imu.read(block, 10.0));
    EXPECT_EQ(*n, 0U);
    shortest_s = std::min(shortest_s, monotonic_s() - began);
  }
  EXPECT_LT(shortest_s, 0.05);
}

TEST_F(SerialImuTest, AHangUpInMidFrameIsADeviceErrorAndTheCounterGoesOnAfterwards) {
  SerialImu imu(frame, settings);
  ASSERT_OK(imu.open());
  send(100, 20);
  ASSERT_OK(drain(imu));
  Bytes half(encoder.length());
  ASSERT_OK(encoder.encode(CountingSource::sample(120), half));
  ASSERT_OK(pty.write_all(std::span<const std::byte>(half).first(20), 1.0));
  std::array<ImuSample, 8> block;
  ASSERT_OK(imu.read(block, 0.01));
  pty.unplug();
  const auto n = imu.read(block, 1.0);
  ASSERT_TRUE(fails(n, ErrorKind::device));
  EXPECT_EQ(n.error().message, link + ": unplugged");
  EXPECT_EQ(imu.read(block, 0.1).error().message, link + ": read before open");
  EXPECT_ERROR(imu.open(), link + ": cannot open: No such file or directory");

  plug();
  ASSERT_OK(imu.open());
  // The second half of a frame, and then whole ones.
  ASSERT_OK(pty.write_all(std::span<const std::byte>(half).subspan(20), 1.0));
  send(150, 20);
  ASSERT_OK(drain(imu));
  ASSERT_EQ(samples.size(), 40U);
  EXPECT_EQ(samples[20].counter, 150);
  EXPECT_EQ(imu.counters().lost_samples, 30U);
  expect_true_samples();
}

TEST_F(SerialImuTest, AUnitThatWasSwitchedOffIsADeviceError) {
  SerialImu imu(frame, settings);
  ASSERT_OK(imu.open());
  send(50000, 20);
  ASSERT_OK(drain(imu));
  send(0, 20);
  const Status status = drain(imu);
  EXPECT_ERROR(status, link +
                           ": the unit's counter started again, or ran ahead of the time, after sample 50019: it was "
                           "switched off or reset, or samples were lost while its line was behind");
  ASSERT_TRUE(fails(status, ErrorKind::device));
  EXPECT_EQ(samples.size(), 20U);
  // Asked to go on, it does, after a gap as long as the time that has passed.
  const double before_s = monotonic_s();
  ASSERT_OK(imu.open());
  send(30, 20);
  ASSERT_OK(drain(imu));
  ASSERT_EQ(samples.size(), 40U);
  EXPECT_GT(samples[20].counter, 50020);
  EXPECT_LT(samples[20].counter, 50020 + std::int64_t((monotonic_s() - before_s + 1.0) / 0.005));
  EXPECT_EQ(samples[39].counter - samples[20].counter, 19);
}

TEST_F(SerialImuTest, WhatHadArrivedBeforeOpeningIsOld) {
  SerialImu imu(frame, settings);
  ASSERT_OK(imu.open());
  send(0, 10);
  imu.close();
  ASSERT_OK(imu.open());
  send(40, 10);
  ASSERT_OK(drain(imu));
  ASSERT_EQ(samples.size(), 10U);
  EXPECT_EQ(samples[0].counter, 40);
}

// A counter of 64 samples at 200 Hz wraps every 0.32 s: only the time tells more.
FrameDescription narrow_frame() { return frame_with("laser_gyro", {"counter.type = u8", "counter.modulus = 64"}); }

TEST_F(SerialImuTest, ASilenceOfMoreThanAWrapIsMeasured) {
  frame = narrow_frame();
  encoder = FrameEncoder(frame);
  SerialImu imu(frame, settings);
  ASSERT_OK(imu.open());
  send(0, 10);
  ASSERT_OK(drain(imu));
  const double silent_from_s = monotonic_s() - 0.03;  // drain() waited
  while (monotonic_s() - silent_from_s < 0.7) ASSERT_OK(drain(imu));
  auto missing = std::int64_t((monotonic_s() - silent_from_s) / 0.005);
  if ((10 + missing) % 64 == 0) ++missing;  // a counter that begins at 0 after a silence is a unit that was reset
  send(10 + missing, 3);                    // more at once no unit would have yet
  for (int i = 0; i < 6; ++i) ASSERT_OK(drain(imu));  // until the line has been quiet for 0.1 s
  ASSERT_EQ(samples.size(), 13U);
  EXPECT_EQ(samples[10].counter, 10 + missing);
  EXPECT_EQ(imu.counters().lost_samples, std::uint64_t(missing));
}

TEST_F(SerialImuTest, AReaderThatWasAwayForMoreThanAWrapLosesNothing) {
  frame = narrow_frame();
  encoder = FrameEncoder(frame);
  SerialImu imu(frame, settings);
  ASSERT_OK(imu.open());
  send(0, 10);
  ASSERT_OK(drain(imu));
  for (std::int64_t i = 10; i < 80; ++i) {  // 0.7 s of frames, unread: 2.5 kB, less than the kernel holds
    send(i, 1);
    const timespec pause{0, 10'000'000};
    ::nanosleep(&pause, nullptr);
  }
  ASSERT_OK(drain(imu));
  ASSERT_EQ(samples.size(), 80U);
  EXPECT_EQ(samples.back().counter, 79);
  EXPECT_EQ(imu.counters().lost_samples, 0U);
}

TEST_F(SerialImuTest, AWrongRateIsFoundOut) {
  // 100 Hz where the description says 200: after 10 s of the unit's own count, here sent with the clock of an arrival of its own.
  FrameDescription fast = frame;
  fast.sample_period_s = 0.5;  // says 2 Hz; frames come every 5 ms
  SerialImu imu(fast, settings);
  ASSERT_OK(imu.open());
  Status status;
  std::array<ImuSample, 8> block;
  for (std::int64_t i = 0; i < 60 && status.ok(); ++i) {
    send(i, 1);
    if (const auto n = imu.read(block, 0.05); !n) status = n.error();
  }
  ASSERT_TRUE(fails(status, ErrorKind::device, "the frame description says every 0.5 s"));
}

// A unit that is 500 ppm fast, and one that is 100 ppm fast: the limit is 200.
TEST(SerialImuClock, AClockBeyondItsLimitIsADeviceError) {
  for (const double ppm : {500.0, -500.0, 100.0}) {
    ArrivalFit fit;
    std::optional<Error> error;
    for (int i = 0; i < 60 * 200 && !error; ++i) {
      const double unit_s = 0.005 * i;
      fit.add(unit_s, unit_s * (1.0 - 1e-6 * ppm) + 1e-4 * (i % 7));
      if (const Status judged = judge_clock(fit, 200.0); !judged) error = judged.error();
    }
    EXPECT_EQ(error.has_value(), std::abs(ppm) > 200.0) << ppm;
    if (!error) continue;
    EXPECT_EQ(error->kind, ErrorKind::device);
    EXPECT_SAYS(error->message, "imu.clock_max_ppm = 200");
    EXPECT_SAYS(error->message, ppm > 0.0 ? "off by 50" : "off by -50");
  }
}

TEST_F(SerialImuTest, AStreamerRefusesASourceThatDoesNotFit) {
  CountingSource source(frame);
  FrameStreamer wrong(source, frame_named("stim300"), pty, 1.0);
  EXPECT_ERROR(wrong.start(0.0), "stim300: the frame's sample period of 0.002 s is not the source's");
}

// ---- twin imu ----

// The rig's unit as a unit on a line: what the receiver gets is what the rig made.

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
    received.insert(received.end(), block.begin(), block.begin() + std::ptrdiff_t(*n));
    if (last && *n == 0) break;
  }
  sender.join();
  ASSERT_OK(sent);
  const double made_samples = 100.0 * GetParam().speedup;
  ASSERT_GT(double(received.size()), made_samples * (asked ? 0.2 : 0.6) / (GetParam().speedup > 1.0 ? 3.0 : 1.0));
  Rig same(default_rig_config());
  std::vector<ImuSample> made(std::size_t(received.back().counter) + 1);
  same.advance(made);
  for (const ImuSample& sample : received) {
    ASSERT_EQ(sample.gyro, made[std::size_t(sample.counter)].gyro) << sample.counter;
    ASSERT_EQ(sample.accel, made[std::size_t(sample.counter)].accel) << sample.counter;
    // The frame has 0.01 C.
    ASSERT_NEAR(sample.temperature_c, made[std::size_t(sample.counter)].temperature_c, 0.0051);
  }
  const auto span = std::size_t(received.back().counter - received.front().counter) + 1;
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

// ---- its keys ----

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
