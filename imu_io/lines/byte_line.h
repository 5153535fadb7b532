// The line to a unit: a serial port, a TCP connection to a serial server or to the unit, or UDP datagrams from the unit.
//
//   /dev/serial/by-id/...            serial, with the settings of the frame description
//   tcp:HOST:PORT                    the station connects; a hang-up by the peer is an error of kind device
//   udp:PORT   udp:ADDRESS:PORT      the station listens on all its addresses or on one, and accepts only the first sender
//   udp_to:HOST:PORT                 the station sends the frame's request there, and accepts only that sender
// A datagram holds whole frames or parts of them, in order. Datagrams that the network loses or reorders show only in the unit's
// counter. Not modelled: multicast, IPv6 for UDP.
#pragma once

#include <netdb.h>
#include <netinet/in.h>
#include <poll.h>

#include <cerrno>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "imu_io/base/clock.h"
#include "imu_io/base/files.h"
#include "imu_io/lines/serial_port.h"

namespace turncal {

enum class LineKind { serial, tcp, udp };

struct LineAddress {
  LineKind kind = LineKind::serial;
  std::string host;  // udp: empty for all addresses
  int port = 0;
  bool asks = false;  // udp_to
};
// Parses a device name; empty if the kind is unknown or the port is missing.
std::optional<LineAddress> parse_line(const std::string& device);

class ByteLine {
 public:
  static Result<ByteLine> open(const SerialSettings& settings);
  bool is_open() const { return port_.is_open() || socket_ >= 0; }
  // read() and write_all() behave as in SerialPort.
  Result<std::size_t> read(std::span<std::byte> out, double timeout_s);
  Status write_all(std::span<const std::byte> data, double timeout_s);
  std::optional<LineErrors> line_errors() const { return port_.line_errors(); }
  void close();

 private:
  Status open_udp(const LineAddress& address);
  Result<std::size_t> receive(std::span<std::byte> out);

  std::string device_;
  LineKind kind_ = LineKind::serial;
  SerialPort port_;
  Descriptor socket_;
  std::vector<std::byte> datagram_;  // the rest of the last one that was not handed out yet
  std::size_t given_ = 0;
  std::optional<sockaddr_in> sender_;
  bool asks_ = false;
};

// Returns the name of a line for messages: "/dev/ttyUSB0 115200 8N1", "tcp:192.168.1.5:4001".
std::string describe_line(const SerialSettings& settings);

// ---- common to all lines ----

// Returns the error "DEVICE: WHAT: reason".
Error line_error(const std::string& device, const std::string& what, int number);

// Connects to "host:port" and returns a non-blocking, close-on-exec socket with TCP_NODELAY. `given_up` is asked at least every 10 ms.
// Errors: kind input for an address of another form, aborted when given up, else device. A host name is resolved by the system first, with
// time limits of its own; prefer numeric addresses.
Result<int> connect_tcp(const std::string& address, double timeout_s, const std::function<bool()>& given_up = {});

// Resolves a host and port. `device` begins the error message.
using Addresses = std::unique_ptr<addrinfo, void (*)(addrinfo*)>;
Result<Addresses> look_up(const std::string& device, const std::string& host, const std::string& port, int family,
                          int socket_type);

// Calls receive(), which returns a Result with the number of bytes, until there are some; 0 on timeout.
template <class Receive>
Result<std::size_t> read_until(const std::string& device, const Deadline& deadline, int descriptor, Receive receive) {
  for (;;) {
    const Result<std::size_t> n = receive();
    if (!n || *n > 0 || deadline.passed()) return n;
    if (wait_ready(descriptor, POLLIN, deadline.left_ms()) < 0 && errno != EINTR)
      return line_error(device, "cannot wait", errno);
  }
}

// Calls write(data) until all of it is sent. Returns 0, an errno, or not_in_time; `data` is then what is left.
inline constexpr int not_in_time = -1;
template <class Write>
int write_until(const Deadline& deadline, int descriptor, std::span<const std::byte>& data, Write write) {
  while (!data.empty()) {
    const ssize_t n = write(data);
    if (n > 0) {
      data = data.subspan(std::size_t(n));
      continue;
    }
    if (n < 0 && errno != EAGAIN && errno != EINTR) return errno;
    if (deadline.passed()) return not_in_time;
    wait_ready(descriptor, POLLOUT, deadline.left_ms());
  }
  return 0;
}

}  // namespace turncal
