// The dialogue of a ManualTurntable: what the operator is asked, what is made of the answer, and gravity's word on it.
#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cmath>
#include <cstdio>

#include "imu_io/base/format_number.h"
#include "imu_io/base/text_pieces.h"
#include "turntable_drivers/manual/manual_turntable.h"
#include "turntable_drivers/table/angle.h"

namespace turncal {
namespace {

constexpr double pi = 3.14159265358979323846;
constexpr std::size_t longest_line = 1000;
constexpr int rehearsal_wait_ms = 1000;
// The mean of gravity is of one second in halves that are complete: by then all of it is of after the answer.
constexpr double gravity_settle_s = 1.6;
constexpr double gravity_deadline_s = 10.0;

std::string shown(double angle_deg) {
  char text[40];
  std::snprintf(text, sizeof text, "%.4g", std::abs(angle_deg) < 1e-9 ? 0.0 : angle_deg);
  return text;
}

std::string exact(double angle_deg) { return format_number(angle_deg); }

std::optional<Axis> axis_named(const std::string& name) {
  for (const Axis axis : all_axes) {
    if (name == to_string(axis)) return axis;
  }
  return {};
}

}  // namespace

void ManualTurntable::ask() {
  if (queue_.empty() || paused_) return;
  const Wanted& now = queue_.front();
  const Hand& hand = hands_[index(now.axis)];
  asked_s_ = patience_s();
  std::string text = reason_.empty() || reason_told_ ? "" : "\n" + reason_ + "\n";
  reason_told_ = true;
  if (now.homing) {
    text += std::string("Where does ") + to_string(now.axis) +
            " stand? Turn it to 0 deg, or leave it; then type the angle that it shows";
  } else {
    const double way_deg = now.target_deg - hand.position_deg;
    text += std::string("Turn ") + to_string(now.axis) + (hand.known ? " from " + shown(hand.position_deg) : "") +
            " to " + exact(now.target_deg) + " deg";
    if (hand.known)
      text += ", " + shown(std::abs(way_deg)) + " deg " +
              (way_deg < 0.0 ? "backward (its angle falls)" : "forward (its angle grows)");
    text += "; then type the angle reached";
  }
  say(text + " (or repeat, skip REASON, pause, leave, abort, help).");
}

void ManualTurntable::look_at_input() {
  check_answer();
  // Of a rehearsal nothing is read that could not be taken: it is the answer to a later question.
  if (rehearsed_) {
    handle_lines();
    if (waits_for_answer() && read_input(true)) handle_lines();
    if (waits_for_answer() && input_ended_)
      end(ErrorKind::interrupted, "end of input: expected the operator's answers");
  } else {
    while (read_input(false)) handle_lines();
    if (input_ended_) end(ErrorKind::interrupted, "end of input: expected the operator's answers");
  }
  keep_limits();
}

bool ManualTurntable::read_input(bool wait) {
  if (input_ended_) return false;
  pollfd which{input_, POLLIN, 0};
  if (::poll(&which, 1, wait ? rehearsal_wait_ms : 0) <= 0) return false;
  char chunk[256];
  const ssize_t got = ::read(input_, chunk, sizeof chunk);
  if (got < 0 && (errno == EINTR || errno == EAGAIN)) return false;
  if (got <= 0) {
    input_ended_ = true;
    return false;
  }
  typed_.append(chunk, static_cast<std::size_t>(got));
  return true;
}

void ManualTurntable::handle_lines() {
  for (std::size_t at; (at = typed_.find('\n')) != std::string::npos && !end_ && (!rehearsed_ || waits_for_answer());) {
    const std::string line(trimmed(std::string_view(typed_).substr(0, at)));
    typed_.erase(0, at + 1);
    answer(line.ends_with('\r') ? line.substr(0, line.size() - 1) : line);
  }
  if (typed_.size() > longest_line && typed_.find('\n') == std::string::npos) typed_.clear();
}

void ManualTurntable::keep_limits() {
  if (!waits_for_answer()) return;
  if (!paused_ && patience_s() - asked_s_ > settings_.answer_timeout_s) {
    pause("No answer for " + shown(settings_.answer_timeout_s) + " s: paused.");
  } else if (paused_ && patience_s() - std::max(paused_s_, asked_s_) > settings_.pause_limit_s) {
    end(ErrorKind::interrupted, "paused for longer than " + shown(settings_.pause_limit_s) + " s");
  }
}

void ManualTurntable::pause(const std::string& why) {
  if (!paused_) paused_s_ = patience_s();
  paused_ = true;
  say(why + " Leave the table as it is. Type continue to go on; leave to end here and go on another day; or abort.");
}

void ManualTurntable::answer(const std::string& line) {
  if (line.empty()) return;
  const std::size_t blank = line.find(' ');
  std::string word = line.substr(0, blank);
  const std::string argument(blank == std::string::npos ? "" : trimmed(std::string_view(line).substr(blank)));
  std::transform(word.begin(), word.end(), word.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  const auto is = [&](const char* name) { return word == name || word == std::string(1, name[0]); };
  if (is("abort")) {
    end(ErrorKind::aborted, "aborted by the operator");
    enabled_ = false;
    say("Aborted.");
  } else if (is("leave")) {
    const bool asked = !queue_.empty();
    end(ErrorKind::interrupted, "the operator left");
    say(asked ? "The run ends here; everything is kept."
              : "The run ends when this dwell is complete; everything is kept.");
  } else if (is("pause")) {
    pause(queue_.empty() ? "Paused: what is under way continues, the next turn waits." : "Paused.");
  } else if (is("continue")) {
    paused_ = reason_told_ = false;
    ask();
  } else if (is("help")) {
    say("An angle in degrees: the axis asked for stands there, read off its dial, within " +
        shown(settings_.tolerance_deg) +
        " deg.\nrepeat: the question again.  skip REASON: it cannot be done; the run ends with that reason and can be "
        "resumed.\n"
        "pause: the table stays as it is until continue.  leave: the run ends here, to be resumed another day.\nabort: "
        "the run ends.");
    if (rehearsed_) say("turn AXIS ANGLE: turns any axis, answers nothing.  say ANGLE: answers, turns nothing.");
  } else if (is("repeat")) {
    reason_told_ = false;
    ask();
  } else if (queue_.empty()) {
    say("Nothing is asked for just now.");
  } else if (paused_) {
    say("Paused. Type continue first.");
  } else if (is("skip")) {
    if (argument.empty()) return say("Why? Type skip and the reason.");
    end(ErrorKind::interrupted, "skipped by the operator: " + argument);
    say("Skipped: " + argument);
  } else if (rehearsed_ && word == "turn") {
    turn_rehearsed(argument);
  } else if (rehearsed_ && word == "say") {
    handle_angle(argument, true);
  } else {
    handle_angle(line, false);
  }
}

void ManualTurntable::turn_rehearsed(const std::string& axis_and_angle) {
  const std::size_t blank = axis_and_angle.find(' ');
  const std::optional<Axis> axis = axis_named(axis_and_angle.substr(0, blank));
  const std::optional<double> angle_deg =
      device_number(blank == std::string::npos ? "" : axis_and_angle.substr(blank + 1));
  if (!axis || !angle_deg)
    return say(quoted(axis_and_angle) + ": expected an axis (heading, pitch or roll) and an angle");
  rehearsed_->turn(*axis, *angle_deg, queue_.front().rate_degps, queue_.front().acceleration_degps2);
}

void ManualTurntable::handle_angle(const std::string& text, bool turned) {
  const Wanted now = queue_.front();
  const std::optional<double> typed_deg = device_number(text);
  if (!typed_deg) {
    return say(quoted(text) +
               " is not understood: expected an angle in degrees, repeat, skip REASON, pause, leave, abort or help.");
  }
  if (answered_) return say("The answer before is still being compared with gravity.");
  const double angle_deg = now.homing ? *typed_deg : unwrapped_deg(*typed_deg, now.target_deg, 360.0);
  const double away_deg = std::abs(angle_deg - now.target_deg);
  if (!now.homing && !(away_deg <= settings_.tolerance_deg + 1e-9)) {
    return say(text + " is " + shown(away_deg) + " deg away from " + exact(now.target_deg) + ": expected at most " +
               shown(settings_.tolerance_deg) + ". Turn further, or type again.");
  }
  if (rehearsed_ && !turned) rehearsed_->turn(now.axis, angle_deg, now.rate_degps, now.acceleration_degps2);
  answered_ = Answer{angle_deg, clock_.now_s()};
  check_answer();
}

void ManualTurntable::check_answer() {
  if (!answered_) return;
  const double now_s = clock_.now_s();
  if (rehearsed_ && rehearsed_->moving()) {
    answered_->since_s = now_s;
    return;
  }
  const Axis axis = queue_.front().axis;
  // The tilt follows from both angles; one that is not known yet cannot be checked against.
  const Axis other = axis == Axis::pitch ? Axis::roll : Axis::pitch;
  if (axis == Axis::heading || !sense_ || !hands_[index(other)].known) return accept(answered_->angle_deg);
  if (now_s - answered_->since_s < gravity_settle_s) return;
  if (!sense_()) {
    if (now_s - answered_->since_s < gravity_deadline_s) return;
    answered_.reset();
    return say(
        "The unit is not still, or sends nothing: nothing to compare with. Type the angle again when it stands.");
  }
  if (const auto objection = gravity_objection(axis, answered_->angle_deg)) {
    answered_.reset();
    say(*objection);
    if (queue_.front().homing) {  // which of the two is wrong cannot be told
      hands_[index(other)] = {};
      queue_.push_front({.axis = other, .homing = true});
      ask();
    }
    return;
  }
  accept(answered_->angle_deg);
}

void ManualTurntable::accept(double angle_deg) {
  Hand& hand = hands_[index(queue_.front().axis)];
  hand.position_deg = angle_deg;
  hand.known = true;
  hand.homed = hand.homed || queue_.front().homing;
  answered_.reset();
  queue_.pop_front();
  ask();
}

std::optional<std::string> ManualTurntable::gravity_objection(Axis axis, double angle_deg) const {
  const Axis other = axis == Axis::pitch ? Axis::roll : Axis::pitch;
  const std::optional<std::array<double, 3>> sensed = sense_();
  const double other_deg = hands_[index(other)].position_deg;
  const double pitch = (axis == Axis::pitch ? angle_deg : other_deg) * pi / 180.0;
  const double roll = (axis == Axis::roll ? angle_deg : other_deg) * pi / 180.0;
  const std::array<double, 3> expected = {std::sin(pitch), std::cos(pitch) * std::cos(roll),
                                          -std::cos(pitch) * std::sin(roll)};
  double along = 0.0, squared = 0.0;
  for (std::size_t i = 0; i < 3; ++i) {
    along += expected[i] * (*sensed)[i];
    squared += (*sensed)[i] * (*sensed)[i];
  }
  if (!(squared > 0.0)) return "The unit senses no gravity: expected it to be on and still. Type the angle again.";
  const double away_deg = std::acos(std::clamp(along / std::sqrt(squared), -1.0, 1.0)) * 180.0 / pi;
  if (away_deg <= settings_.gravity_tolerance_deg) return {};
  return "The unit senses gravity " + shown(away_deg) + " deg away from where " + to_string(axis) + " " +
         exact(angle_deg) + " would put it: expected at most " + shown(settings_.gravity_tolerance_deg) +
         ". Is it the right axis and sense? Put it right, then type the angle of " + to_string(axis) + " again.";
}

}  // namespace turncal
