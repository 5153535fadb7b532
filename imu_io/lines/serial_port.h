// A serial line: raw bytes, any baud rate, exclusive use by one process, and a deadline for every wait.
//
// The port is opened with O_NOCTTY | O_NONBLOCK | O_CLOEXEC and locked twice: flock() keeps out every other turncal, even root's,
// and TIOCEXCL keeps out other users' programs that do not use locks. termios2 with BOTHER sets any rate. The rate
// is read back and must be within 3 % (half a bit in the ten bits of a character is 5 %).
// Errors have kind device and name the device and the operation. After an unplugged port (hang-up, or end of
// file) read and write return an error; only close() is then useful. Use /dev/serial/by-id names:
// an adapter that is plugged in again may become ttyUSB1.
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

// Returns "/dev/ttyUSB0 115200 8N1".
std::string describe(const SerialSettings& settings);

// Error counts of the port's driver since it was loaded.
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

  // Opens the port and discards what it had received before.
  static Result<SerialPort> open(const SerialSettings& settings);
  bool is_open() const { return fd_ >= 0; }
  const std::string& device() const { return device_; }
  int descriptor() const { return fd_; }  // for poll()

  // Reads what has arrived, at most out.size() bytes. Waits at most timeout_s for the first byte; 0 if none came.
  Result<std::size_t> read(std::span<std::byte> out, double timeout_s);
  // Writes everything, or returns an error after timeout_s. It returns when the kernel has the bytes, not when they are sent.
  Status write_all(std::span<const std::byte> data, double timeout_s);
  Status write_all(std::string_view text, double timeout_s);
  // Discards received bytes that were not read.
  Status discard_input();
  // Empty if the port does not count errors (a pty does not).
  std::optional<LineErrors> line_errors() const;
  void close();

 private:
  Status configure(const SerialSettings& settings);

  Descriptor fd_;
  std::string device_;
};

// Returns advice for a device that could not be opened with this errno: "; its group may: sudo adduser "$USER" dialout, then log in
// again", or nothing.
std::string access_advice(const std::string& device, int number);

// Reads the keys of a serial line: PREFIX.baud, .data_bits, .parity, .stop_bits. A missing key leaves its setting unchanged.
// `serial`: the line is a serial one. On a network line these keys mean nothing and are rejected.
void read_serial_keys(KeyTable& keys, const std::string& prefix, SerialSettings& settings, bool serial = true);

}  // namespace turncal
