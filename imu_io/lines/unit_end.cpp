#include "imu_io/lines/unit_end.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <termios.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <optional>

#include "imu_io/base/clock.h"
#include "imu_io/lines/byte_line.h"

namespace turncal {
namespace {

const std::string pseudo_terminal = "pseudo-terminal";

constexpr std::size_t datagram_bytes = 1400;  // no network fragments it; a frame may be split between two datagrams

class NetworkEnd : public UnitEnd {
 public:
  NetworkEnd(std::string device, const LineAddress& address) : device_(std::move(device)), address_(address) {}

  Status open() {
    const int type = is_tcp() ? SOCK_STREAM : SOCK_DGRAM;
    const std::string host = address_.host.empty() ? "127.0.0.1" : address_.host;
    const Addresses found = TRY(look_up(device_, host, std::to_string(address_.port), AF_INET, type));
    socket_ = ::socket(AF_INET, type | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    const int yes = 1;
    const bool sends = !is_tcp() && !address_.asks;
    if (socket_ < 0 || ::setsockopt(socket_, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes) != 0 ||
        (sends ? ::connect(socket_, found->ai_addr, found->ai_addrlen)
               : ::bind(socket_, found->ai_addr, found->ai_addrlen)) != 0 ||
        (is_tcp() && ::listen(socket_, 1) != 0))
      return line_error(device_, "cannot open", errno);
    return {};
  }

  const std::string& device() const override { return device_; }
  bool is_open() const override { return socket_ >= 0; }
  void unplug() override {
    socket_ = Descriptor();
    station_ = Descriptor();
  }

  bool has_peer() const override {
    std::byte any{};
    if (is_tcp()) return station_ >= 0 || wait_ready(socket_, POLLIN, 0) > 0;
    if (address_.asks) return asker_ || ::recv(socket_, &any, 1, MSG_PEEK) >= 0;
    // A datagram to an unused port of this machine is refused at once.
    int refused = 0;
    socklen_t size = sizeof refused;
    ::getsockopt(socket_, SOL_SOCKET, SO_ERROR, &refused, &size);
    static_cast<void>(::send(socket_, nullptr, 0, MSG_NOSIGNAL));
    return ::getsockopt(socket_, SOL_SOCKET, SO_ERROR, &refused, &size) == 0 && refused == 0;
  }

  Status write_all(std::span<const std::byte> data, double timeout_s) override {
    accept_station();
    if (!is_tcp()) {
      if (address_.asks && !asker_) return {};
      const auto* to = address_.asks ? reinterpret_cast<const sockaddr*>(&*asker_) : nullptr;
      for (; !data.empty(); data = data.subspan(std::min(data.size(), datagram_bytes)))
        static_cast<void>(::sendto(socket_, data.data(), std::min(data.size(), datagram_bytes), MSG_NOSIGNAL, to,
                                   to != nullptr ? sizeof *asker_ : 0));
      return {};
    }
    if (station_ < 0) return {};
    const int number = write_until(Deadline(timeout_s), station_, data, [&](std::span<const std::byte> left) {
      return ::send(station_, left.data(), left.size(), MSG_NOSIGNAL);
    });
    if (number == not_in_time)
      return device_error(fmt::format("{}: {} bytes were not read in time", device_, data.size()));
    if (number != 0) station_ = Descriptor();
    return {};
  }

  Result<std::size_t> read(std::span<std::byte> out, double timeout_s) override {
    accept_station();
    const int fd = is_tcp() ? station_ : socket_;
    if (fd < 0) return std::size_t{0};
    if (wait_ready(fd, POLLIN, Deadline(timeout_s).left_ms()) <= 0) return std::size_t{0};
    sockaddr_in from{};
    socklen_t size = sizeof from;
    const ssize_t n = ::recvfrom(fd, out.data(), out.size(), 0, reinterpret_cast<sockaddr*>(&from), &size);
    if (is_tcp() && (n == 0 || (n < 0 && errno != EAGAIN && errno != EINTR))) station_ = Descriptor();
    if (address_.asks && n > 0) asker_ = from;
    return std::size_t(std::max<ssize_t>(n, 0));
  }

 private:
  bool is_tcp() const { return address_.kind == LineKind::tcp; }
  void accept_station() {
    if (is_tcp() && station_ < 0) station_ = ::accept4(socket_, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC);
  }

  std::string device_;
  LineAddress address_;
  Descriptor socket_;
  Descriptor station_;  // tcp: the connected station
  std::optional<sockaddr_in> asker_;
};

}  // namespace

Pty& Pty::operator=(Pty&& other) noexcept {
  std::swap(fd_, other.fd_);
  std::swap(device_, other.device_);
  std::swap(link_, other.link_);
  return *this;
}

void Pty::unplug() {
  if (!link_.empty()) ::unlink(std::exchange(link_, {}).c_str());
  fd_ = Descriptor();
}

Result<Pty> Pty::create(const std::string& link_path) {
  Pty pty;
  pty.fd_ = ::open("/dev/ptmx", O_RDWR | O_NOCTTY | O_CLOEXEC | O_NONBLOCK);
  if (pty.fd_ < 0) return line_error(pseudo_terminal, "cannot open", errno);
  std::array<char, 128> name{};
  if (::grantpt(pty.fd_) != 0 || ::unlockpt(pty.fd_) != 0 || ::ptsname_r(pty.fd_, name.data(), name.size()) != 0)
    return line_error(pseudo_terminal, "cannot set up", errno);
  // Set to raw before use, then opened and closed once: only after that does the master report that nobody is there.
  const Descriptor slave = ::open(name.data(), O_RDWR | O_NOCTTY | O_CLOEXEC);
  if (slave < 0) return line_error(pseudo_terminal, "cannot open " + std::string(name.data()), errno);
  termios line{};
  ::tcgetattr(slave, &line);
  ::cfmakeraw(&line);
  ::tcsetattr(slave, TCSANOW, &line);
  pty.device_ = name.data();
  if (!link_path.empty()) {
    struct stat facts {};
    if (::lstat(link_path.c_str(), &facts) == 0 && S_ISLNK(facts.st_mode)) ::unlink(link_path.c_str());
    if (::symlink(name.data(), link_path.c_str()) != 0)
      return line_error(pseudo_terminal, "cannot make the link " + link_path, errno);
    pty.link_ = link_path;
    pty.device_ = link_path;
  }
  return pty;
}

bool Pty::has_peer() const {
  if (fd_ < 0) return false;
  pollfd which{fd_, 0, 0};
  return ::poll(&which, 1, 0) >= 0 && (which.revents & POLLHUP) == 0;
}

Status Pty::write_all(std::span<const std::byte> data, double timeout_s) {
  // Without a peer the bytes are discarded.
  const int number = write_until(Deadline(timeout_s), fd_, data, [&](std::span<const std::byte> left) {
    return has_peer() ? ::write(fd_, left.data(), left.size()) : static_cast<ssize_t>(left.size());
  });
  if (number == not_in_time) return device_error("pseudo-terminal: the peer does not read");
  return number == 0 ? Status{} : line_error(pseudo_terminal, "cannot write", errno);
}

Status Pty::write_all(std::string_view text, double timeout_s) {
  return write_all(std::as_bytes(std::span(text.data(), text.size())), timeout_s);
}

Result<std::size_t> Pty::read(std::span<std::byte> out, double timeout_s) {
  const Deadline deadline(timeout_s);
  for (;;) {
    const ssize_t n = fd_ >= 0 ? ::read(fd_, out.data(), out.size()) : 0;
    if (n > 0) return std::size_t(n);
    if (n < 0 && errno != EAGAIN && errno != EINTR && errno != EIO)
      return line_error(pseudo_terminal, "cannot read", errno);
    if (!has_peer()) {
      // poll() would always return at once.
      const timespec pause{0, 2'000'000};
      if (timeout_s > 0.0) ::nanosleep(&pause, nullptr);
    } else {
      wait_ready(fd_, POLLIN, deadline.left_ms());
    }
    if (deadline.passed()) return std::size_t{0};
  }
}

// ---- the network ----

Result<std::unique_ptr<UnitEnd>> open_unit_end(const std::string& device) {
  const std::optional<LineAddress> address = parse_line(device);
  if (!address || address->kind == LineKind::serial)
    return std::unique_ptr<UnitEnd>(std::make_unique<Pty>(TRY(Pty::create(device))));
  auto end = std::make_unique<NetworkEnd>(device, *address);
  TRY(end->open());
  return std::unique_ptr<UnitEnd>(std::move(end));
}

}  // namespace turncal
