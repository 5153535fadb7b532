// Serves a few texts to browsers, from a program that may move a table: no client costs more than the limits
// below, and nobody waits for one.
//
//   connections   a further one replaces the oldest that has not sent a request yet, else the oldest
//   request       its line and headers together; only GET; a body is never read (a request that announces one is refused). If the
//                 owner takes posts: POST as well, with a body of at most body_bytes, and with the header X-Turncal, which no
//                 form of another page can send (cross-site request forgery)
//   time          of a connection from beginning to end, however many bytes come in it
//   Host          the address listened at, localhost on a loopback address, this machine's name or a bare address on any other:
//                 another site cannot read this page through a name of its own that leads here (DNS rebinding)
//
// HTTP/1.1 (RFC 9112), one request a connection. One thread with a lower priority serves all; it never blocks on a client, takes no
// signals, and lets no exception out: when memory runs out it drops its clients. Shutdown waits for nobody.
//
// Why not a library: cpp-httplib reads headers without a limit, decompresses without one, and waits at the end for its
// slowest client. No access control, no encryption: use a loopback address, or a proxy that has them.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "calib/types/status.h"

namespace turncal {

struct PageLimits {
  std::size_t connections = 32;
  std::size_t request_bytes = 8192;
  std::size_t body_bytes = 1024;
  double connection_s = 10.0;
};

struct PageText {
  std::string type;  // "text/html; charset=utf-8"
  std::string body;
};

// Beginning of the head of every page: the colours, light and dark, and what all pages share.
extern const std::string_view page_head;  // page_head.html

// Fills HTML in which HEAD stands for page_head and INITIAL for the first status, which the page shows without a second request.
PageText page_with(std::string_view html, const std::string& status);

struct PagePost {
  std::string path, authorization, body;
};
struct PageAnswer {
  int code = 200;
  PageText text;
};

// ADDRESS:PORT, or [ADDRESS]:PORT for IPv6; the address may be a name. Port 0: any free one.
struct PageAddress {
  std::string host;  // without brackets
  int port = 0;
};
Result<PageAddress> parse_page_address(const std::string& text);

class PageServer {
 public:
  // Returns what is served at a path; nothing: 404. Called by the server's thread.
  using Pages = std::function<std::optional<PageText>(std::string_view path)>;

  // Answers a POST, in the server's thread, too. Without it posts are refused.
  using Posts = std::function<PageAnswer(const PagePost&)>;

  static Result<std::unique_ptr<PageServer>> open(const std::string& address, Pages pages, PageLimits limits = {},
                                                  Posts posts = {});
  virtual ~PageServer() = default;

  virtual std::string url() const = 0;
  virtual bool loopback() const = 0;  // only this machine reaches it
};

}  // namespace turncal
