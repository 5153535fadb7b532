// A unit over TCP, over UDP, and one that answers requests: peers made of plain sockets and a pseudo-terminal.
#include <poll.h>

#include <thread>

#include "frame_streams.h"
#include "imu_io/base/clock.h"
#include "imu_io/lines/unit_end.h"
#include "imu_io/units/serial_imu.h"
#include "tests/imu_io/counting_source.h"
#include "tests/imu_io/loopback.h"

namespace turncal {
namespace {

using namespace test;  // NOLINT

std::vector<ImuSample> drained(SerialImu& imu, Status& status) {
  std::vector<ImuSample> samples;
  std::array<ImuSample, 64> block;
  for (;;) {
    const auto n = imu.read(block, 0.03);
    if (!n) return status = n.error(), samples;
    if (*n == 0) return samples;
    samples.insert(samples.end(), block.begin(), block.begin() + static_cast<std::ptrdiff_t>(*n));
  }
}

SerialImuSettings at(const std::string& device) {
  SerialImuSettings settings;
  settings.device = device;
  return settings;
}

TEST(NetworkImu, OverTcp) {
  const FrameDescription frame = frame_named("laser_gyro");
  Socket server(SOCK_STREAM);
  ASSERT_EQ(::listen(server.descriptor, 1), 0);
  const std::string device = "tcp:127.0.0.1:" + std::to_string(server.port);
  SerialImu imu(frame, at(device));
  ASSERT_OK(imu.open());
  int peer = ::accept(server.descriptor, nullptr, nullptr);
  ASSERT_GE(peer, 0);
  EXPECT_EQ(imu.identify()->description, "laser_gyro on " + device);
  const auto sent = pulse_samples(50);
  const Bytes bytes = encode_all(frame, sent);
  ASSERT_EQ(::send(peer, bytes.data(), bytes.size() - 10, 0), static_cast<ssize_t>(bytes.size() - 10));
  Status status;
  EXPECT_EQ(expect_only_sent(drained(imu, status), sent), 1U) << "the last one is not whole";
  ASSERT_OK(status);
  ::close(peer);
  EXPECT_TRUE(drained(imu, status).empty());
  ASSERT_TRUE(fails(status, ErrorKind::device));
  EXPECT_EQ(status.error().message, device + ": the other end hung up");
  // It comes back: the numbering goes on, after a gap.
  ASSERT_OK(imu.open());
  peer = ::accept(server.descriptor, nullptr, nullptr);
  const Bytes more = encode_all(frame, pulse_samples(5, 2, 60));
  ASSERT_EQ(::send(peer, more.data(), more.size(), 0), static_cast<ssize_t>(more.size()));
  status = {};
  EXPECT_EQ(drained(imu, status).size(), 5U);
  EXPECT_GT(imu.counters().lost_samples, 0U);
  ::close(peer);
  imu.close();
  server.close();
  ASSERT_TRUE(fails(imu.open(), ErrorKind::device, "cannot open"));
}

TEST(NetworkImu, OverUdp) {
  const FrameDescription frame = frame_named("laser_gyro");
  int port = 0;
  {
    const Socket free(SOCK_DGRAM);
    port = free.port;
  }
  const std::string device = "udp:127.0.0.1:" + std::to_string(port);
  SerialImu imu(frame, at(device));
  ASSERT_OK(imu.open());
  Socket unit(SOCK_DGRAM), stranger(SOCK_DGRAM);
  const sockaddr_in to = loopback(port);
  const auto send = [&](const Socket& from, std::span<const std::byte> bytes) {
    ASSERT_EQ(
        ::sendto(from.descriptor, bytes.data(), bytes.size(), 0, reinterpret_cast<const sockaddr*>(&to), sizeof to),
        static_cast<ssize_t>(bytes.size()));
  };
  const auto sent = pulse_samples(400);
  const Bytes bytes = encode_all(frame, sent);
  Status status;
  std::vector<ImuSample> got;
  // Datagrams of 1, 2, 3 frames and of one that holds 300; the third is lost, and a stranger talks in between.
  const std::size_t sizes[] = {1, 2, 3, 300, 94};
  std::size_t first = 0;
  for (const std::size_t frames : sizes) {
    const auto datagram = std::span(bytes).subspan(36 * first, 36 * frames);
    if (frames != 3) send(unit, datagram);
    send(stranger, encode_all(frame, pulse_samples(2, 9, 100000)));
    first += frames;
    ::usleep(static_cast<useconds_t>(5000 * frames));  // as long as the unit takes to make them
    const auto some = drained(imu, status);
    got.insert(got.end(), some.begin(), some.end());
  }
  ASSERT_OK(status);
  EXPECT_EQ(expect_only_sent(got, sent), 3U);
  EXPECT_EQ(imu.counters().lost_samples, 3U);
  // The port is held by one alone.
  SerialImu other(frame, at(device));
  const Status second = other.open();
  ASSERT_FALSE(second.ok());
  EXPECT_EQ(second.error().message, device + ": in use by another process");
  imu.close();
  ASSERT_OK(other.open());
}

TEST(NetworkImu, AUnitThatAnswersRequestsIsAskedAllTheWhile) {
  const TemporaryFolder folder;
  auto pty = good(Pty::create(folder / "imu"));
  const FrameDescription frame = frame_with("laser_gyro", {"request = 05 4D", "request.period_s = 0.002"});
  CountingSource source(frame);
  FrameStreamer streamer(source, frame, *pty, 1.0);
  SerialImu imu(frame, at(folder / "imu"));
  ASSERT_OK(streamer.start(monotonic_s()));
  std::atomic<bool> ended = false;
  std::thread unit([&] { EXPECT_TRUE(run(streamer, 60.0, ended).ok()); });
  ::usleep(50'000);
  EXPECT_EQ(streamer.frames_sent(), 0U) << "nobody asked";
  ASSERT_OK(imu.open());
  ::usleep(300'000);  // nobody reads, and yet it is asked: 60 samples
  Status status;
  std::vector<ImuSample> got;
  for (const double end_s = monotonic_s() + 1.0; monotonic_s() < end_s;) {
    std::array<ImuSample, 64> block;
    const auto n = good(imu.read(block, 0.02));
    got.insert(got.end(), block.begin(), block.begin() + static_cast<std::ptrdiff_t>(*n));
  }
  // Samples of the time when nobody read are there. How many the line loses is the machine's affair: a sanitized build on a busy one
  // answers late, and what was not asked for in time is counted as lost.
  ASSERT_FALSE(got.empty());
  const auto first = static_cast<std::size_t>(got.front().counter);
  const auto unread =
      std::ranges::count_if(got, [&](const ImuSample& s) { return static_cast<std::size_t>(s.counter) < first + 60; });
  EXPECT_GT(unread, 20) << "of the 60 that it had while nobody read";
  for (std::size_t i = 0; i < got.size(); ++i) {
    EXPECT_EQ(got[i].gyro[0], static_cast<double>(got[i].counter));
    EXPECT_TRUE(i == 0 || got[i].counter > got[i - 1].counter);
  }
  EXPECT_LE(static_cast<std::size_t>(got.back().counter) - first + 1, got.size() + imu.counters().lost_samples)
      << "each is there or counted";
  EXPECT_GT(imu.counters().duplicates, 0U) << "it is asked more often than it has samples";
  imu.close();
  ::usleep(20'000);
  const std::uint64_t sent = streamer.frames_sent();
  ::usleep(100'000);
  EXPECT_LE(streamer.frames_sent(), sent + 1) << "asked after it was closed";
  ended = true;
  unit.join();
}

}  // namespace
}  // namespace turncal
