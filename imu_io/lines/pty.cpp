#include "imu_io/lines/pty.h"

#include <fcntl.h>
#include <poll.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <termios.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <utility>

#include "imu_io/base/clock.h"
#include "imu_io/lines/tcp_connection.h"

namespace turncal {
namespace {

Error failure(const std::string& what) {
  return device_error("pseudo-terminal: " + what + ": " + std::strerror(errno));
}

}  // namespace

Pty::Pty(Pty&& other) noexcept
    : fd_(std::exchange(other.fd_, -1)), device_(std::move(other.device_)), link_(std::exchange(other.link_, {})) {}

Pty& Pty::operator=(Pty&& other) noexcept {
  if (this != &other) {
    unplug();
    fd_ = std::exchange(other.fd_, -1);
    device_ = std::move(other.device_);
    link_ = std::exchange(other.link_, {});
  }
  return *this;
}

Pty::~Pty() { unplug(); }

void Pty::unplug() {
  if (!link_.empty()) ::unlink(std::exchange(link_, {}).c_str());
  if (fd_ >= 0) ::close(std::exchange(fd_, -1));
}

Result<Pty> Pty::create(const std::string& link_path) {
  Pty pty;
  pty.fd_ = ::open("/dev/ptmx", O_RDWR | O_NOCTTY | O_CLOEXEC | O_NONBLOCK);
  if (pty.fd_ < 0) return failure("cannot open");
  std::array<char, 128> name{};
  if (::grantpt(pty.fd_) != 0 || ::unlockpt(pty.fd_) != 0 || ::ptsname_r(pty.fd_, name.data(), name.size()) != 0)
    return failure("cannot set up");
  // Raw from the start, and opened once and closed: only then does the master tell that nobody is there.
  const int slave = ::open(name.data(), O_RDWR | O_NOCTTY | O_CLOEXEC);
  if (slave < 0) return failure("cannot open " + std::string(name.data()));
  termios line{};
  ::tcgetattr(slave, &line);
  ::cfmakeraw(&line);
  ::tcsetattr(slave, TCSANOW, &line);
  ::close(slave);
  pty.device_ = name.data();
  if (!link_path.empty()) {
    struct stat facts {};
    if (::lstat(link_path.c_str(), &facts) == 0 && S_ISLNK(facts.st_mode)) ::unlink(link_path.c_str());
    if (::symlink(name.data(), link_path.c_str()) != 0) return failure("cannot make the link " + link_path);
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
  // What nobody listens to is gone.
  const int number = write_until(Deadline(timeout_s), fd_, data, [&](std::span<const std::byte> left) {
    return has_peer() ? ::write(fd_, left.data(), left.size()) : static_cast<ssize_t>(left.size());
  });
  if (number == not_in_time) return device_error("pseudo-terminal: the peer does not read");
  return number == 0 ? Status{} : failure("cannot write");
}

Status Pty::write_all(std::string_view text, double timeout_s) {
  return write_all(std::as_bytes(std::span(text.data(), text.size())), timeout_s);
}

Result<std::size_t> Pty::read(std::span<std::byte> out, double timeout_s) {
  const Deadline deadline(timeout_s);
  for (;;) {
    const ssize_t n = fd_ >= 0 ? ::read(fd_, out.data(), out.size()) : 0;
    if (n > 0) return static_cast<std::size_t>(n);
    if (n < 0 && errno != EAGAIN && errno != EINTR && errno != EIO) return failure("cannot read");
    if (!has_peer()) {
      // poll() would return at once for ever.
      const timespec pause{0, 2'000'000};
      if (timeout_s > 0.0) ::nanosleep(&pause, nullptr);
    } else {
      wait_ready(fd_, POLLIN, deadline.left_ms());
    }
    if (deadline.passed()) return std::size_t{0};
  }
}

}  // namespace turncal
