#include "turntable_drivers/twins/line_server.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>

namespace turncal {
namespace {

Error failure(const std::string& what) { return device_error("twin: " + what + ": " + std::strerror(errno)); }

void nap(double seconds) {
  if (seconds > 0.0) ::poll(nullptr, 0, int(1e3 * seconds));
}

}  // namespace

LineServer::~LineServer() {
  hang_up();
  if (listener_ >= 0) ::close(listener_);
}

Status LineServer::listen_tcp(int port, bool every_address) {
  listener_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (listener_ < 0) return failure("no socket");
  const int on = 1;
  ::setsockopt(listener_, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(std::uint16_t(port));
  address.sin_addr.s_addr = htonl(every_address ? INADDR_ANY : INADDR_LOOPBACK);
  socklen_t length = sizeof address;
  if (::bind(listener_, reinterpret_cast<sockaddr*>(&address), length) != 0 || ::listen(listener_, 4) != 0 ||
      ::getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &length) != 0) {
    const Error error = failure("port " + std::to_string(port));
    ::close(listener_);
    listener_ = -1;
    return error;
  }
  port_ = ntohs(address.sin_port);
  return {};
}

Status LineServer::open_pty(const std::string& link_path) {
  Pty pty = TRY(Pty::create(link_path));
  pty_ = std::move(pty);
  clients_.assign(1, Client{pty_.descriptor(), {}});
  return {};
}

std::string LineServer::address() const { return tcp() ? "127.0.0.1:" + std::to_string(port_) : pty_.device(); }

void LineServer::hang_up() {
  if (tcp())
    for (Client& client : clients_) ::close(client.descriptor);
  else
    pty_.unplug();
  clients_.clear();
}

bool LineServer::send(const Client& client, const AnswerPlan& plan) {
  for (const AnswerPiece& piece : plan.pieces) {
    nap(piece.delay_s);
    if (piece.bytes.empty()) continue;
    if (tcp()) {
      if (::send(client.descriptor, piece.bytes.data(), piece.bytes.size(), MSG_NOSIGNAL) < 0) return false;
    } else if (Status sent = pty_.write_all(std::as_bytes(std::span(piece.bytes)), 1.0); !sent) {
      return false;
    }
  }
  return !plan.hang_up;
}

bool LineServer::serve(Client& client) {
  std::array<std::uint8_t, 512> chunk;
  const ssize_t n = ::read(client.descriptor, chunk.data(), chunk.size());
  if (n < 0 && (errno == EAGAIN || errno == EINTR)) return true;
  if (n <= 0) return !tcp();  // a pseudo-terminal that nobody has open may be opened again
  client.bytes.insert(client.bytes.end(), chunk.begin(), chunk.begin() + n);
  while (const std::optional<AnswerPlan> plan = next_answer(client.bytes))
    if (!send(client, *plan)) return false;
  return true;
}

void LineServer::run_once(double timeout_s) {
  std::vector<pollfd> waiting;
  if (tcp()) waiting.push_back({listener_, POLLIN, 0});
  for (const Client& client : clients_) waiting.push_back({client.descriptor, POLLIN, 0});
  ::poll(waiting.data(), waiting.size(), int(1e3 * timeout_s));
  const std::size_t first = tcp() ? 1 : 0;
  const bool idle_pty =
      !tcp() && !waiting.empty() && (waiting[0].revents & POLLIN) == 0 && (waiting[0].revents & POLLHUP) != 0;
  if (idle_pty) nap(std::min(timeout_s, 0.005));  // poll() returns at once while nobody has it open
  std::vector<Client> kept;
  bool gone = false;
  for (std::size_t i = 0; i < clients_.size(); ++i) {
    const bool ready = (waiting[first + i].revents & (POLLIN | POLLHUP | POLLERR)) != 0;
    if (!ready || serve(clients_[i]))
      kept.push_back(std::move(clients_[i]));
    else if (tcp())
      ::close(clients_[i].descriptor);
    else
      gone = true;
  }
  clients_ = std::move(kept);
  if (gone) pty_.unplug();
  if (tcp() && (waiting[0].revents & POLLIN) != 0) {
    const int descriptor = ::accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK);
    const int on = 1;
    if (descriptor >= 0) {
      ::setsockopt(descriptor, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
      clients_.push_back({descriptor, {}});
    }
  }
  const std::lock_guard lock(mutex);
  tick();
}

}  // namespace turncal
