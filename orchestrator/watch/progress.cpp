#include "orchestrator/watch/progress.h"

#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>

#include "orchestrator/watch/run_log.h"

namespace turncal {

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
  if (s.state == RunState::resting) return "resting after the interruption";
  if (waits_for_operator(s, by_hand)) {
    if (!s.axis) return "where the table stands";
    char text[80];
    std::snprintf(text, sizeof text, "turn %s to %.2f deg", to_string(*s.axis), s.target_deg);
    return text;
  }
  return std::string(to_string(s.state));
}

std::string format_duration(double seconds) {
  const long long whole = std::llround(std::max(0.0, seconds));
  char text[40];
  std::snprintf(text, sizeof text, "%lld:%02lld:%02lld", whole / 3600, whole / 60 % 60, whole % 60);
  return text;
}

std::string format_progress(const RunSnapshot& s) {
  char angles[100];
  if (s.axis) {
    std::snprintf(angles, sizeof angles, "%s %.2f -> %.2f deg", to_string(*s.axis), s.position_deg[*s.axis],
                  s.target_deg);
  } else {
    std::snprintf(angles, sizeof angles, "H %.2f P %.2f R %.2f deg", s.position_deg[Axis::heading],
                  s.position_deg[Axis::pitch], s.position_deg[Axis::roll]);
  }
  char text[240];
  std::snprintf(text, sizeof text, "step %zu/%zu  %s  %s %3.0f%%  run %3.0f%%  ETA %s", s.step_place, s.step_count,
                phase_words(s, false).c_str(), angles, 100.0 * s.phase_fraction, 100.0 * s.run_fraction,
                format_duration(s.eta_s).c_str());
  return text;
}

double wall_utc_s() {
  return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
}

bool stdout_takes_more() {
  pollfd out{STDOUT_FILENO, POLLOUT, 0};
  return ::poll(&out, 1, 0) != 0;  // a reader that is gone is an error at once, and no wait
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

}  // namespace turncal
