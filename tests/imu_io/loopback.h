// For tests: sockets of ours on this machine.
#pragma once

#include <netinet/in.h>
#include <sys/socket.h>
#include "tests/test.h"

namespace turncal::test {

inline sockaddr_in loopback(int port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(std::uint16_t(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  return address;
}

// Bound to a free port; closed with this object.
struct Socket {
  explicit Socket(int type) : descriptor(::socket(AF_INET, type | SOCK_CLOEXEC, 0)) {
    sockaddr_in here = loopback(0);
    socklen_t length = sizeof here;
    EXPECT_EQ(::bind(descriptor, reinterpret_cast<sockaddr*>(&here), length), 0);
    EXPECT_EQ(::getsockname(descriptor, reinterpret_cast<sockaddr*>(&here), &length), 0);
    port = ntohs(here.sin_port);
  }
  ~Socket() { close(); }
  void close() {
    if (descriptor >= 0) ::close(descriptor);
    descriptor = -1;
  }
  int descriptor;
  int port = 0;
};

inline int free_port(int type) { return Socket(type).port; }

}  // namespace turncal::test
