#include "turntable_drivers/manual_turntable.h"

#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <limits>

#include "imu_io/format_number.h"
#include "imu_io/text_pieces.h"
#include "turntable_drivers/register_words.h"
#include "turntable_drivers/sentence.h"

namespace turncal {
namespace {

constexpr double pi = 3.14159265358979323846;
constexpr std::size_t longest_line = 1000;

std::size_t index(Axis axis) { return static_cast<std::size_t>(axis); }

std::string shown(double angle_deg) {
  char text[40];
  std::snprintf(text, sizeof text, "%.4g", std::abs(angle_deg) < 1e-9 ? 0.0 : angle_deg);
  return text;
}

std::string exact(double angle_deg) { return format_number(angle_deg); }

}  // namespace

ManualTurntable::ManualTurntable(ManualSettings settings, const Clock& clock, int input, std::ostream& out, GravitySense sense)
    : settings_(settings), clock_(clock), input_(input), out_(out), sense_(std::move(sense)) {}

void ManualTurntable::say(const std::string& text) { out_ << text << std::endl; }

Status ManualTurntable::usable() {
  if (!connected_) return device_error("manual table: not connected");
  if (Status status = look_at_input(); !status) return status;
  if (aborted_) return Error{ErrorKind::aborted, "manual table: aborted by the operator"};
  if (ended_) return device_error("manual table: end of input: expected the operator's answers");
  return {};
}

std::optional<ManualTurntable::Wanted> ManualTurntable::wanted() const {
  if (queue_.empty()) return {};
  return queue_.front();
}

void ManualTurntable::ask() {
  if (queue_.empty()) return;
  const Wanted& now = queue_.front();
  const Hand& hand = hands_[index(now.axis)];
  asked_s_ = clock_.now_s();
  std::string text = std::string("\nTurn ") + to_string(now.axis) + " to " + exact(now.target_deg) + " deg";
  if (hand.known) {
    const double way_deg = now.target_deg - hand.position_deg;
    text += std::string(" (") + (way_deg >= 0.0 ? "+" : "") + shown(way_deg) + " deg from where it is)";
  }
  if (!now.why.empty()) text += ", for " + now.why;
  say(text + ".\nThen type the angle reached; or repeat, skip REASON, pause, abort.");
}

// ---- the operator's answers ----

Status ManualTurntable::look_at_input() {
  while (!ended_ && !aborted_) {
    pollfd which{input_, POLLIN, 0};
    const int n = ::poll(&which, 1, 0);
    if (n <= 0) break;
    char chunk[256];
    const ssize_t got = ::read(input_, chunk, sizeof chunk);
    if (got < 0 && (errno == EINTR || errno == EAGAIN)) break;
    if (got <= 0) {
      ended_ = true;
      queue_.clear();
      enabled_ = false;
      break;
    }
    typed_.append(chunk, static_cast<std::size_t>(got));
    for (std::size_t end; (end = typed_.find('\n')) != std::string::npos;) {
      const std::string line(trimmed(std::string_view(typed_).substr(0, end)));
      typed_.erase(0, end + 1);
      answer(line.ends_with('\r') ? line.substr(0, line.size() - 1) : line);
    }
    if (typed_.size() > longest_line) typed_.clear();
  }
  if (!queue_.empty() && !paused_ && clock_.now_s() - asked_s_ > settings_.answer_timeout_s) {
    paused_ = true;
    say("No answer for " + shown(settings_.answer_timeout_s) + " s: paused. Type continue to go on, or abort.");
  }
  return {};
}

void ManualTurntable::answer(const std::string& line) {
  if (aborted_ || line.empty()) return;
  const std::size_t blank = line.find(' ');
  std::string word = line.substr(0, blank);
  const std::string rest(blank == std::string::npos ? "" : trimmed(std::string_view(line).substr(blank)));
  std::transform(word.begin(), word.end(), word.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  const auto is = [&](const char* name) { return word == name || word == std::string(1, name[0]); };
  if (is("abort")) {
    aborted_ = true;
    enabled_ = false;
    queue_.clear();
    say("Aborted.");
  } else if (is("pause")) {
    paused_ = true;
    say("Paused. Type continue to go on, or abort.");
  } else if (is("continue")) {
    paused_ = false;
    ask();
  } else if (is("repeat")) {
    ask();
  } else if (queue_.empty()) {
    say("Nothing is asked for just now.");
  } else if (paused_) {
    say("Paused. Type continue first.");
  } else if (is("skip")) {
    if (rest.empty()) {
      say("Why? Type skip and the reason.");
      return;
    }
    skipped_ = rest;
    hands_[index(queue_.front().axis)].known = false;
    queue_.clear();
    say("Skipped: " + rest);
  } else {
    take_angle(line);
  }
}

void ManualTurntable::take_angle(const std::string& text) {
  const Wanted now = queue_.front();
  const std::optional<double> typed_deg = device_number(text);
  if (!typed_deg) {
    say(quoted(text) + " is not understood: expected an angle in degrees, repeat, skip REASON, pause or abort.");
    return;
  }
  const double angle_deg = unwrapped_deg(*typed_deg, now.target_deg, 360.0);
  const double away_deg = std::abs(angle_deg - now.target_deg);
  if (!(away_deg <= settings_.tolerance_deg + 1e-9)) {
    say(text + " is " + shown(away_deg) + " deg away from " + exact(now.target_deg) + ": expected at most " +
        shown(settings_.tolerance_deg) + ". Turn further, or type again.");
    return;
  }
  if (const auto objection = gravity_objection(now.axis, angle_deg)) {
    say(*objection);
    return;
  }
  hands_[index(now.axis)].position_deg = angle_deg;
  hands_[index(now.axis)].known = true;
  hands_[index(now.axis)].homed = hands_[index(now.axis)].homed || now.why == "homing";
  queue_.pop_front();
  ask();
}

std::optional<std::string> ManualTurntable::gravity_objection(Axis axis, double angle_deg) const {
  if (axis == Axis::heading || !sense_) return {};
  // The tilt follows from both angles; one that is not known yet cannot be checked against.
  const Axis other = axis == Axis::pitch ? Axis::roll : Axis::pitch;
  if (!hands_[index(other)].known) return {};
  const std::optional<std::array<double, 3>> sensed = sense_();
  if (!sensed) return {};
  const double other_deg = hands_[index(other)].position_deg;
  const double pitch = (axis == Axis::pitch ? angle_deg : other_deg) * pi / 180.0;
  const double roll = (axis == Axis::roll ? angle_deg : other_deg) * pi / 180.0;
  const std::array<double, 3> expected = {std::sin(pitch), std::cos(pitch) * std::cos(roll), -std::cos(pitch) * std::sin(roll)};
  double along = 0.0, squared = 0.0;
  for (std::size_t i = 0; i < 3; ++i) {
    along += expected[i] * (*sensed)[i];
    squared += (*sensed)[i] * (*sensed)[i];
  }
  if (!(squared > 0.0)) return "The unit senses no gravity: expected it to be on and still. Type the angle again.";
  const double away_deg = std::acos(std::clamp(along / std::sqrt(squared), -1.0, 1.0)) * 180.0 / pi;
  if (away_deg <= settings_.gravity_tolerance_deg) return {};
  return "The unit senses gravity " + shown(away_deg) + " deg away from where " + to_string(axis) + " " + exact(angle_deg) +
         " would put it: expected at most " + shown(settings_.gravity_tolerance_deg) + ". Is it the right axis and sense?";
}

// ---- the interface ----

Status ManualTurntable::connect() {
  connected_ = true;
  enabled_ = false;
  stopped_ = false;
  paused_ = false;
  queue_.clear();
  return usable();
}

Result<TableIdentity> ManualTurntable::identify() {
  if (Status status = usable(); !status) return status.error();
  return TableIdentity{"table turned by hand", false};
}

Status ManualTurntable::enable() {
  if (Status status = usable(); !status) return status;
  if (skipped_) return device_error("manual table: a move was skipped (" + *skipped_ + "): expected it cleared");
  enabled_ = true;
  return {};
}

Status ManualTurntable::home() {
  if (Status status = usable(); !status) return status;
  if (!enabled_) return device_error("manual table: home: not enabled");
  if (!queue_.empty()) return device_error("manual table: home: a move is under way");
  stopped_ = false;
  for (const Axis axis : {Axis::roll, Axis::pitch, Axis::heading}) {
    hands_[index(axis)] = {};
    queue_.push_back({axis, 0.0, "homing"});
  }
  ask();
  return {};
}

Status ManualTurntable::move_absolute(Axis axis, double position_deg, double rate_degps, double acceleration_degps2) {
  if (Status status = usable(); !status) return status;
  const auto refused = [&](const std::string& what) {
    return device_error(std::string("manual table: ") + to_string(axis) + ": " + what);
  };
  // Nobody turns by hand at a given rate, but what makes no sense is a mistake all the same.
  if (!std::isfinite(position_deg)) return refused("move to " + format_number(position_deg) + " deg: expected an angle");
  if (!(rate_degps > 0.0) || !std::isfinite(rate_degps) || !(acceleration_degps2 > 0.0) || !std::isfinite(acceleration_degps2)) {
    return refused("rate and acceleration: expected numbers above 0");
  }
  if (!enabled_) return refused("not enabled");
  if (skipped_) return refused("a move was skipped (" + *skipped_ + "): expected it cleared");
  if (!hands_[index(axis)].homed) return refused("not homed");
  for (const Wanted& wanted : queue_) {
    if (wanted.axis == axis) return refused("a move is under way: expected it finished or stopped");
  }
  stopped_ = false;
  queue_.push_back({axis, position_deg, reason_});
  if (queue_.size() == 1) ask();
  return {};
}

Status ManualTurntable::stop_all() {
  if (!connected_) return device_error("manual table: not connected");
  if (!queue_.empty()) {
    for (const Wanted& wanted : queue_) hands_[index(wanted.axis)].known = false;
    queue_.clear();
    say("STOP. Leave the table as it is.");
  }
  paused_ = false;
  stopped_ = true;
  return {};  // also when the operator is gone: nothing turns by itself
}

Status ManualTurntable::abort_all() {
  const Status status = stop_all();
  enabled_ = false;
  return status;
}

Status ManualTurntable::clear_fault() {
  if (Status status = usable(); !status) return status;
  skipped_.reset();
  return {};
}

Result<AxisStatus> ManualTurntable::status(Axis axis) {
  if (Status status = usable(); !status && !(connected_ && stopped_)) return status.error();
  const Hand& hand = hands_[index(axis)];
  AxisStatus report;
  report.position_deg = hand.position_deg;
  report.moving = std::any_of(queue_.begin(), queue_.end(), [axis](const Wanted& wanted) { return wanted.axis == axis; });
  report.rate_degps = report.moving ? std::numeric_limits<double>::quiet_NaN() : 0.0;
  report.enabled = enabled_;
  report.homed = hand.homed;
  report.in_position = hand.known && !report.moving;
  report.fault = skipped_.has_value();
  report.remote = true;
  report.time_s = clock_.now_s();
  if (skipped_) report.text = "skipped by the operator: " + *skipped_;
  if (paused_) report.text = "paused";
  return report;
}

}  // namespace turncal
