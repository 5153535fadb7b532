#include "orchestrator/watch/page_server.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <netdb.h>
#include <poll.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <chrono>
#include <list>
#include <map>
#include <thread>
#include <vector>

#include "imu_io/base/clock.h"
#include "imu_io/base/files.h"
#include "imu_io/base/text.h"
#include "orchestrator/run/background_queue.h"

namespace turncal {

namespace {

constexpr int backlog = 64;
constexpr int accepted_a_turn =
    8;  // fewer than connections, so that a client that sends its request at once is served before others replace it
constexpr int low_priority = 5;
constexpr int look_ms = 250;  // for connections out of time
constexpr std::size_t drained_bytes = std::size_t{1} << 20;

std::string lower(std::string_view text) {
  std::string result(text);
  for (char& c : result) c = char(std::tolower(static_cast<unsigned char>(c)));
  return result;
}

bool is_bare_address(const std::string& host) {
  in6_addr any{};
  return ::inet_pton(AF_INET, host.c_str(), &any) == 1 || ::inet_pton(AF_INET6, host.c_str(), &any) == 1;
}

// Returns "host:80", "[::1]:80" or "host" without the port.
std::string host_without_port(std::string_view text) {
  if (text.starts_with("[")) return std::string(text.substr(1, text.find(']') - 1));
  return std::string(text.substr(0, text.rfind(':')));
}

std::string response(int code, const char* reason, const PageText& text) {
  return "HTTP/1.1 " + std::to_string(code) + " " + reason + "\r\nContent-Type: " + text.type +
         "\r\nContent-Length: " + std::to_string(text.body.size()) +
         "\r\nCache-Control: no-store\r\nX-Content-Type-Options: nosniff\r\nX-Frame-Options: "
         "DENY\r\nContent-Security-Policy: default-src 'none'; "
         "style-src 'unsafe-inline'; script-src 'unsafe-inline'; connect-src 'self'; img-src data:; form-action "
         "'none'; base-uri 'none'\r\nConnection: close\r\n\r\n" +
         text.body;
}

std::string refusal(int code, const char* reason) {
  return response(code, reason, {"text/plain; charset=utf-8", std::string(reason) + "\n"});
}

struct OpenServer : PageServer {
  // A socket and the progress of its one request.
  struct Connection {
    Descriptor fd;
    Deadline deadline;
    std::string request, answer;
    std::size_t sent = 0, drained = 0;
    bool answered() const { return !answer.empty(); }
    bool all_sent() const { return answered() && sent == answer.size(); }

    Connection(int socket, double seconds) : fd(socket), deadline(seconds) {}
  };

  Pages pages;
  Posts posts;
  PageLimits limits;
  std::string host;  // as given, without brackets
  int port = 0;
  bool is_loopback = false;
  Descriptor listener, woken, wake;
  std::list<Connection> connections;  // the oldest first
  std::jthread thread;

  ~OpenServer() override { wake = Descriptor(); }  // wakes the thread

  std::string url() const override {
    const bool v6 = host.find(':') != std::string::npos;
    return "http://" + (v6 ? "[" + host + "]" : host) + ":" + std::to_string(port) + "/";
  }
  bool loopback() const override { return is_loopback; }

  bool is_our_host(std::string_view given) const {
    const std::string name = lower(host_without_port(given));
    if (name == lower(host)) return true;
    if (is_loopback) return name == "localhost" || name == "127.0.0.1" || name == "::1";
    char own[256] = {};
    return is_bare_address(name) || (::gethostname(own, sizeof own - 1) == 0 && name == lower(own));
  }

  struct Head {
    std::string_view method, path;
    std::map<std::string, std::string> fields;  // keys in lower case
    std::size_t body_bytes = 0;
    bool has(const char* name) const { return fields.contains(name); }
  };
  static std::optional<Head> head_of(std::string_view request) {
    Head head;
    std::string_view remaining = request;
    const std::string_view line = next_line(remaining);
    const std::size_t first = line.find(' '), last = line.rfind(' ');
    if (first == std::string_view::npos || last == first || !line.substr(last + 1).starts_with("HTTP/1.")) return {};
    head.method = line.substr(0, first);
    head.path = line.substr(first + 1, last - first - 1);
    while (!remaining.empty()) {
      const std::string_view header = next_line(remaining);
      const std::size_t colon = header.find(':');
      if (colon == std::string_view::npos && header.empty()) continue;
      if (colon == std::string_view::npos || colon == 0 || header[colon - 1] == ' ' || header[colon - 1] == '\t' ||
          header[0] == ' ' || header[0] == '\t')
        return {};  // a folded line, or a name that ends with a blank
      const std::string name = lower(header.substr(0, colon));
      const bool is_new = head.fields.emplace(name, trimmed(header.substr(colon + 1))).second;
      // RFC 9112, 3.2 and 6.3: duplicates of these would be ambiguous.
      if (!is_new && (name == "host" || name == "content-length" || name == "authorization")) return {};
    }
    if (!head.has("content-length")) return head;
    const std::optional<std::uint32_t> size = parse_integer<std::uint32_t>(head.fields["content-length"]);
    if (!size || head.has("transfer-encoding")) return {};
    head.body_bytes = *size;
    return head;
  }

