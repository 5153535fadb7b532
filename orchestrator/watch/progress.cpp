#include "orchestrator/watch/progress.h"

#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstddef>
#include <cstdlib>
#include <cstring>

#include "imu_io/base/clock.h"

namespace turncal {

namespace {

std::string head_of(const RunSnapshot& at) {
  return fmt::format("{} {:11.3f} s  step {}/{}  ", format_utc(at.utc_s), at.time_s, at.step_place, at.step_count);
}

const int colours = std::ios_base::xalloc();

std::string_view variable(const char* name) {
  const char* const value = std::getenv(name);
  return value == nullptr ? "" : value;
}

}  // namespace

std::string format_transition(const TransitionRecord& record) {
  const RunSnapshot& at = record.at;
  std::string text = head_of(at) + std::string(to_string(record.from));
  if (record.to != record.from) text += fmt::format(" -> {}", to_string(record.to));
  text += fmt::format("  {}{}", to_string(record.event), record.unexpected ? " (unexpected)" : "");
  if (!record.detail.empty())
    text += ": " + record.detail;
  else if (at.axis)
    text += fmt::format(": {} at {:.4f} deg", to_string(*at.axis), at.position_deg[*at.axis]);
  if (record.to == RunState::stopping || is_final(record.to)) text += fmt::format("; table {}", to_string(at.table));
  return text;
}

std::string format_dropout(const Dropout& dropout) {
  return head_of(dropout.at) + dropout_words(dropout.serial, dropout.why);
}

Result<RunLog> RunLog::create(const std::string& path, std::string tag) {
  return RunLog(TRY(PosixFile::create_new(path)), std::move(tag));
}

Result<RunLog> RunLog::append(const std::string& path, std::string tag) {
  if (!path_exists(path)) return create(path, std::move(tag));
  PosixFile file = TRY(PosixFile::open_to_change(path));
  const std::uint64_t size = TRY(file.size());
  TRY(file.seek(size));
  RunLog log(std::move(file), std::move(tag));
  if (size > 0) log.status_ = log.file_.write_all(std::string_view("\n"));  // the last line may be torn
  return log;
}

void RunLog::line(const std::string& text) {
  if (status_) status_ = file_.write_all(std::string_view(tag_ + text + "\n"));
}

bool waits_for_operator(const RunSnapshot& s, bool by_hand) {
  return by_hand && (s.state == RunState::moving || s.state == RunState::homing);
}

std::string phase_words(const RunSnapshot& s, bool by_hand) {
  if (s.state == RunState::dwelling && s.dwell_kind)
    return (*s.dwell_kind == SegmentKind::align ? "align" : "dwell") +
           (s.repeats > 0 ? fmt::format(" (repeat {})", s.repeats) : "");
  if (s.state == RunState::resting)
    return s.chamber.empty() ? "resting after the interruption" : "resting: " + s.chamber;
  if (waits_for_operator(s, by_hand))
    return s.axis ? fmt::format("turn {} to {:.2f} deg", to_string(*s.axis), s.target_deg) : "where the table stands";
  return state_words(to_string(s.state));
}

std::string format_duration(double seconds) {
  const long long whole = std::llround(std::max(0.0, seconds));
  return fmt::format("{}:{:02}:{:02}", whole / 3600, whole / 60 % 60, whole % 60);
}

std::string clock_time(double seconds) { return std::isfinite(seconds) ? format_duration(seconds) : "-"; }

std::string format_progress(const RunSnapshot& s) {
  const AxisTriple& at = s.position_deg;
  const std::string angles =
      s.axis ? fmt::format("{} {:.2f} -> {:.2f} deg", to_string(*s.axis), at[*s.axis], s.target_deg)
             : fmt::format("H {:.2f} P {:.2f} R {:.2f} deg", at[Axis::heading], at[Axis::pitch], at[Axis::roll]);
  // The end may be cut on a narrow terminal.
  return fmt::format("{:3.0f}%, {} left  step {}/{}  {} {:3.0f}%  {}", 100.0 * s.run_fraction, format_duration(s.eta_s),
                     s.step_place, s.step_count, phase_words(s, false), 100.0 * s.phase_fraction, angles) +
         (s.chamber.empty() || s.state == RunState::resting ? "" : "  " + s.chamber);
}

double wall_utc_s() {
  return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
}

bool stdout_takes_more() {
  return wait_ready(STDOUT_FILENO, POLLOUT, 0) != 0;  // with the reader gone, writing fails at once and does not wait
}

void ProgressPrinter::on_transition(const TransitionRecord& record) {
  if (!takes_more_() || !(transitions_ || record.event == RunEvent::pause_wanted)) return;
  clear();
  const bool waits = record.event == RunEvent::pause_wanted && record.to == record.from;
  out_ << (transitions_ ? format_transition(record) : record.detail) << (waits ? "; Ctrl-C again stops now" : "")
       << std::endl;
}

void ProgressPrinter::on_dropout(const Dropout& dropout) {
  if (!takes_more_()) return;
  clear();
  out_ << format_dropout(dropout) << std::endl;
}

void ProgressPrinter::on_progress(const RunSnapshot& snapshot) {
  constexpr double redraw_interval_s = 0.1;
  if (columns_ == 0) return;
  const double now_s = wall_s_();
  if (now_s - drawn_s_ < redraw_interval_s || !takes_more_()) return;
  drawn_s_ = now_s;
  line_shown_ = true;
  // A wrapped line could not be redrawn in place.
  std::string line = format_progress(snapshot);
  line.resize(std::min(line.size(), std::size_t(columns_ - 1)));
  out_ << '\r' << line << "\x1b[K" << std::flush;
}

void ProgressPrinter::clear() {
  if (!line_shown_ || !takes_more_()) return;
  line_shown_ = false;
  out_ << "\x1b[2K\r" << std::flush;
}

Tone tone_of(UnitVerdict verdict) {
  if (!is_accepted(verdict)) return Tone::bad;
  return verdict == UnitVerdict::conditional_pass ? Tone::attention : Tone::good;
}

void allow_colour(std::ostream& out, int descriptor) {
  out.iword(colours) = ::isatty(descriptor) == 1 && variable("NO_COLOR").empty() && variable("TERM") != "dumb" ? 1 : 0;
}

std::string in_tone(std::ostream& out, Tone tone, std::string_view text) {
  constexpr std::array<const char*, 3> codes = {"\x1b[32m", "\x1b[33m", "\x1b[31m"};
  if (out.iword(colours) == 0) return std::string(text);
  return codes[std::size_t(tone)] + std::string(text) + "\x1b[0m";
}

ServiceWatch::ServiceWatch() {
  const char* const name = std::getenv("NOTIFY_SOCKET");
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  const std::size_t length = name == nullptr ? 0 : std::strlen(name);
  if (length < 2 || length >= sizeof address.sun_path) return;
  std::memcpy(address.sun_path, name, length);
  if (name[0] == '@') address.sun_path[0] = '\0';  // abstract socket
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
