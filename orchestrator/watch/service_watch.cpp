#include "orchestrator/watch/service_watch.h"

#include <sys/socket.h>
#include <sys/un.h>

#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <string_view>

#include "imu_io/base/clock.h"
#include "orchestrator/watch/progress.h"

namespace turncal {

ServiceWatch::ServiceWatch() {
  const char* const name = std::getenv("NOTIFY_SOCKET");
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  const std::size_t length = name == nullptr ? 0 : std::strlen(name);
  if (length < 2 || length >= sizeof address.sun_path) return;
  std::memcpy(address.sun_path, name, length);
  if (name[0] == '@') address.sun_path[0] = '\0';  // an abstract one
  socket_ = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + length);
  if (socket_ >= 0 && ::connect(socket_, reinterpret_cast<const sockaddr*>(&address), size) != 0)
    socket_ = Descriptor();
}

void ServiceWatch::tell(const std::string& what) const {
  if (socket_ >= 0) static_cast<void>(::send(socket_, what.data(), what.size(), MSG_NOSIGNAL));
}

void ServiceWatch::disarm() {
  if (armed_) tell("WATCHDOG_USEC=0");
  armed_ = false;
}

void ServiceWatch::on_transition(const TransitionRecord& record) {
  if (record.to != RunState::calibrating && !is_final(record.to)) return;
  disarm();
  tell("STATUS=" + std::string(to_string(record.to)));
}

void ServiceWatch::on_progress(const RunSnapshot& snapshot) {
  const double now_s = monotonic_s();
  const bool unwatched = snapshot.state == RunState::calibrating || is_final(snapshot.state);
  if (socket_ < 0 || unwatched || now_s - last_ping_s_ < 1.0) return;
  last_ping_s_ = now_s;
  if (!armed_) tell("WATCHDOG_USEC=" + std::to_string(watch_s) + "000000");
  armed_ = true;
  tell("WATCHDOG=1\nSTATUS=" + format_progress(snapshot));
}

}  // namespace turncal
