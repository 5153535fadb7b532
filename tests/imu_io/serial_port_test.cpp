#include "imu_io/lines/serial_port.h"

#include <sys/ioctl.h>
#include "tests/test.h"

#include <thread>

#include "imu_io/base/clock.h"
#include "imu_io/lines/unit_end.h"

namespace turncal {
namespace {

SerialSettings on(const Pty& pty, std::uint32_t baud = 115200) {
  SerialSettings settings;
  settings.device = pty.device();
  settings.baud = baud;
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
  auto port = good(SerialPort::open(on(*pty, 230400)));
  std::string all;
  for (int i = 0; i < 256; ++i) all += static_cast<char>(i);
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

TEST(SerialPort, TakesAnyRate) {
  auto pty = good(Pty::create());
  for (const std::uint32_t baud : {9600U, 230400U, 921600U, 1843200U, 123457U})
    auto port = good(SerialPort::open(on(*pty, baud)));
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

TEST(SerialPort, ComesBackUnderTheSameName) {
  const TemporaryFolder folder;
  const std::string link = folder.path() + "/port";
  auto pty = good(Pty::create(link));
  SerialSettings settings;
  settings.device = link;
  auto port = good(SerialPort::open(settings));
  pty->unplug();
  EXPECT_FALSE(SerialPort::open(settings).ok());
  pty = Pty::create(link);
  ASSERT_TRUE(pty.ok());
  port = SerialPort::open(settings);
  ASSERT_OK(port);
  ASSERT_TRUE(pty->write_all("back", 1.0).ok());
  EXPECT_EQ(read_text(*port), "back");
  EXPECT_FALSE(port->line_errors().has_value());  // a pty does not count
}

TEST(Pty, WhatIsSentToNobodyIsLost) {
  auto pty = good(Pty::create());
  EXPECT_FALSE(pty->has_peer());
  ASSERT_TRUE(pty->write_all(std::string(1 << 20, 'x'), 0.0).ok());
  auto port = good(SerialPort::open(on(*pty)));
  EXPECT_TRUE(pty->has_peer());
  EXPECT_EQ(read_text(*port, 0.05), "");
}

}  // namespace
}  // namespace turncal
