#include "turntable_drivers/modbus/modbus_link.h"

#include <fcntl.h>
#include <modbus/modbus.h>
#include <poll.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>

#include "imu_io/base/clock.h"
#include "imu_io/lines/serial_port.h"
#include "imu_io/lines/tcp_connection.h"

namespace turncal {
namespace {

constexpr int byte_poll_ms = 1;               // while the rest of a frame comes in
constexpr double busy_pause_s = 0.05;         // before a busy drive is asked again
constexpr std::uint32_t read_out_us = 20000;  // libmodbus is called when the frame is there; this only bounds a mistake
constexpr std::uint16_t most_repeated = 1000;  // a reply to one of so many transactions may come again
constexpr int most_at_a_time = 256;
constexpr double longest_drain = 2.0;  // times quiet_s, once no answer can come any more: then nobody can be understood

const char* exception_text(int exception) {
  switch (exception) {
    case 1: return "illegal function";
    case 2: return "illegal data address";
    case 3: return "illegal data value";
    case 4: return "device failure";
    case 5: return "acknowledged, still at work";
    case 6: return "busy";
    case 10: return "gateway path unavailable";
    case 11: return "device behind the gateway does not answer";
    default: return "unknown";
  }
}

void append_word(std::vector<std::uint8_t>& bytes, int word) {
  bytes.push_back(static_cast<std::uint8_t>(word >> 8));
  bytes.push_back(static_cast<std::uint8_t>(word));
}

std::string place(int unit, int address) {
  return "unit " + std::to_string(unit) + " register " + std::to_string(address);
}

// function 6 or 16
std::vector<std::uint8_t> write_request(int unit, int function, int address, std::span<const std::uint16_t> values) {
  std::vector<std::uint8_t> body = {static_cast<std::uint8_t>(unit), static_cast<std::uint8_t>(function)};
  append_word(body, address);
  if (function == 16) {
    append_word(body, static_cast<int>(values.size()));
    body.push_back(static_cast<std::uint8_t>(2 * values.size()));
  }
  for (const std::uint16_t value : values) append_word(body, value);
  return body;
}

}  // namespace

ModbusLink::ModbusLink(ModbusLinkSettings settings, const StopSignal& stop)
    : settings_(std::move(settings)), stop_(stop) {}

ModbusLink::~ModbusLink() { close(); }

void ModbusLink::close() {
  if (context_ == nullptr) return;
  if (descriptor_ >= 0) modbus_close(context_);
  modbus_free(context_);
  context_ = nullptr;
  descriptor_ = -1;
}

Status ModbusLink::open() {
  close();
  lost_ = false;
  stale_ = false;
  transaction_ = 0;
  const std::string& address = settings_.address;
  const auto failure = [&](const std::string& why) { return device_error(address + ": " + why); };
  if (settings_.tcp) {
    const int socket = TRY(connect_tcp(address, settings_.response_timeout_s, stop_.giving_up()));
    // A context for a device that is never opened: the socket takes its place.
    context_ = settings_.rtu_frames ? modbus_new_rtu("/dev/null", 9600, 'N', 8, 1) : modbus_new_tcp(nullptr, 0);
    if (context_ != nullptr) {
      modbus_set_socket(context_, socket);
    } else {
      ::close(socket);
    }
  } else {
    if (address.empty()) return input_error("link.address: expected a serial device");
    const char parity = settings_.serial.parity == SerialParity::none   ? 'N'
                        : settings_.serial.parity == SerialParity::even ? 'E'
                                                                        : 'O';
    context_ =
        modbus_new_rtu(address.c_str(), static_cast<int>(settings_.serial.baud), parity, 8, settings_.serial.stop_bits);
  }
  if (context_ == nullptr) return failure(std::string("not usable: ") + modbus_strerror(errno));
  modbus_set_error_recovery(context_, MODBUS_ERROR_RECOVERY_NONE);
  modbus_set_slave(context_, 1);
  if (!settings_.tcp && modbus_connect(context_) != 0) {
    const int number = errno;
    const std::string why = modbus_strerror(number) + access_advice(address, number);
    close();
    return failure("cannot open: " + why);
  }
  descriptor_ = modbus_get_socket(context_);
  if (!settings_.tcp && ::flock(descriptor_, LOCK_EX | LOCK_NB) != 0) {
    close();
    return failure("in use by another process");
  }
  ::fcntl(descriptor_, F_SETFD, FD_CLOEXEC);
  modbus_set_response_timeout(context_, 0, read_out_us);
  modbus_set_byte_timeout(context_, 0, read_out_us);
  discard_pending();
  last_activity_s_ = monotonic_s();
  return {};
}

ModbusLink::Reply ModbusLink::hang_up(const std::string& detail) {
  close();
  lost_ = true;
  lost_reason_ = detail;
  return {Failure::hang_up, 0, detail, {}};
}

bool ModbusLink::discard_unexpected() {
  constexpr std::size_t header_bytes = 6;
  int waiting = 0;
  // A line that is never empty does not hold up whoever reads it.
  for (int frames = 0;
       frames < most_at_a_time && settings_.header() && ::ioctl(descriptor_, FIONREAD, &waiting) == 0 && waiting > 0;
       ++frames) {
    std::array<std::uint8_t, MODBUS_TCP_MAX_ADU_LENGTH> next{};
    const ssize_t n = ::recv(descriptor_, next.data(), next.size(), MSG_PEEK | MSG_DONTWAIT);
    if (n <= 0) return false;
    // The rest comes: it is skipped by its number when the next reply is read.
    if (n < static_cast<ssize_t>(header_bytes)) return false;
    const auto number = static_cast<std::uint16_t>(next[0] << 8 | next[1]);
    const std::size_t whole = header_bytes + static_cast<std::size_t>(next[4] << 8 | next[5]);
    const bool answers_an_earlier_one = static_cast<std::uint16_t>(transaction_ - number) < most_repeated;
    if (next[2] != 0 || next[3] != 0 || whole <= header_bytes || whole > next.size() || !answers_an_earlier_one) break;
    if (static_cast<std::size_t>(n) < whole) return false;
    if (::recv(descriptor_, next.data(), whole, MSG_DONTWAIT) <= 0) return false;
  }
  return discard_pending();
}

bool ModbusLink::discard_pending() {
  std::array<std::uint8_t, 512> rubbish;
  bool any = false;
  int waiting = 0;
  for (int reads = 0; reads < most_at_a_time && ::ioctl(descriptor_, FIONREAD, &waiting) == 0 && waiting > 0; ++reads) {
    const ssize_t n =
        ::read(descriptor_, rubbish.data(), std::min<std::size_t>(rubbish.size(), static_cast<std::size_t>(waiting)));
    if (n <= 0) break;
    any = true;
  }
  return any;
}

ModbusLink::Reply ModbusLink::drain() {
  const double answer_due_s = std::max(0.0, last_sent_s_ + settings_.response_timeout_s - monotonic_s());
  const Deadline limit(answer_due_s + longest_drain * settings_.quiet_s);
  double quiet_since_s = monotonic_s();
  while (monotonic_s() - quiet_since_s < settings_.quiet_s) {
    if (stop_.pending()) return {Failure::interrupted, 0, "", {}};
    if (limit.passed()) return hang_up("the line does not fall silent");
    stop_.look_away();
    pollfd which{descriptor_, POLLIN, 0};
    const int n = ::poll(&which, 1, StopSignal::longest_look_away_ms);
    if (n <= 0) continue;
    if (!discard_pending()) return hang_up("the other end hung up");
    quiet_since_s = monotonic_s();
  }
  stale_ = false;
  return {};
}

ModbusLink::Reply ModbusLink::send(std::span<const std::uint8_t> body) {
  last_sent_s_ = monotonic_s();
  if (settings_.header()) {
    // libmodbus's raw requests all carry transaction 0, so the seven bytes before the PDU are made here.
    std::vector<std::uint8_t> frame;
    append_word(frame, ++transaction_);
    append_word(frame, 0);
    append_word(frame, static_cast<int>(body.size()));
    frame.insert(frame.end(), body.begin(), body.end());
    const ssize_t n = ::send(descriptor_, frame.data(), frame.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
    if (n == static_cast<ssize_t>(frame.size())) return {};
    return hang_up(n < 0 ? std::string("cannot send: ") + std::strerror(errno) : "cannot send a whole request");
  }
  if (modbus_send_raw_request(context_, const_cast<std::uint8_t*>(body.data()), static_cast<int>(body.size())) > 0)
    return {};
  return hang_up(std::string("cannot send: ") + modbus_strerror(errno));
}

ModbusLink::Reply ModbusLink::await(std::size_t bytes, double timeout_s, bool at_once) {
  const Deadline deadline(timeout_s);
  int seen = 0;
  double last_growth_s = monotonic_s();
  for (;;) {
    if (!at_once && stop_.pending()) {
      stale_ = true;
      return {Failure::interrupted, 0, "", {}};
    }
    if (!at_once) stop_.look_away();
    if (seen == 0) {
      pollfd which{descriptor_, POLLIN, 0};
      const int n = ::poll(&which, 1, std::min(deadline.left_ms(), StopSignal::longest_look_away_ms));
      if (n < 0 && errno != EINTR) return hang_up(std::strerror(errno));
      int waiting = 0;
      if (n > 0 && (::ioctl(descriptor_, FIONREAD, &waiting) != 0 || waiting == 0))
        return hang_up("the other end hung up");
      if (waiting == 0 && deadline.passed()) {
        stale_ = true;
        return {
            Failure::timeout, 0, "no answer within " + std::to_string(static_cast<int>(1e3 * timeout_s)) + " ms", {}};
      }
    }
    int waiting = 0;
    ::ioctl(descriptor_, FIONREAD, &waiting);
    if (waiting > seen) {
      seen = waiting;
      last_growth_s = monotonic_s();
    }
    if (static_cast<std::size_t>(seen) >= bytes) return {};
    if (seen == 0) continue;
    // An exception is shorter than what was asked for, and so is a frame that broke off: silence tells.
    if (monotonic_s() - last_growth_s >= settings_.byte_timeout_s || deadline.passed()) return {};
    ::poll(nullptr, 0, byte_poll_ms);
  }
}

ModbusLink::Reply ModbusLink::receive(std::span<const std::uint8_t> request) {
  modbus_set_slave(context_, request[0]);
  std::array<std::uint8_t, MODBUS_TCP_MAX_ADU_LENGTH> frame{};
  const int n = modbus_receive_confirmation(context_, frame.data());
  if (n < 0) {
    if (errno == ECONNRESET || errno == EBADF || errno == EIO || errno == ENODEV || errno == ENXIO) {
      return hang_up("the other end hung up");
    }
    return {Failure::garbled, 0, errno == ETIMEDOUT ? "the reply broke off" : modbus_strerror(errno), {}};
  }
  const auto header = static_cast<std::size_t>(modbus_get_header_length(context_));
  const std::size_t tail = settings_.header() ? 0 : 2;
  const auto length = static_cast<std::size_t>(n);
  if (length < header + 1 + tail) return {Failure::garbled, 0, "the reply of another unit, or rubbish", {}};
  Reply reply;
  // libmodbus counts the unit into the header: 7 bytes over TCP, 1 over RTU.
  reply.body.assign(frame.begin() + static_cast<std::ptrdiff_t>(header - 1),
                    frame.begin() + static_cast<std::ptrdiff_t>(length - tail));
  if (settings_.header() && (frame[2] != 0 || frame[3] != 0)) {
    reply.failure = Failure::garbled;
    reply.detail = "protocol " + std::to_string(frame[2] << 8 | frame[3]) + " answered, not Modbus";
  } else if (settings_.header() && (frame[0] << 8 | frame[1]) != transaction_) {
    reply.failure = Failure::garbled;
    reply.detail = "the reply of an earlier transaction";
  } else if (reply.body[0] != request[0]) {
    reply.failure = Failure::garbled;
    reply.detail = "unit " + std::to_string(reply.body[0]) + " answered";
  } else if (reply.body[1] == (request[1] | 0x80) && reply.body.size() == 3) {
    reply.failure = Failure::exception;
    reply.exception = reply.body[2];
  } else if (reply.body[1] != request[1]) {
    reply.failure = Failure::garbled;
    reply.detail = "the reply to another function";
  }
  return reply;
}

ModbusLink::Reply ModbusLink::transact(std::span<const std::uint8_t> body, std::size_t reply_length, double timeout_s,
                                       bool at_once) {
  if (context_ == nullptr) return {Failure::hang_up, 0, "not open", {}};
  if (!at_once) {
    if (stop_.pending()) return {Failure::interrupted, 0, "", {}};
    if (discard_unexpected()) stale_ = true;
    if (stale_) {
      if (Reply reply = drain(); reply.failure != Failure::none) return reply;
    }
    if (!stop_.pause(last_activity_s_ + settings_.gap_s - monotonic_s())) return {Failure::interrupted, 0, "", {}};
  } else if (settings_.header()) {
    discard_pending();
  }
  if (Reply reply = send(body); reply.failure != Failure::none) return reply;
  const std::size_t around = settings_.header() ? 6 : 2;
  const Deadline deadline(timeout_s);
  for (;;) {
    Reply waited = await(around + reply_length, deadline.left_s(), at_once);
    last_activity_s_ = monotonic_s();
    if (waited.failure != Failure::none) return waited;
    Reply reply = receive(body);
    if (reply.failure == Failure::hang_up) return reply;
    const bool is_read = body[1] == 3 || body[1] == 4;
    if (reply.failure == Failure::none) {
      const bool same =
          is_read ? reply.body.size() == reply_length && reply.body[2] == reply_length - 3
                  : reply.body.size() == 6 && std::equal(reply.body.begin() + 2, reply.body.end(), body.begin() + 2);
      if (!same) {
        reply.failure = Failure::garbled;
        reply.detail = "the reply to another request";
      }
    }
    if (reply.failure == Failure::garbled) {
      stale_ = true;
      // What is left of an earlier request: the transaction number, or the hurry, tells that ours is still to come.
      const bool ours_may_come =
          at_once || (settings_.header() && reply.detail == "the reply of an earlier transaction");
      if (ours_may_come && !deadline.passed()) continue;
      return reply;
    }
    if (!at_once && discard_unexpected()) {
      stale_ = true;
      return {Failure::garbled, 0, "bytes after the reply", {}};
    }
    // Over TCP the transaction number has told which reply this is.
    if (settings_.header()) stale_ = false;
    return reply;
  }
}

Error ModbusLink::error_of(const Reply& reply, const std::string& what) const {
  const std::string where = settings_.address + ": " + what + ": ";
  switch (reply.failure) {
    case Failure::interrupted: return {ErrorKind::aborted, where + "given up for a stop"};
    case Failure::exception: {
      const std::string text =
          where + "exception " + std::to_string(reply.exception) + " (" + exception_text(reply.exception) + ")";
      return reply.exception >= 1 && reply.exception <= 3 ? input_error(text + ": expected a map that fits the drive")
                                                          : device_error(text);
    }
    default: return device_error(where + reply.detail);
  }
}

Status ModbusLink::read(int unit, int function, int address, std::span<std::uint16_t> out) {
  std::vector<std::uint8_t> body = {static_cast<std::uint8_t>(unit), static_cast<std::uint8_t>(function)};
  append_word(body, address);
  append_word(body, static_cast<int>(out.size()));
  const std::string what = "reading " + place(unit, address);
  Reply reply;
  for (int i = 0; i <= settings_.read_retries; ++i) {
    reply = transact(body, 3 + 2 * out.size(), settings_.response_timeout_s, false);
    if (reply.failure == Failure::none) {
      for (std::size_t k = 0; k < out.size(); ++k) {
        out[k] = static_cast<std::uint16_t>(reply.body[3 + 2 * k] << 8 | reply.body[4 + 2 * k]);
      }
      return {};
    }
    if (reply.failure == Failure::interrupted || reply.failure == Failure::hang_up) return error_of(reply, what);
    if (reply.failure == Failure::exception) {
      if (reply.exception <= 4 || reply.exception == 7 || reply.exception == 8) return error_of(reply, what);
      if (!stop_.pause(busy_pause_s)) return error_of({Failure::interrupted, 0, "", {}}, what);
    }
  }
  // A drive that answers, if only that it is busy, is not lost.
  const Error error = error_of(reply, what);
  if (reply.failure != Failure::exception || reply.exception >= 10) {
    lost_ = true;
    lost_reason_ = error.message;
  }
  return error;
}

Status ModbusLink::write_with(std::span<const std::uint8_t> body, double timeout_s, bool at_once,
                              const std::string& what) {
  const Reply reply = transact(body, 6, timeout_s, at_once);
  if (reply.failure == Failure::none) return {};
  return error_of(reply, what);
}

Status ModbusLink::write(int unit, int function, int address, std::span<const std::uint16_t> values) {
  return write_with(write_request(unit, function, address, values), settings_.response_timeout_s, false,
                    "writing " + place(unit, address));
}

Status ModbusLink::write_at_once(int unit, int function, int address, std::span<const std::uint16_t> values,
                                 double timeout_s) {
  return write_with(write_request(unit, function, address, values), timeout_s, true, "writing " + place(unit, address));
}

}  // namespace turncal
