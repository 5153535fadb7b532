#include "turntable_drivers/ascii/text_line.h"

#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>

#include "imu_io/base/clock.h"
#include "imu_io/lines/tcp_connection.h"
#include "turntable_drivers/table/drive_rules.h"

namespace turncal {
namespace {

constexpr double slice_s = 1e-3 * StopSignal::longest_look_away_ms;
constexpr double write_timeout_s = 0.01;  // the kernel takes a sentence at once; a line that does not is dead
constexpr std::size_t longest_answer = 4096;
constexpr double longest_drain = 2.0;  // times quiet_s, once no answer can come any more: then nobody can be understood

}  // namespace

TextLine::TextLine(DialectLink link, const StopSignal& stop) : link_(std::move(link)), stop_(stop) {
  link_.serial.device = link_.address;
}

TextLine::~TextLine() { close(); }

void TextLine::close() {
  if (link_.tcp && descriptor_ >= 0) ::close(descriptor_);
  port_.close();
  descriptor_ = -1;
}

Error TextLine::failure(const std::string& what) const { return device_error(link_.address + ": " + what); }

Error TextLine::given_up() const { return {ErrorKind::aborted, link_.address + ": given up for a stop"}; }

Error TextLine::hang_up(const std::string& what) {
  close();
  return failure(what);
}

Status TextLine::open() {
  close();
  buffer_.clear();
  stale_ = false;
  if (!link_.tcp) {
    if (link_.address.empty()) return input_error("link.address: expected a serial device");
    SerialPort port = TRY(SerialPort::open(link_.serial));
    port_ = std::move(port);
    descriptor_ = port_.descriptor();
    return {};
  }
  const int socket = TRY(connect_tcp(link_.address, link_.reply_timeout_s, stop_.giving_up()));
  descriptor_ = socket;
  return {};
}

Status TextLine::receive_some(double wait_s, bool& any) {
  any = false;
  std::array<char, 512> chunk;
  if (!link_.tcp) {
    const Result<std::size_t> n = port_.read(std::as_writable_bytes(std::span(chunk)), wait_s);
    if (!n) {
      const Error& error = n.error();
      close();
      return error;
    }
    buffer_.append(chunk.data(), *n);
    any = *n > 0;
    return {};
  }
  pollfd which{descriptor_, POLLIN, 0};
  if (::poll(&which, 1, static_cast<int>(1e3 * wait_s)) <= 0) return {};
  const ssize_t n = ::recv(descriptor_, chunk.data(), chunk.size(), MSG_DONTWAIT);
  if (n < 0 && (errno == EAGAIN || errno == EINTR)) return {};
  if (n <= 0) return hang_up("the other end hung up");
  buffer_.append(chunk.data(), static_cast<std::size_t>(n));
  any = true;
  return {};
}

Status TextLine::drain() {
  const double answer_due_s = std::max(0.0, last_sent_s_ + link_.reply_timeout_s - monotonic_s());
  const Deadline limit(answer_due_s + longest_drain * link_.quiet_s);
  double quiet_since_s = monotonic_s();
  while (monotonic_s() - quiet_since_s < link_.quiet_s) {
    if (stop_.pending()) return given_up();
    if (limit.passed()) return hang_up("the line does not fall silent");
    stop_.look_away();
    bool any = false;
    TRY(receive_some(slice_s, any));
    if (any) quiet_since_s = monotonic_s();
    buffer_.clear();
  }
  stale_ = false;
  return {};
}

std::string frame_of(const DialectLink& link, const std::string& body) {
  std::string frame = link.prefix + body;
  if (link.check != SentenceCheck::none) frame += link.check_mark + check_digits(body, link.check, link.crc);
  return frame;
}

Status TextLine::write(const std::string& body) {
  const std::string frame = frame_of(link_, body) + link_.terminator_out;
  last_sent_s_ = monotonic_s();
  if (!link_.tcp) return port_.write_all(frame, write_timeout_s);
  const ssize_t n = ::send(descriptor_, frame.data(), frame.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
  if (n != static_cast<ssize_t>(frame.size())) return hang_up("cannot send");
  return {};
}

Result<std::string> TextLine::read_until(const std::string& end, const Deadline& deadline, bool at_once) {
  for (;;) {
    if (const std::size_t place = buffer_.find(end); place != std::string::npos) {
      std::string text = buffer_.substr(0, place);
      buffer_.erase(0, place + end.size());
      return text;
    }
    if (buffer_.size() > longest_answer) {
      stale_ = true;
      return failure("rubbish: no end of an answer in " + std::to_string(buffer_.size()) + " characters");
    }
    if (!at_once && stop_.pending()) {
      stale_ = true;
      return given_up();
    }
    if (deadline.passed()) {
      stale_ = true;
      const std::string so_far = buffer_.empty() ? "" : ", only '" + visible(buffer_) + "'";
      const double awaited_s = at_once ? stop_ack_s : link_.reply_timeout_s;
      return failure("no answer within " + std::to_string(static_cast<int>(1e3 * awaited_s)) + " ms" + so_far);
    }
    if (!at_once) stop_.look_away();
    bool any = false;
    TRY(receive_some(std::min(slice_s, deadline.left_s()), any));
  }
}

Result<std::string> TextLine::body_of(std::string frame) const {
  const auto wrong = [&](const std::string& what) { return failure("answer '" + visible(frame) + "': " + what); };
  if (!frame.starts_with(link_.prefix)) return wrong("expected it to begin with " + link_.prefix);
  std::string body = frame.substr(link_.prefix.size());
  if (link_.check == SentenceCheck::none) return body;
  const std::size_t digit_count = link_.check == SentenceCheck::crc16 ? 4 : 2;
  const std::size_t tail = link_.check_mark.size() + digit_count;
  if (body.size() < tail || body.substr(body.size() - tail, link_.check_mark.size()) != link_.check_mark) {
    return wrong("no checksum");
  }
  const std::string digits = body.substr(body.size() - digit_count);
  body.resize(body.size() - tail);
  const std::string expected = check_digits(body, link_.check, link_.crc);
  if (digits != expected) return wrong("checksum " + digits + ", expected " + expected);
  return body;
}

Result<std::string> TextLine::bodies_of(const std::string& frames, int lines) {
  std::string remaining = frames;
  if (remaining.ends_with(link_.terminator_in)) remaining.resize(remaining.size() - link_.terminator_in.size());
  std::string bodies;
  int count = 0;
  for (bool more = !remaining.empty() || lines > 0; more;) {
    const std::size_t end = remaining.find(link_.terminator_in);
    more = end != std::string::npos;
    const std::string body = TRY(body_of(remaining.substr(0, end)));
    bodies += (count++ > 0 ? "\n" : "") + body;
    if (more) remaining.erase(0, end + link_.terminator_in.size());
  }
  if (count == lines || (lines == 0 && count == 1)) return bodies;  // what was not asked for is for the caller to judge
  return failure("answer '" + visible(frames) + "': expected " +
                 (lines > 1 ? std::to_string(lines) + " lines" : std::string("one line")));
}

Result<std::string> TextLine::exchange(const std::string& body, int lines) {
  if (!is_open()) return failure("not open");
  if (stop_.pending()) return given_up();
  bool any = false;
  TRY(receive_some(0.0, any));
  if (stale_) {
    TRY(drain());
  }
  buffer_.clear();
  if (!stop_.pause(last_sent_s_ + link_.gap_s - monotonic_s())) return given_up();
  TRY(write(body));
  const Deadline deadline(link_.reply_timeout_s);  // for all that comes
  if (link_.echo) {
    const std::string echo = TRY(read_until(link_.echo_terminator, deadline, false));
    if (!echo.ends_with(frame_of(link_, body))) {
      stale_ = true;
      return failure("echo '" + visible(echo) + "': expected '" + visible(frame_of(link_, body)) + "'");
    }
  }
  Result<std::string> result = std::string();
  std::string said;
  if (!link_.prompt.empty()) {
    const std::string frames = TRY(read_until(link_.prompt, deadline, false));
    said = frames;
    result = bodies_of(frames, lines);
  } else {
    for (int i = 0; i < lines && result; ++i) {
      const std::string frame = TRY(read_until(link_.terminator_in, deadline, false));
      said += frame;
      const Result<std::string> line = body_of(frame);
      result = line ? Result<std::string>(*result + (i > 0 ? "\n" : "") + *line) : line;
    }
    if (lines == 0) return result;
  }
  TRY(receive_some(0.0, any));
  if (result && !buffer_.empty()) {
    stale_ = true;
    return failure("answer '" + visible(said) + "': more after it: '" + visible(buffer_) + "'");
  }
  if (!result) stale_ = true;
  return result;
}

Status TextLine::send_at_once(const std::string& body, const std::optional<SentenceTemplate>& expect,
                              double timeout_s) {
  if (!is_open()) return failure("not open");
  TRY(write(body));
  if (!expect) {
    stale_ = true;  // the answer to what was interrupted may still come
    return {};
  }
  const Deadline deadline(timeout_s);
  const std::string& end = link_.prompt.empty() ? link_.terminator_in : link_.prompt;
  Error last = failure("no answer");
  stale_ = true;
  do {
    std::string frame = TRY(read_until(end, deadline, true));
    const Result<std::string> text = body_of(frame);
    if (text && expect->match(*text)) return {};
    last = text ? failure("answer '" + visible(*text) + "': expected '" + visible(expect->text()) + "'") : text.error();
  } while (!deadline.passed());
  return last;
}

}  // namespace turncal
