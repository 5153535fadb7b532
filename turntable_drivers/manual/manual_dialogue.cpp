// The dialogue of a ManualTurntable: what the operator is asked, and what is made of what was typed; what the unit says to it:
// manual_comparison.cpp.
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
#include "turntable_drivers/table/table_description.h"

namespace turncal {
namespace {

constexpr std::size_t longest_line = 1000;
constexpr int rehearsal_wait_ms = 1000;

void replace_all(std::string& text, std::string_view typed, std::string_view meant) {
  for (std::size_t at; (at = text.find(typed)) != std::string::npos;) text.replace(at, typed.size(), meant);
}

// As people type it: with a decimal comma, with the degree that the screen shows, or in the width of a Chinese keyboard.
std::optional<double> typed_number(std::string text) {
  constexpr std::pair<std::string_view, std::string_view> spellings[] = {
      {"\uff0c", ","}, {"\uff0e", "."}, {"\u3002", "."}, {"\uff0d", "-"}, {"\u2212", "-"}, {"\uff0b", "+"}};
  for (const auto& [typed, meant] : spellings) replace_all(text, typed, meant);
  for (int digit = 0; digit <= 9; ++digit)
    replace_all(text, std::string("\xef\xbc") + static_cast<char>('\x90' + digit), std::to_string(digit));
  for (const std::string_view degrees : {"\u00b0", "\u5ea6"})
    if (text.ends_with(degrees)) text.resize(text.size() - degrees.size());
  if (const std::size_t comma = text.find(','); comma != std::string::npos && text.find('.') == std::string::npos)
    text[comma] = '.';
  // No dial shows 1e3.
  return text.find_first_of("eE") == std::string::npos ? device_number(text) : std::nullopt;
}

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
    text += texts_.say("ask.where", {{"axis", name(now.axis)}});
  } else if (hand.known) {
    const double way_deg = now.target_deg - hand.position_deg;
    text += texts_.say("ask.turn", {{"axis", name(now.axis)},
                                    {"from", texts_.shown(hand.position_deg)},
                                    {"target", texts_.exact(now.target_deg)},
                                    {"way", texts_.shown(std::abs(way_deg))},
                                    {"sense", sense_words(way_deg)}});
  } else {
    text += texts_.say("ask.turn_from_anywhere", {{"axis", name(now.axis)}, {"target", texts_.exact(now.target_deg)}});
  }
  say(text + " " + texts_.say("ask.words"));
  tell_changed();
}

void ManualTurntable::begin_question() {
  felt_before_ = turn_sense_ ? turn_sense_() : std::nullopt;
  ask();
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
    ++answers_;
    answer(line.ends_with('\r') ? line.substr(0, line.size() - 1) : line);
    tell_changed();
  }
  if (typed_.size() > longest_line && typed_.find('\n') == std::string::npos) typed_.clear();
}

void ManualTurntable::keep_limits() {
  if (!waits_for_answer()) return;
  if (!paused_ && patience_s() - asked_s_ > settings_.answer_timeout_s) {
    pause(texts_.say("said.no_answer", {{"seconds", texts_.shown(settings_.answer_timeout_s)}}));
  } else if (paused_ && patience_s() - std::max(paused_s_, asked_s_) > settings_.pause_limit_s) {
    end(ErrorKind::interrupted, "paused for longer than " + format_number(settings_.pause_limit_s) + " s");
  }
}

void ManualTurntable::pause(const std::string& why) {
  if (!paused_) paused_s_ = patience_s();
  paused_ = true;
  note(why + " " + texts_.say("said.paused_how"), false);
}

void ManualTurntable::answer(const std::string& line) {
  if (line.empty()) return;
  note_.clear();
  const std::size_t blank = line.find(' ');
  std::string word = line.substr(0, blank);
  const std::string argument(blank == std::string::npos ? "" : trimmed(std::string_view(line).substr(blank)));
  std::transform(word.begin(), word.end(), word.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  replace_all(word, "\u00dc", "\u00fc");
  const auto is = [&](const char* english) { return texts_.means(word, english); };
  if (is("abort")) {
    end(ErrorKind::aborted, "aborted by the operator");
    enabled_ = false;
    note(texts_.say("said.aborted"), false);
  } else if (texts_.first_letter(word, "abort")) {
    note(texts_.say("wrong.whole_word"), true);
  } else if (is("leave")) {
    const bool asked = !queue_.empty();
    end(ErrorKind::interrupted, "the operator left");
    note(texts_.say(asked ? "said.left" : "said.leaves"), false);
  } else if (is("pause")) {
    pause(texts_.say(queue_.empty() ? "said.paused_dwell" : "said.paused"));
  } else if (is("continue")) {
    paused_ = reason_told_ = false;
    ask();
  } else if (is("help")) {
    std::string text = texts_.say("help.angle", {{"most", texts_.shown(settings_.tolerance_deg)}});
    for (const char* key : {"help.words", "help.pause", "help.abort"}) text += "\n" + texts_.say(key);
    note(text + (rehearsed_ ? "\n" + texts_.say("help.rehearsal") : ""), false);
  } else if (is("repeat")) {
    reason_told_ = false;
    ask();
  } else if (queue_.empty()) {
    note(texts_.say("wrong.no_question"), true);
  } else if (paused_) {
    note(texts_.say("wrong.paused"), true);
  } else if (is("skip")) {
    if (argument.empty()) return note(texts_.say("wrong.why"), true);
    end(ErrorKind::interrupted, "skipped by the operator: " + argument);
    note(texts_.say("said.skipped", {{"reason", argument}}), false);
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
  if (!axis || !angle_deg) return note(texts_.say("wrong.rehearsed", {{"text", quoted(axis_and_angle)}}), true);
  rehearsed_->turn(*axis, *angle_deg, queue_.front().rate_degps, queue_.front().acceleration_degps2);
}

void ManualTurntable::handle_angle(const std::string& text, bool turned) {
  const Wanted now = queue_.front();
  const std::optional<double> typed_deg = typed_number(text);
  if (!typed_deg) return note(texts_.say("wrong.number", {{"text", quoted(text)}}), true);
  if (answered_) return note(texts_.say("wrong.early"), true);
  const double angle_deg = now.homing ? *typed_deg : unwrapped_deg(*typed_deg, now.target_deg, 360.0);
  const double away_deg = std::abs(angle_deg - now.target_deg);
  if (!now.homing && !(away_deg <= settings_.tolerance_deg + 1e-9)) {
    return note(texts_.say("wrong.away", {{"text", text},
                                          {"away", texts_.shown(away_deg)},
                                          {"target", texts_.exact(now.target_deg)},
                                          {"most", texts_.shown(settings_.tolerance_deg)}}),
                true);
  }
  if (rehearsed_ && !turned) rehearsed_->turn(now.axis, angle_deg, now.rate_degps, now.acceleration_degps2);
  answered_ = Answer{angle_deg, clock_.now_s()};
  check_answer();
}

}  // namespace turncal
