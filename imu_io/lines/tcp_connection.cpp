#include "imu_io/lines/tcp_connection.h"

#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>

namespace turncal {
namespace {

constexpr int longest_wait_ms = 10;

// 0, or the number of the error; ECANCELED when given up.
int connected(int descriptor, const addrinfo& to, const Deadline& deadline, const std::function<bool()>& given_up) {
  if (::connect(descriptor, to.ai_addr, to.ai_addrlen) == 0) return 0;
  if (errno != EINPROGRESS) return errno;
  while (wait_ready(descriptor, POLLOUT, std::min(deadline.left_ms(), longest_wait_ms)) <= 0) {
    if (given_up && given_up()) return ECANCELED;
    if (deadline.passed()) return ETIMEDOUT;
  }
  int result = 0;
  socklen_t length = sizeof result;
  ::getsockopt(descriptor, SOL_SOCKET, SO_ERROR, &result, &length);
  return result;
}

}  // namespace

Result<Addresses> look_up(const std::string& device, const std::string& host, const std::string& port, int family,
                          int socket_type) {
  addrinfo wanted{}, *found = nullptr;
  wanted.ai_family = family;
  wanted.ai_socktype = socket_type;
  const int error = ::getaddrinfo(host.c_str(), port.c_str(), &wanted, &found);
  if (error != 0) return device_error(device + ": cannot open: " + ::gai_strerror(error));
  return Addresses(found, ::freeaddrinfo);
}

Result<int> connect_tcp(const std::string& address, double timeout_s, const std::function<bool()>& given_up) {
  const std::size_t colon = address.rfind(':');
  if (colon == std::string::npos || colon == 0 || colon + 1 == address.size())
    return input_error("link.address = '" + address + "': expected host:port");
  const Addresses found =
      TRY(look_up(address, address.substr(0, colon), address.substr(colon + 1), AF_UNSPEC, SOCK_STREAM));
  const Deadline deadline(timeout_s);
  int descriptor = -1, result = EADDRNOTAVAIL;
  for (const addrinfo* to = found.get(); to != nullptr && descriptor < 0 && result != ECANCELED; to = to->ai_next) {
    descriptor = ::socket(to->ai_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    result = descriptor < 0 ? errno : connected(descriptor, *to, deadline, given_up);
    if (result == 0 || descriptor < 0) continue;
    ::close(descriptor);
    descriptor = -1;
  }
  if (result == ECANCELED) return Error{ErrorKind::aborted, address + ": given up for a stop"};
  if (descriptor < 0) return device_error(address + ": cannot open: " + std::strerror(result));
  const int on = 1;
  ::setsockopt(descriptor, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
  return descriptor;
}

}  // namespace turncal
