#include "imu_io/lines/serial_port.h"

#include <sys/ioctl.h>
#include "tests/test.h"

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

SerialSettings on(const Pty& pty, std::uint32_t baud = 115200) {
  SerialSettings settings{.device = pty.device(), .baud = baud};
  return settings;
}

std::string read_text(SerialPort& port, double timeout_s = 0.5) {
  std::array<std::byte, 64> bytes;
  const auto n = port.read(bytes, timeout_s);
  EXPECT_OK(n);
  return n ? std::string(reinterpret_cast<const char*>(bytes.data()), *n) : "";
}

TEST(SerialPort, WhoMayNotOpenItIsToldWhichGroupMay) {
  const TemporaryFolder folder;
  const std::string device = folder / "tty";
  std::ofstream(device) << "";
  std::filesystem::permissions(device, std::filesystem::perms(0660));
  const std::string advice = access_advice(device, EACCES);
  EXPECT_TRUE(advice.starts_with("; its group may: sudo adduser \"$USER\" ")) << advice;
  EXPECT_TRUE(advice.ends_with(", then log in again")) << advice;
  EXPECT_EQ(access_advice(device, ENOENT), "");
  std::filesystem::permissions(device, std::filesystem::perms(0600));
  EXPECT_EQ(access_advice(device, EACCES), "") << "a group that may not either";
  EXPECT_EQ(access_advice(device + "none", EACCES), "");
}

TEST(SerialPort, CarriesEveryByteUnchanged) {
  auto pty = good(Pty::create());
  for (const std::uint32_t baud : {9600U, 921600U, 1843200U, 123457U}) EXPECT_OK(SerialPort::open(on(*pty, baud)));
  auto port = good(SerialPort::open(on(*pty, 230400)));
  EXPECT_FALSE(port->line_errors().has_value());  // a pty does not count
  std::string all;
  for (int i = 0; i < 256; ++i) all += char(i);
  ASSERT_TRUE(pty->write_all(all, 1.0).ok());
  std::string got;
  for (int i = 0; i < 100 && got.size() < all.size(); ++i) got += read_text(*port);
  EXPECT_EQ(got, all);
  ASSERT_TRUE(port->write_all(all, 1.0).ok());
  got.clear();
  std::array<std::byte, 64> bytes;
  for (int i = 0; i < 100 && got.size() < all.size(); ++i) {
    const auto n = good(pty->read(bytes, 0.5));
    got.append(reinterpret_cast<const char*>(bytes.data()), *n);
  }
  EXPECT_EQ(got, all);
}

TEST(SerialPort, NamesTheDeviceThatIsMissingForbiddenOrNoSerialPort) {
  SerialSettings settings;
  settings.device = "/dev/serial/by-id/not-there";
  auto port = SerialPort::open(settings);
  ASSERT_TRUE(fails(port, ErrorKind::device));
  EXPECT_EQ(port.error().message, "/dev/serial/by-id/not-there: cannot open: No such file or directory");
  settings.device = "/dev/null";
  port = SerialPort::open(settings);
  ASSERT_FALSE(port.ok());
  EXPECT_EQ(port.error().message, "/dev/null: not a serial port");
}

TEST(SerialPort, IsHeldByOneAlone) {
  auto pty = good(Pty::create());
  {
    auto first = good(SerialPort::open(on(*pty)));
    for (int i = 0; i < 2; ++i) {  // the first refusal must not open the door
      auto second = SerialPort::open(on(*pty));
      ASSERT_TRUE(fails(second, ErrorKind::device, "in use by another"));
    }
    int exclusive = 0;
    ASSERT_EQ(::ioctl(first->descriptor(), TIOCGEXCL, &exclusive), 0);
    EXPECT_EQ(exclusive, 1);
  }
  EXPECT_TRUE(SerialPort::open(on(*pty)).ok());
}

TEST(SerialPort, WaitsNoLongerThanItWasTold) {
  auto pty = good(Pty::create());
  auto port = good(SerialPort::open(on(*pty)));
  const double began = monotonic_s();
  EXPECT_EQ(read_text(*port, 0.05), "");
  const double took = monotonic_s() - began;
  EXPECT_GE(took, 0.05);
  EXPECT_LT(took, 0.5);
  // Nobody reads on the other side: the kernel's buffers fill up.
  const std::string much(1 << 20, 'x');
  ASSERT_TRUE(fails(port->write_all(much, 0.05), "could not be sent in time"));
}

TEST(SerialPort, SeesTheHangUpWhileItWaits) {
  auto pty = good(Pty::create());
  auto port = good(SerialPort::open(on(*pty)));
  std::thread puller([&] {
    ::usleep(30000);
    pty->unplug();
  });
  std::array<std::byte, 16> bytes;
  const double began = monotonic_s();
  const auto n = port->read(bytes, 5.0);
  puller.join();
  EXPECT_LT(monotonic_s() - began, 2.0);
  ASSERT_TRUE(fails(n, ErrorKind::device, "unplugged"));
  ASSERT_TRUE(fails(port->write_all("x", 0.1), "unplugged"));
}

TEST(Pty, WhatIsSentToNobodyIsLost) {
  auto pty = good(Pty::create());
  EXPECT_FALSE(pty->has_peer());
  ASSERT_TRUE(pty->write_all(std::string(1 << 20, 'x'), 0.0).ok());
  auto port = good(SerialPort::open(on(*pty)));
  EXPECT_TRUE(pty->has_peer());
  EXPECT_EQ(read_text(*port, 0.05), "");
}

// ---- network imu ----

// A unit over TCP, over UDP, and one that answers requests: peers made of plain sockets and a pseudo-terminal.

using namespace test;  // NOLINT

std::vector<ImuSample> drained(SerialImu& imu, Status& status) {
  std::vector<ImuSample> samples;
  std::array<ImuSample, 64> block;
  for (;;) {
    const auto n = imu.read(block, 0.03);
    if (!n) return status = n.error(), samples;
    if (*n == 0) return samples;
    samples.insert(samples.end(), block.begin(), block.begin() + std::ptrdiff_t(*n));
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
    got.insert(got.end(), block.begin(), block.begin() + std::ptrdiff_t(*n));
  }
  // Samples of the time when nobody read are there. How many the line loses is the machine's affair: a sanitized build on a busy one
  // answers late, and what was not asked for in time is counted as lost.
  ASSERT_FALSE(got.empty());
  const auto first = std::size_t(got.front().counter);
  const auto unread =
      std::ranges::count_if(got, [&](const ImuSample& s) { return std::size_t(s.counter) < first + 60; });
  EXPECT_GT(unread, 20) << "of the 60 that it had while nobody read";
  for (std::size_t i = 0; i < got.size(); ++i) {
    EXPECT_EQ(got[i].gyro[0], double(got[i].counter));
    EXPECT_TRUE(i == 0 || got[i].counter > got[i - 1].counter);
  }
  EXPECT_LE(std::size_t(got.back().counter) - first + 1, got.size() + imu.counters().lost_samples)
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
