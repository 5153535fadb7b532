#include "turntable_drivers/table/table_line.h"

#include <fmt/format.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>

#include "imu_io/lines/byte_line.h"

namespace turncal {
namespace {

constexpr double slice_s = 1e-3 * StopSignal::longest_look_away_ms;
constexpr double write_timeout_s = 0.01;  // the kernel takes a request at once; otherwise the line is dead
constexpr std::size_t longest_reply = 4096;
constexpr double longest_drain = 2.0;  // times quiet_s, after the last possible answer: then the line is beyond use

}  // namespace

TableLine::TableLine(TableLinkSettings settings, const StopSignal& stop) : settings_(std::move(settings)), stop_(stop) {
  settings_.serial.device = settings_.address;
}

void TableLine::close() {
  if (settings_.tcp && descriptor_ >= 0) ::close(descriptor_);
  port_.close();
  descriptor_ = -1;
}

Error TableLine::failure(const std::string& what) const { return device_error(settings_.address + ": " + what); }

Error TableLine::given_up() const { return {ErrorKind::aborted, settings_.address + ": given up for a stop"}; }

Error TableLine::hang_up(const std::string& what) {
  close();
  return failure(what);
}

Status TableLine::open() {
  close();
  heard_.clear();
  stale_ = false;
  if (settings_.tcp) {
    descriptor_ = TRY(connect_tcp(settings_.address, settings_.reply_timeout_s, stop_.giving_up()));
  } else {
    if (settings_.address.empty()) return input_error("link.address: expected a serial device");
    SerialPort port = TRY(SerialPort::open(settings_.serial));
    port_ = std::move(port);
    descriptor_ = port_.descriptor();
  }
  last_activity_s_ = monotonic_s();
  return {};
}

Result<bool> TableLine::receive(double wait_s) {
  std::array<char, 512> chunk;
  std::size_t count = 0;
  if (!settings_.tcp) {
    const Result<std::size_t> n = port_.read(std::as_writable_bytes(std::span(chunk)), wait_s);
    if (!n) close();
    count = TRY(n);
  } else {
    if (wait_ready(descriptor_, POLLIN, int(1e3 * wait_s)) <= 0) return false;
    const ssize_t n = ::recv(descriptor_, chunk.data(), chunk.size(), MSG_DONTWAIT);
    if (n < 0 && (errno == EAGAIN || errno == EINTR)) return false;
    if (n <= 0) return hang_up("the other end hung up");
    count = std::size_t(n);
  }
  heard_.append(chunk.data(), count);
  return count > 0;
}

Status TableLine::drain() {
  const double answer_due_s = std::max(0.0, last_sent_s_ + settings_.reply_timeout_s - monotonic_s());
  const Deadline limit(answer_due_s + longest_drain * settings_.quiet_s);
  double quiet_since_s = monotonic_s();
  while (monotonic_s() - quiet_since_s < settings_.quiet_s) {
    if (stop_.pending()) return given_up();
    if (limit.passed()) return hang_up("the line does not fall silent");
    stop_.look_away();
    if (TRY(receive(slice_s))) quiet_since_s = monotonic_s();
    heard_.clear();
  }
  stale_ = false;
  return {};
}

Status TableLine::send(const std::string& bytes) {
  last_sent_s_ = last_activity_s_ = monotonic_s();
  if (!settings_.tcp) return port_.write_all(bytes, write_timeout_s);
  const ssize_t n = ::send(descriptor_, bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
  if (n < 0) return hang_up(std::string("cannot send: ") + std::strerror(errno));
  return n == static_cast<ssize_t>(bytes.size()) ? Status() : hang_up("cannot send a whole request");
}

Result<std::string> TableLine::await(const TableRequest& request, const LineCodec& codec, const Deadline& deadline,
                                     bool at_once) {
  double last_growth_s = monotonic_s();
  for (;;) {
    if (const auto end = codec.reply_end(request, heard_, at_once)) {
      std::string reply = heard_.substr(0, *end);
      heard_.erase(0, *end);
      last_activity_s_ = monotonic_s();
      return reply;
    }
    const auto trouble = [this](const Error& error) {
      stale_ = true;
      last_activity_s_ = monotonic_s();
      return error;
    };
    if (heard_.size() > longest_reply)
      return trouble(failure(fmt::format("rubbish: no end of an answer in {} characters", heard_.size())));
    if (!at_once && stop_.pending()) return trouble(given_up());
    const bool frames = settings_.byte_timeout_s > 0.0;
    if (frames && !heard_.empty() && monotonic_s() - last_growth_s >= settings_.byte_timeout_s)
      return trouble(failure("the reply broke off"));
    if (deadline.passed()) {
      const double awaited_s = at_once ? stop_ack_s : settings_.reply_timeout_s;
      return trouble(failure(frames && !heard_.empty()
                                 ? "the reply broke off"
                                 : fmt::format("no answer within {} ms{}", int(1e3 * awaited_s),
                                               heard_.empty() ? "" : ", only '" + visible(heard_) + "'")));
    }
    if (!at_once) stop_.look_away();
    if (TRY(receive(std::min(slice_s, deadline.left_s())))) last_growth_s = monotonic_s();
  }
}

Judgement TableLine::exchange(const TableRequest& request, LineCodec& codec, AxisReading* reading) {
  if (!is_open()) return failure("not open");
  if (stop_.pending()) return given_up();
  if (!stop_.pause(last_activity_s_ + settings_.gap_s - monotonic_s())) return given_up();
  TRY(receive(0.0));  // after the pause: a repeated reply could answer this request
  if (codec.has_unexpected(heard_)) stale_ = true;
  if (stale_) TRY(drain());
  TRY(send(request.bytes));
  const std::string reply = TRY(await(request, codec, Deadline(settings_.reply_timeout_s), false));
  TRY(receive(0.0));
  const Judgement judgement = codec.decode(request, reply, heard_, reading);
  stale_ = judgement.stale;
  return judgement;
}

Status TableLine::send_at_once(const TableRequest& request, LineCodec& codec, bool awaits) {
  if (!is_open()) return failure("not open");
  TRY(send(request.bytes));
  if (!request.answered || !awaits) {
    stale_ = true;  // the answer to an interrupted request may still come
    return awaits ? Status() : failure("not awaited");
  }
  const Deadline deadline(stop_ack_s);
  do {
    if (codec.acknowledges(request, TRY(await(request, codec, deadline, true)))) return {};
    stale_ = true;
  } while (!deadline.passed());
  return failure("no acknowledgement");
}

}  // namespace turncal
