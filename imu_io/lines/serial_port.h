// A serial line: raw bytes, any baud rate, held by one process alone, every wait with a deadline.
//
// The port is opened with O_NOCTTY | O_NONBLOCK | O_CLOEXEC and locked twice: flock() keeps every other turncal out, root's
// too, and TIOCEXCL keeps out other users' programs that do not ask for locks. termios2 with BOTHER sets any rate; the rate
// is read back and must be within 3 % (half a bit in the ten of a character is 5 %).
// Errors have kind device and name the device and what was being done. A port that was unplugged (hang-up, or an end of the
// file) is an error of read and write; the port is then only good for close(). Use /dev/serial/by-id names:
// an adapter that comes back may have become ttyUSB1.
// Not modelled: hardware and software flow control (both off), break, modem lines (ignored: CLOCAL).
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "calib/types/status.h"
#include "imu_io/base/files.h"
#include "imu_io/base/key_value.h"

namespace turncal {

enum class SerialParity { none, even, odd };

struct SerialSettings {
  std::string device;
  std::uint32_t baud = 115200;
  int data_bits = 8;  // 7 or 8
  SerialParity parity = SerialParity::none;
  int stop_bits = 1;  // 1 or 2
};

// "/dev/ttyUSB0 115200 8N1"
std::string describe(const SerialSettings& settings);

// What the port's driver has counted since it was loaded.
struct LineErrors {
  std::uint64_t overrun = 0;
  std::uint64_t framing = 0;
  std::uint64_t parity = 0;
};

class SerialPort {
 public:
  SerialPort() = default;  // closed
  SerialPort(SerialPort&&) noexcept = default;
  SerialPort& operator=(SerialPort&&) noexcept = default;
  ~SerialPort() { close(); }

  // What the line held before opening is thrown away.
  static Result<SerialPort> open(const SerialSettings& settings);
  bool is_open() const { return fd_ >= 0; }
  const std::string& device() const { return device_; }
  int descriptor() const { return fd_; }  // for poll() beside others

  // What there is, at most out.size() bytes; waits for the first byte at most timeout_s. 0: nothing came.
  Result<std::size_t> read(std::span<std::byte> out, double timeout_s);
  // All of it, or an error after timeout_s. Returns when the kernel has the bytes, not when they are on the wire.
  Status write_all(std::span<const std::byte> data, double timeout_s);
  Status write_all(std::string_view text, double timeout_s);
  // Throws away what has arrived and was not read.
  Status discard_input();
  // Empty where the port does not count (a pty does not).
  std::optional<LineErrors> line_errors() const;
  void close();

 private:
  Status configure(const SerialSettings& settings);

  Descriptor fd_;
  std::string device_;
};

// What to do about a device that could not be opened.
// number: the errno. "; its group may: sudo adduser "$USER" dialout, then log in again" where that helps, else nothing.
std::string access_advice(const std::string& device, int number);

// The keys of a serial line in a configuration: PREFIX.baud, .data_bits, .parity, .stop_bits. What is not given stays as it is.
// `serial`: whether the line is one. Over a network none of these keys has a meaning, and each is refused.
void read_serial_keys(KeyTable& keys, const std::string& prefix, SerialSettings& settings, bool serial = true);

}  // namespace turncal
