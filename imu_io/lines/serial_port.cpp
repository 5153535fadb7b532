#include "imu_io/lines/serial_port.h"

#include <fmt/format.h>
#include <grp.h>
#include <sys/stat.h>

#include <array>
#include <cerrno>

// <asm/termbits.h> defines termios2 and conflicts with <termios.h>.
#include <asm/termbits.h>
#include <fcntl.h>
#include <linux/serial.h>
#include <poll.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <cmath>

#include "imu_io/lines/byte_line.h"

namespace turncal {
namespace {

bool is_unplugged(int number) { return number == EIO || number == ENXIO || number == ENODEV; }

}  // namespace

std::string describe(const SerialSettings& settings) {
  const char parity = settings.parity == SerialParity::none ? 'N' : settings.parity == SerialParity::even ? 'E' : 'O';
  return fmt::format("{} {} {}{}{}", settings.device, settings.baud, settings.data_bits, parity, settings.stop_bits);
}

void SerialPort::close() {
  if (fd_ < 0) return;
  ::ioctl(fd_, TIOCNXCL);  // otherwise a descriptor open elsewhere would keep the port locked
  fd_ = Descriptor();
}

Result<SerialPort> SerialPort::open(const SerialSettings& settings) {
  SerialPort port;
  port.device_ = settings.device;
  do {
    port.fd_ = ::open(settings.device.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  } while (port.fd_ < 0 && errno == EINTR);
  if (port.fd_ < 0) {
    if (errno == EBUSY) return device_error(settings.device + ": in use by another program");
    const int number = errno;
    return device_error(line_error(port.device_, "cannot open", number).message +
                        access_advice(settings.device, number));
  }
  if (::flock(port.fd_, LOCK_EX | LOCK_NB) != 0) {
    const int number = errno;
    // Not close(): it would clear the owner's TIOCEXCL.
    port.fd_ = Descriptor();
    if (number == EWOULDBLOCK) return device_error(settings.device + ": in use by another process");
    return line_error(port.device_, "cannot lock", number);
  }
  TRY(port.configure(settings));
  TRY(port.discard_input());
  return port;
}

Status SerialPort::configure(const SerialSettings& settings) {
  struct termios2 line {};
  if (::ioctl(fd_, TCGETS2, &line) != 0) {
    if (errno == ENOTTY) return device_error(device_ + ": not a serial port");
    return line_error(device_, "cannot read the line settings", errno);
  }
  if (::ioctl(fd_, TIOCEXCL) != 0) return line_error(device_, "cannot get exclusive use", errno);
  line.c_iflag = IGNBRK;
  if (settings.parity != SerialParity::none) line.c_iflag |= INPCK;
  line.c_oflag = 0;
  line.c_lflag = 0;
  line.c_cflag = CREAD | CLOCAL | BOTHER | static_cast<tcflag_t>(settings.data_bits == 7 ? CS7 : CS8);
  if (settings.parity != SerialParity::none) line.c_cflag |= PARENB;
  if (settings.parity == SerialParity::odd) line.c_cflag |= PARODD;
  if (settings.stop_bits == 2) line.c_cflag |= CSTOPB;
  line.c_ispeed = settings.baud;
  line.c_ospeed = settings.baud;
  line.c_cc[VMIN] = 1;  // so that a read of 0 bytes means unplugged
  line.c_cc[VTIME] = 0;
  if (::ioctl(fd_, TCSETS2, &line) != 0) return line_error(device_, "cannot set " + describe(settings), errno);
  struct termios2 got {};
  if (::ioctl(fd_, TCGETS2, &got) != 0) return line_error(device_, "cannot read the line settings", errno);
  const double wanted = settings.baud;
  for (const std::uint32_t rate : {got.c_ispeed, got.c_ospeed})
    if (std::abs(rate - wanted) > 0.03 * wanted)
      return device_error(fmt::format("{}: asked for {} baud, the port runs at {}", device_, settings.baud, rate));
  return {};
}

Result<std::size_t> SerialPort::read(std::span<std::byte> out, double timeout_s) {
  if (fd_ < 0) return device_error(device_ + ": read while closed");
  if (out.empty()) return std::size_t{0};
  return read_until(device_, Deadline(timeout_s), fd_, [&]() -> Result<std::size_t> {
    const ssize_t n = ::read(fd_, out.data(), out.size());
    if (n > 0) return std::size_t(n);
    if (n == 0 || is_unplugged(errno)) return device_error(device_ + ": unplugged");
    if (errno != EINTR && errno != EAGAIN) return line_error(device_, "cannot read", errno);
    return std::size_t{0};
  });
}

Status SerialPort::write_all(std::span<const std::byte> data, double timeout_s) {
  if (fd_ < 0) return device_error(device_ + ": write while closed");
  const int number = write_until(Deadline(timeout_s), fd_, data, [&](std::span<const std::byte> left) {
    return ::write(fd_, left.data(), left.size());
  });
  if (is_unplugged(number)) return device_error(device_ + ": unplugged");
  if (number == not_in_time)
    return device_error(fmt::format("{}: {} bytes could not be sent in time", device_, data.size()));
  return number == 0 ? Status{} : line_error(device_, "cannot write", number);
}

Status SerialPort::write_all(std::string_view text, double timeout_s) {
  return write_all(std::as_bytes(std::span(text.data(), text.size())), timeout_s);
}

Status SerialPort::discard_input() {
  if (::ioctl(fd_, TCFLSH, TCIFLUSH) != 0) return line_error(device_, "cannot discard old input", errno);
  return {};
}

std::optional<LineErrors> SerialPort::line_errors() const {
  struct serial_icounter_struct counts {};
  if (fd_ < 0 || ::ioctl(fd_, TIOCGICOUNT, &counts) != 0) return {};
  const auto of = [](int n) { return std::uint64_t(std::uint32_t(n)); };
  return LineErrors{of(counts.overrun) + of(counts.buf_overrun), of(counts.frame), of(counts.parity)};
}

std::string access_advice(const std::string& device, int number) {
  constexpr mode_t read_and_write = S_IRGRP | S_IWGRP;
  struct stat facts {};
  if (number != EACCES || ::stat(device.c_str(), &facts) != 0 || (facts.st_mode & read_and_write) != read_and_write)
    return "";
  group entry{}, *found = nullptr;
  std::array<char, 4096> text{};
  if (::getgrgid_r(facts.st_gid, &entry, text.data(), text.size(), &found) != 0 || found == nullptr) return "";
  return "; its group may: sudo adduser \"$USER\" " + std::string(entry.gr_name) + ", then log in again";
}

void read_serial_keys(KeyTable& keys, const std::string& prefix, SerialSettings& settings, bool serial) {
  for (const char* const name : {".baud", ".data_bits", ".parity", ".stop_bits"})
    if (!serial && keys.file().has(prefix + name))
      keys.file().reject(prefix + name, "no such key unless the device is a serial line");
  keys.whole(prefix + ".baud", settings.baud, 50u, 20'000'000u);
  keys.whole(prefix + ".data_bits", settings.data_bits, 7, 8);
  keys.chosen(prefix + ".parity", settings.parity, {"none", "even", "odd"});
  keys.whole(prefix + ".stop_bits", settings.stop_bits, 1, 2);
}

}  // namespace turncal
