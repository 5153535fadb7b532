// The line to a unit, whatever it is: a serial port, a TCP connection to a serial server or unit, or the datagrams of a unit on UDP.
//
//   /dev/serial/by-id/...            serial, with the settings of the frame description
//   tcp:HOST:PORT                    the station connects; a hang-up is an error of kind device
//   udp:PORT   udp:ADDRESS:PORT      the station listens, on all its addresses or on one; the first sender is listened to, no other
//   udp_to:HOST:PORT                 the station asks there (the frame's request), and hears nobody else
// A datagram holds whole frames or pieces of them, in order. What the network loses or turns round shows in the unit's counter, and
// in nothing else. Not modelled: multicast, IPv6 for UDP.
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
  std::string host;  // udp: empty for every address
  int port = 0;
  bool asks = false;  // udp_to
};
// Empty: a kind that is not known, or no port.
std::optional<LineAddress> parse_line(const std::string& device);

class ByteLine {
 public:
  static Result<ByteLine> open(const SerialSettings& settings);
  bool is_open() const { return port_.is_open() || socket_ >= 0; }
  // As SerialPort's.
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
  std::vector<std::byte> datagram_;  // the last one, as far as it was not handed out
  std::size_t given_ = 0;
  std::optional<sockaddr_in> sender_;
  bool asks_ = false;
};

// What stands for a line in messages: "/dev/ttyUSB0 115200 8N1", "tcp:192.168.1.5:4001".
std::string describe_line(const SerialSettings& settings);

// ---- what all lines share ----

// "DEVICE: WHAT: reason".
Error line_error(const std::string& device, const std::string& what, int number);

// "host:port" -> a socket that does not block, is closed on exec and sends at once. `given_up` is asked at least every 10 ms. Errors: kind
// input for an address of another form, aborted when given up, else device. A name instead of a number is looked up by the system
// first, which has its own deadlines: give numbers.
Result<int> connect_tcp(const std::string& address, double timeout_s, const std::function<bool()>& given_up = {});

// `device` begins the message.
using Addresses = std::unique_ptr<addrinfo, void (*)(addrinfo*)>;
Result<Addresses> look_up(const std::string& device, const std::string& host, const std::string& port, int family,
                          int socket_type);

// Calls receive(), which is a Result of how many bytes came, until some did; 0: none in time.
template <class Receive>
Result<std::size_t> read_until(const std::string& device, const Deadline& deadline, int descriptor, Receive receive) {
  for (;;) {
    const Result<std::size_t> n = receive();
    if (!n || *n > 0 || deadline.passed()) return n;
    if (wait_ready(descriptor, POLLIN, deadline.left_ms()) < 0 && errno != EINTR)
      return line_error(device, "cannot wait", errno);
  }
}

// Calls write(data) until all of it has gone: 0; not_in_time, and `data` is what is left; or the number of the error.
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
