// What lines over a network and serial lines share: addresses looked up, a TCP connection made with a deadline, bytes sent until a deadline.
#pragma once

#include <netdb.h>
#include <poll.h>

#include <cerrno>
#include <cstddef>
#include <functional>
#include <memory>
#include <span>
#include <string>

#include "calib/types/status.h"
#include "imu_io/base/clock.h"

namespace turncal {

// "host:port" -> a socket that does not block, is closed on exec and sends at once. `given_up` is asked at least every 10 ms. Errors: kind
// input for an address of another form, aborted when given up, else device. A name instead of a number is looked up by the system
// first, which has its own deadlines: give numbers.
Result<int> connect_tcp(const std::string& address, double timeout_s, const std::function<bool()>& given_up = {});

// `device` begins the message.
using Addresses = std::unique_ptr<addrinfo, void (*)(addrinfo*)>;
Result<Addresses> look_up(const std::string& device, const std::string& host, const std::string& port, int family,
                          int socket_type);

// Calls write(data) until all of it has gone: 0; not_in_time, and `data` is what is left; or the number of the error.
inline constexpr int not_in_time = -1;
template <class Write>
int write_until(const Deadline& deadline, int descriptor, std::span<const std::byte>& data, Write write) {
  while (!data.empty()) {
    const ssize_t n = write(data);
    if (n > 0) {
      data = data.subspan(static_cast<std::size_t>(n));
      continue;
    }
    if (n < 0 && errno != EAGAIN && errno != EINTR) return errno;
    if (deadline.passed()) return not_in_time;
    wait_ready(descriptor, POLLOUT, deadline.left_ms());
  }
  return 0;
}

}  // namespace turncal