  // Answers what was received so far. Empty: the rest of the body is still missing.
  std::string answer_to(std::string_view request, std::size_t head_bytes) const {
    std::optional<Head> head = head_of(request.substr(0, head_bytes));
    if (!head || !head->has("host")) return refusal(400, "Bad Request");  // RFC 9112, 3.2
    if (!is_our_host(head->fields["host"])) return refusal(403, "Forbidden");
    const bool chunked = head->has("transfer-encoding");
    if (posts && head->method == "POST") {
      if (!head->has("x-turncal")) return refusal(403, "Forbidden");
      if (chunked || head->body_bytes > limits.body_bytes) return refusal(413, "Content Too Large");
      const std::string_view body = request.substr(head_bytes);
      if (body.size() < head->body_bytes) return "";
      const PageAnswer answer = posts(
          {std::string(head->path), head->fields["authorization"], std::string(body.substr(0, head->body_bytes))});
      return response(answer.code, answer.code == 200 ? "OK" : "Refused", answer.text);
    }
    const bool no_body = head->method == "HEAD";  // RFC 9110, 9.3.2
    if (head->method != "GET" && !no_body) return refusal(404, "Not Found");
    if (chunked || head->body_bytes > 0) return refusal(413, "Content Too Large");
    const std::optional<PageText> page = pages(head->path);
    std::string answer = page ? response(200, "OK", *page) : refusal(404, "Not Found");
    if (no_body) answer.resize(answer.find("\r\n\r\n") + 4);
    return answer;
  }

  // Returns false when the connection is over.
  bool receive(Connection& c) const {
    char buffer[4096];
    const ssize_t got = ::recv(c.fd, buffer, sizeof buffer, MSG_DONTWAIT);
    if (got < 0) return errno == EAGAIN || errno == EINTR;
    if (got == 0) return false;
    if (c.answered()) {  // further bytes are discarded, so that a reset does not lose the answer
      c.drained += std::size_t(got);
      return c.drained < drained_bytes;
    }
    c.request.append(buffer, std::size_t(got));
    const std::size_t end = c.request.find("\r\n\r\n");
    const std::size_t size = end == std::string::npos ? c.request.size() : end + 4;
    if (size > limits.request_bytes)
      c.answer = refusal(431, "Request Header Fields Too Large");
    else if (end != std::string::npos)
      c.answer = answer_to(c.request, size);
    return !c.answered() || send(c);
  }

  bool send(Connection& c) const {
    while (!c.all_sent()) {
      const ssize_t put = ::send(c.fd, c.answer.data() + c.sent, c.answer.size() - c.sent, MSG_DONTWAIT | MSG_NOSIGNAL);
      if (put < 0) return errno == EAGAIN || errno == EINTR;
      c.sent += std::size_t(put);
    }
    ::shutdown(c.fd, SHUT_WR);
    return true;  // until the other end closes, or its time is over
  }

  void accept_some() {
    for (int i = 0; i < accepted_a_turn; ++i) {
      const int fd = ::accept4(listener, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC);
      if (fd < 0) {
        // Without a free descriptor, waiting clients would keep this thread busy.
        if (errno == EMFILE || errno == ENFILE) std::this_thread::sleep_for(std::chrono::milliseconds(look_ms));
        return;
      }
      if (connections.size() >= limits.connections) {
        const auto idle =
            std::ranges::find_if(connections, [](const Connection& c) { return !c.answered() || c.all_sent(); });
        connections.erase(idle == connections.end() ? connections.begin() : idle);
      }
      connections.emplace_back(fd, limits.connection_s);
    }
  }

