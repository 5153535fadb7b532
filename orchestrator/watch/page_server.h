// Serves a few texts to browsers, from a program that may move a table: whatever a client does costs no more than the limits
// below, and nobody waits for it.
//
//   connections   a further one takes the place of the oldest that has not asked for anything yet, else of the oldest
//   request       its line and headers together; only GET; a body is never read (a request that announces one is refused). Where the
//                 owner takes posts: POST as well, with a body of at most body_bytes, and with the header X-Turncal, which no
//                 form of another page can send (cross-site request forgery)
//   time          of a connection from beginning to end, however many bytes come in it
//   Host          the address listened at, localhost on a loopback address, this machine's name or a bare address on any other:
//                 a page of somewhere else cannot read this one by giving itself a name that leads here (DNS rebinding)
//
// HTTP/1.1 (RFC 9112), one request a connection. One thread with a lower priority serves all; it never blocks on a client, signals
// go to others, and no exception leaves it: one that is out of memory drops its clients. The end does not wait for anybody.
//
// Why not a library: cpp-httplib reads headers without a limit, unpacks compressed bodies without one, and waits at the end for its
// slowest client. No access control, no encryption: a loopback address, or a proxy that has them.
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

// What the head of every page begins with: the colours, light and dark, and what all of them share.
extern const std::string_view page_head;  // page_head.html

// HTML in which HEAD stands for page_head, and INITIAL for the first status: it shows something at once and without a second request.
PageText page_with(std::string_view html, const std::string& status);

struct PagePost {
  std::string path, authorization, body;
};
struct PageAnswer {
  int code = 200;
  PageText text;
};

// ADDRESS:PORT, [ADDRESS]:PORT of IPv6; the address may be a name. Port 0: any free one.
struct PageAddress {
  std::string host;  // without brackets
  int port = 0;
};
Result<PageAddress> parse_page_address(const std::string& text);

class PageServer {
 public:
  // What is served at a path; nothing: 404. Called by the server's thread.
  using Pages = std::function<std::optional<PageText>(std::string_view path)>;

  // What becomes of a POST; by the server's thread, too. Without it there are none.
  using Posts = std::function<PageAnswer(const PagePost&)>;

  static Result<std::unique_ptr<PageServer>> open(const std::string& address, Pages pages, PageLimits limits = {},
                                                  Posts posts = {});
  virtual ~PageServer() = default;

  virtual std::string url() const = 0;
  virtual bool loopback() const = 0;  // only this machine reaches it
};

}  // namespace turncal
