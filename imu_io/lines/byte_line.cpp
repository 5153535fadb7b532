#include "imu_io/lines/byte_line.h"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>

#include "imu_io/base/text.h"

namespace turncal {
namespace {

constexpr int longest_wait_ms = 10;

// Returns 0 or an errno; ECANCELED when given up.
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

constexpr double connect_timeout_s = 2.0;
constexpr std::size_t longest_datagram = 65536;
constexpr int receive_buffer = 1 << 20;  // seconds of a unit's samples

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
  const auto found = TRY(look_up(address, address.substr(0, colon), address.substr(colon + 1), AF_UNSPEC, SOCK_STREAM));
  const Deadline deadline(timeout_s);
  int result = EADDRNOTAVAIL;
  for (const addrinfo* to = found.get(); to != nullptr && result != ECANCELED; to = to->ai_next) {
    Descriptor descriptor = ::socket(to->ai_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    result = descriptor < 0 ? errno : connected(descriptor, *to, deadline, given_up);
    if (result != 0) continue;
    const int on = 1;
    ::setsockopt(descriptor, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    return descriptor.release();
  }
  if (result == ECANCELED) return Error{ErrorKind::aborted, address + ": given up for a stop"};
  return line_error(address, "cannot open", result);
}

// ---- the line to a unit ----

std::optional<LineAddress> parse_line(const std::string& device) {
  LineAddress address;
  address.asks = device.starts_with("udp_to:");
  if (!device.starts_with("tcp:") && !device.starts_with("udp:") && !address.asks) {
    const std::size_t colon = device.find(':');
    const bool another_kind = colon != std::string::npos && device.find('/') > colon;
    return another_kind || device.empty() ? std::nullopt : std::optional(address);
  }
  address.kind = device[0] == 't' ? LineKind::tcp : LineKind::udp;
  const std::string remaining = device.substr(device.find(':') + 1);
  const std::size_t colon = remaining.rfind(':');
  address.host = colon == std::string::npos ? "" : remaining.substr(0, colon);
  const std::optional<int> port =
      parse_integer<int>(std::string_view(remaining).substr(colon == std::string::npos ? 0 : colon + 1));
  in_addr numbers{};
  const bool host_good = address.kind == LineKind::tcp || address.asks
                             ? !address.host.empty()
                             : colon == std::string::npos || ::inet_pton(AF_INET, address.host.c_str(), &numbers) == 1;
  if (!port || *port < 1 || *port > 65535 || !host_good) return {};
  address.port = *port;
  return address;
}

std::string describe_line(const SerialSettings& settings) {
  const auto address = parse_line(settings.device);
  return address && address->kind != LineKind::serial ? settings.device : describe(settings);
}

void ByteLine::close() {
  port_.close();
  socket_ = Descriptor();
  datagram_.clear();
  given_ = 0;
  sender_.reset();
}

Error line_error(const std::string& device, const std::string& what, int number) {
  return device_error(device + ": " + what + ": " + std::strerror(number));
}

Result<ByteLine> ByteLine::open(const SerialSettings& settings) {
  const auto address = parse_line(settings.device);
  if (!address)
    return input_error(settings.device +
                       ": expected a serial device, tcp:HOST:PORT, udp:[ADDRESS:]PORT or udp_to:HOST:PORT");
  ByteLine line;
  line.device_ = settings.device;
  line.kind_ = address->kind;
  switch (address->kind) {
    case LineKind::serial: line.port_ = TRY(SerialPort::open(settings)); break;
    case LineKind::tcp: line.socket_ = TRY(connect_tcp(settings.device.substr(4), connect_timeout_s)); break;
    case LineKind::udp: TRY(line.open_udp(*address)); break;
  }
  line.asks_ = address->asks;
  return line;
}

Status ByteLine::open_udp(const LineAddress& address) {
  socket_ = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (socket_ < 0) return line_error(device_, "cannot open", errno);
  ::setsockopt(socket_, SOL_SOCKET, SO_RCVBUF, &receive_buffer, sizeof receive_buffer);
  if (address.asks) {  // connected: the kernel drops datagrams from anybody else
    const Addresses found = TRY(look_up(device_, address.host, std::to_string(address.port), AF_INET, SOCK_DGRAM));
    return ::connect(socket_, found->ai_addr, found->ai_addrlen) == 0 ? Status()
                                                                      : line_error(device_, "cannot open", errno);
  }
  sockaddr_in here{};
  here.sin_family = AF_INET;
  here.sin_port = htons(std::uint16_t(address.port));
  if (!address.host.empty()) ::inet_pton(AF_INET, address.host.c_str(), &here.sin_addr);
  if (::bind(socket_, reinterpret_cast<const sockaddr*>(&here), sizeof here) == 0) return {};
  return errno == EADDRINUSE ? device_error(device_ + ": in use by another process")
                             : line_error(device_, "cannot listen", errno);
}

// Returns an empty result when nothing has arrived.
Result<std::size_t> ByteLine::receive(std::span<std::byte> out) {
  if (kind_ == LineKind::tcp) {
    const ssize_t n = ::recv(socket_, out.data(), out.size(), 0);
    if (n == 0) return device_error(device_ + ": the other end hung up");
    if (n > 0) return std::size_t(n);
    if (errno == EAGAIN || errno == EINTR) return std::size_t{0};
    return line_error(device_, "cannot read", errno);
  }
  if (given_ == datagram_.size()) {
    sockaddr_in from{};
    socklen_t length = sizeof from;
    datagram_.resize(longest_datagram);
    given_ = 0;
    const ssize_t n =
        ::recvfrom(socket_, datagram_.data(), datagram_.size(), 0, reinterpret_cast<sockaddr*>(&from), &length);
    const int number = errno;
    if (n > 0 && !sender_) sender_ = from;
    const bool ours = n > 0 && from.sin_addr.s_addr == sender_->sin_addr.s_addr && from.sin_port == sender_->sin_port;
    datagram_.resize(ours ? std::size_t(n) : 0);
    // ECONNREFUSED means that nobody is there yet or any more: the line is silent.
    if (n < 0 && number != EAGAIN && number != EINTR && number != ECONNREFUSED)
      return line_error(device_, "cannot read", number);
  }
  const std::size_t n = std::min(out.size(), datagram_.size() - given_);
  std::copy_n(datagram_.begin() + std::ptrdiff_t(given_), n, out.begin());
  given_ += n;
  return n;
}

Result<std::size_t> ByteLine::read(std::span<std::byte> out, double timeout_s) {
  if (kind_ == LineKind::serial) return port_.read(out, timeout_s);
  if (socket_ < 0) return device_error(device_ + ": read while closed");
  return read_until(device_, Deadline(timeout_s), socket_, [&] { return receive(out); });
}

Status ByteLine::write_all(std::span<const std::byte> data, double timeout_s) {
  if (kind_ == LineKind::serial) return port_.write_all(data, timeout_s);
  if (kind_ == LineKind::udp && !asks_) return device_error(device_ + ": nothing is sent over this line");
  if (kind_ == LineKind::udp) {  // sent as a whole or not at all; a lost request is repeated
    const ssize_t n = ::send(socket_, data.data(), data.size(), MSG_NOSIGNAL);
    return n >= 0 || errno == ECONNREFUSED || errno == EAGAIN ? Status{}
                                                              : Status(line_error(device_, "cannot write", errno));
  }
  const int number = write_until(Deadline(timeout_s), socket_, data, [&](std::span<const std::byte> left) {
    return ::send(socket_, left.data(), left.size(), MSG_NOSIGNAL);
  });
  if (number == not_in_time)
    return device_error(fmt::format("{}: {} bytes could not be sent in time", device_, data.size()));
  return number == 0 ? Status{} : line_error(device_, "cannot write", number);
}

}  // namespace turncal