  // Returns false at the end.
  bool turn() {
    std::vector<pollfd> watched = {{woken, POLLIN, 0}, {listener, POLLIN, 0}};
    for (const Connection& c : connections)
      watched.push_back({c.fd, static_cast<short>(c.answered() && !c.all_sent() ? POLLOUT : POLLIN), 0});
    if (::poll(watched.data(), watched.size(), connections.empty() ? -1 : look_ms) < 0) return errno == EINTR;
    if (watched[0].revents != 0) return false;
    auto ready = watched.begin() + 2;
    for (auto c = connections.begin(); c != connections.end(); ++ready) {
      const bool keep =
          !c->deadline.passed() && (ready->revents == 0 || (c->answered() && !c->all_sent() ? send(*c) : receive(*c)));
      c = keep ? std::next(c) : connections.erase(c);
    }
    if (watched[1].revents != 0) accept_some();
    return true;
  }

  void serve() noexcept {
    ::setpriority(PRIO_PROCESS, static_cast<id_t>(::gettid()), low_priority);
    for (bool more = true; more;) {
      try {
        more = turn();
      } catch (...) {
        connections.clear();
        std::this_thread::sleep_for(std::chrono::milliseconds(look_ms));
      }
    }
    connections.clear();
  }

  Status listen(const std::string& address, const PageAddress& at) {
    const auto failed = [&address](const std::string& why) {
      return input_error("--listen '" + address + "': cannot listen there: " + why);
    };
    addrinfo wanted{}, *found = nullptr;
    wanted.ai_socktype = SOCK_STREAM;
    wanted.ai_flags = AI_PASSIVE;
    if (const int error = ::getaddrinfo(at.host.c_str(), std::to_string(at.port).c_str(), &wanted, &found); error != 0)
      return failed(::gai_strerror(error));
    const std::unique_ptr<addrinfo, void (*)(addrinfo*)> freed(found, ::freeaddrinfo);
    listener = ::socket(found->ai_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    const int yes = 1;  // not SO_REUSEPORT: a port that another program serves is refused
    if (listener < 0 || ::setsockopt(listener, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes) != 0 ||
        ::bind(listener, found->ai_addr, found->ai_addrlen) != 0 || ::listen(listener, backlog) != 0)
      return failed(std::generic_category().message(errno));
    sockaddr_storage bound{};
    socklen_t size = sizeof bound;
    ::getsockname(listener, reinterpret_cast<sockaddr*>(&bound), &size);
    if (bound.ss_family == AF_INET6) {
      const auto& v6 = reinterpret_cast<const sockaddr_in6&>(bound);
      port = ntohs(v6.sin6_port);
      is_loopback = IN6_IS_ADDR_LOOPBACK(&v6.sin6_addr);
    } else {
      const auto& v4 = reinterpret_cast<const sockaddr_in&>(bound);
      port = ntohs(v4.sin_port);
      is_loopback = (ntohl(v4.sin_addr.s_addr) >> 24) == 127;
    }
    host = at.host;
    int ends[2] = {-1, -1};
    if (::pipe2(ends, O_CLOEXEC) != 0) return failed(std::generic_category().message(errno));
    woken = ends[0];
    wake = ends[1];
    return {};
  }
};

}  // namespace

Result<PageAddress> parse_page_address(const std::string& text) {
  const std::size_t colon = text.rfind(':');
  const std::optional<int> given = parse_integer<int>(colon == std::string::npos ? "" : text.substr(colon + 1));
  const int port = given.value_or(-1);
  std::string host = colon == std::string::npos ? "" : text.substr(0, colon);
  const bool brackets = host.size() > 2 && host.front() == '[' && host.back() == ']';
  if (brackets) host = host.substr(1, host.size() - 2);
  const bool plain = brackets || host.find_first_of(":[]") == std::string::npos;
  if (port < 0 || port > 65535 || host.empty() || !plain)
    return input_error("--listen '" + text + "': expected ADDRESS:PORT, as 127.0.0.1:8080 or [::1]:8080");
  return PageAddress{host, port};
}

PageText page_with(std::string_view html, const std::string& status) {
  std::string text(html);
  text.replace(text.find("INITIAL"), 7, status);
  return {"text/html; charset=utf-8", text.replace(text.find("HEAD"), 4, page_head)};
}

Result<std::unique_ptr<PageServer>> PageServer::open(const std::string& address, Pages pages, PageLimits limits,
                                                     Posts posts) {
  const PageAddress at = TRY(parse_page_address(address));
  auto server = std::make_unique<OpenServer>();
  server->pages = std::move(pages);
  server->posts = std::move(posts);
  server->limits = limits;
  TRY(server->listen(address, at));
  server->thread = start_without_signals([&one = *server] { one.serve(); });
  return std::unique_ptr<PageServer>(std::move(server));
}

}  // namespace turncal
