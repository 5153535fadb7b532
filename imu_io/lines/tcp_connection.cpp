#include "imu_io/lines/tcp_connection.h"

#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "imu_io/base/clock.h"

namespace turncal {
namespace {

constexpr int longest_wait_ms = 10;

// 0, or the number of the error; ECANCELED when given up.
int connected(int descriptor, const addrinfo& to, const Deadline& deadline, const std::function<bool()>& given_up) {
  if (::connect(descriptor, to.ai_addr, to.ai_addrlen) == 0) return 0;
  if (errno != EINPROGRESS) return errno;
  pollfd which{descriptor, POLLOUT, 0};
  while (::poll(&which, 1, std::min(deadline.left_ms(), longest_wait_ms)) <= 0) {
    if (given_up && given_up()) return ECANCELED;
    if (deadline.passed()) return ETIMEDOUT;
  }
  int result = 0;
  socklen_t length = sizeof result;
  ::getsockopt(descriptor, SOL_SOCKET, SO_ERROR, &result, &length);
  return result;
}

}  // namespace

Result<int> connect_tcp(const std::string& address, double timeout_s, const std::function<bool()>& given_up) {
  const std::size_t colon = address.rfind(':');
  if (colon == std::string::npos || colon == 0 || colon + 1 == address.size()) {
    return input_error("link.address = '" + address + "': expected host:port");
  }
  const auto failure = [&](const std::string& why) { return device_error(address + ": cannot open: " + why); };
  addrinfo hints{}, *found = nullptr;
  hints.ai_socktype = SOCK_STREAM;
  const int looked_up =
      ::getaddrinfo(address.substr(0, colon).c_str(), address.substr(colon + 1).c_str(), &hints, &found);
  if (looked_up != 0) return failure(::gai_strerror(looked_up));
  const Deadline deadline(timeout_s);
  int descriptor = -1, result = EADDRNOTAVAIL;
  for (const addrinfo* to = found; to != nullptr && descriptor < 0 && result != ECANCELED; to = to->ai_next) {
    descriptor = ::socket(to->ai_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    result = descriptor < 0 ? errno : connected(descriptor, *to, deadline, given_up);
    if (result == 0 || descriptor < 0) continue;
    ::close(descriptor);
    descriptor = -1;
  }
  ::freeaddrinfo(found);
  if (result == ECANCELED) return Error{ErrorKind::aborted, address + ": given up for a stop"};
  if (descriptor < 0) return failure(std::strerror(result));
  const int on = 1;
  ::setsockopt(descriptor, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
  return descriptor;
}

}  // namespace turncal
