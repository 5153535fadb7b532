#include "orchestrator/watch/progress.h"

#include <poll.h>
#include <unistd.h>

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>

#include "imu_io/base/clock.h"

namespace turncal {

namespace {

std::string head_of(const RunSnapshot& at) {
  return fmt::format("{} {:11.3f} s  step {}/{}  ", format_utc(at.utc_s), at.time_s, at.step_place, at.step_count);
}

}  // namespace

std::string format_transition(const TransitionRecord& record) {
  const RunSnapshot& at = record.at;
  std::string text = head_of(at);
  text += to_string(record.from);
  if (record.to != record.from) {
    text += " -> ";
    text += to_string(record.to);
  }
  text += "  ";
  text += to_string(record.event);
  if (record.unexpected) text += " (unexpected)";
  if (!record.detail.empty()) {
    text += ": " + record.detail;
  } else if (at.axis) {
    text += fmt::format(": {} at {:.4f} deg", to_string(*at.axis), at.position_deg[*at.axis]);
  }
  if (record.to == RunState::stopping || is_final(record.to)) text += std::string("; table ") + to_string(at.table);
  return text;
}

std::string format_dropout(const Dropout& dropout) {
  return head_of(dropout.at) + "unit " + dropout.serial + " dropped out at " + dropout.why.message;
}

Result<RunLog> RunLog::create(const std::string& path, std::string tag) {
  PosixFile file = TRY(PosixFile::create_new(path));
  return RunLog(std::move(file), std::move(tag));
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

namespace {

constexpr double redraw_interval_s = 0.1;

}  // namespace

bool waits_for_operator(const RunSnapshot& s, bool by_hand) {
  return by_hand && (s.state == RunState::moving || s.state == RunState::homing);
}

std::string phase_words(const RunSnapshot& s, bool by_hand) {
  if (s.state == RunState::dwelling && s.dwell_kind) {
    std::string text = *s.dwell_kind == SegmentKind::align ? "align" : "dwell";
    if (s.repeats > 0) text += " (repeat " + std::to_string(s.repeats) + ")";
    return text;
  }
  if (s.state == RunState::resting)
    return s.chamber.empty() ? "resting after the interruption" : "resting: " + s.chamber;
  if (waits_for_operator(s, by_hand)) {
    if (!s.axis) return "where the table stands";
    return fmt::format("turn {} to {:.2f} deg", to_string(*s.axis), s.target_deg);
  }
  return std::string(to_string(s.state));
}

std::string format_duration(double seconds) {
  const long long whole = std::llround(std::max(0.0, seconds));
  return fmt::format("{}:{:02}:{:02}", whole / 3600, whole / 60 % 60, whole % 60);
}

std::string format_progress(const RunSnapshot& s) {
  const AxisTriple& at = s.position_deg;
  const std::string angles =
      s.axis ? fmt::format("{} {:.2f} -> {:.2f} deg", to_string(*s.axis), at[*s.axis], s.target_deg)
             : fmt::format("H {:.2f} P {:.2f} R {:.2f} deg", at[Axis::heading], at[Axis::pitch], at[Axis::roll]);
  return fmt::format("step {}/{}  {}  {} {:3.0f}%  run {:3.0f}%  ETA {}", s.step_place, s.step_count,
                     phase_words(s, false), angles, 100.0 * s.phase_fraction, 100.0 * s.run_fraction,
                     format_duration(s.eta_s)) +
         (s.chamber.empty() || s.state == RunState::resting ? "" : "  " + s.chamber);
}

double wall_utc_s() {
  return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
}

bool stdout_takes_more() {
  return wait_ready(STDOUT_FILENO, POLLOUT, 0) != 0;  // a reader that is gone is an error at once, and no wait
}

ProgressPrinter::ProgressPrinter(std::ostream& out, int columns, bool transitions, std::function<double()> wall_s,
                                 std::function<bool()> takes_more)
    : out_(out),
      columns_(columns),
      transitions_(transitions),
      wall_s_(std::move(wall_s)),
      takes_more_(std::move(takes_more)) {}

void ProgressPrinter::on_transition(const TransitionRecord& record) {
  if (!takes_more_() || !(transitions_ || record.event == RunEvent::pause_wanted)) return;
  clear();
  out_ << (transitions_ ? format_transition(record) : record.detail) << std::endl;
}

void ProgressPrinter::on_dropout(const Dropout& dropout) {
  if (!takes_more_()) return;
  clear();
  out_ << format_dropout(dropout) << std::endl;
}

void ProgressPrinter::on_progress(const RunSnapshot& snapshot) {
  if (columns_ == 0) return;
  const double now_s = wall_s_();
  if (now_s - drawn_s_ < redraw_interval_s || !takes_more_()) return;
  drawn_s_ = now_s;
  line_shown_ = true;
  // A line that wraps could not be redrawn in place.
  std::string line = format_progress(snapshot);
  line.resize(std::min(line.size(), static_cast<std::size_t>(columns_ - 1)));
  out_ << '\r' << line << "\x1b[K" << std::flush;
}

void ProgressPrinter::clear() {
  if (!line_shown_ || !takes_more_()) return;
  line_shown_ = false;
  out_ << "\x1b[2K\r" << std::flush;
}

namespace {

const int colours = std::ios_base::xalloc();

std::string_view variable(const char* name) {
  const char* const value = std::getenv(name);
  return value == nullptr ? "" : value;
}

}  // namespace

const char* to_string(Tone tone) { return tone == Tone::good ? "good" : tone == Tone::attention ? "attention" : "bad"; }

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
  return codes[static_cast<std::size_t>(tone)] + std::string(text) + "\x1b[0m";
}

}  // namespace turncal
