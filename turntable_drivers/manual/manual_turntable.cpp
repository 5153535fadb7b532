#include "turntable_drivers/manual/manual_turntable.h"

#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <cassert>
#include <cctype>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numbers>

#include "imu_io/base/key_value.h"
#include "imu_io/base/text.h"
#include "turntable_drivers/table/table_description.h"

namespace turncal {

extern const std::string_view operator_texts_en, operator_texts_de, operator_texts_zh;

OperatorTexts::OperatorTexts(std::string_view language) {
  const std::string_view text = language == "de"   ? operator_texts_de
                                : language == "zh" ? operator_texts_zh
                                                   : operator_texts_en;
  Result<KeyValueFile> file = KeyValueFile::parse(text, std::string(language) + ".conf");
  assert(file.ok());
  for (const std::string& key : file->keys()) texts_[key] = file->text(key);
}

const OperatorTexts& OperatorTexts::of(std::string_view language) {
  static const OperatorTexts english("en"), german("de"), chinese("zh");
  return language == "de" ? german : language == "zh" ? chinese : english;
}

std::string OperatorTexts::say(std::string_view key, Places places) const {
  const auto found = texts_.find(key);
  assert(found != texts_.end());
  if (found == texts_.end()) return std::string(key);
  std::string said;
  std::string_view left = found->second;
  for (std::size_t open; (open = left.find('{')) != std::string_view::npos;) {
    const std::size_t shut = std::min(left.find('}', open), left.size() - 1);
    const std::string_view name = left.substr(open + 1, shut - open - 1);
    const auto place = std::ranges::find_if(places, [name](const auto& one) { return one.first == name; });
    assert(place != places.end());
    said += left.substr(0, open);
    if (place != places.end()) said += place->second;
    left.remove_prefix(shut + 1);
  }
  return said += left;
}

std::string OperatorTexts::number(std::string text) const {
  if (const std::size_t point = text.find('.'); point != std::string::npos) text.replace(point, 1, say("number.point"));
  return text;
}

std::string OperatorTexts::shown(double angle_deg) const {
  char text[40];
  std::snprintf(text, sizeof text, "%.4g", std::abs(angle_deg) < 1e-9 ? 0.0 : angle_deg);
  return number(text);
}

std::string OperatorTexts::exact(double angle_deg) const { return number(format_number(angle_deg)); }

bool OperatorTexts::means(const std::string& typed, std::string_view english) const {
  return typed == english || typed == say("word." + std::string(english)) ||
         (english != "abort" && first_letter(typed, english));
}

bool OperatorTexts::first_letter(const std::string& typed, std::string_view english) const {
  const std::string own = say("word." + std::string(english));
  return typed == english.substr(0, 1) || typed == own.substr(0, printable_character(own));
}

// ---- the table ----

ManualTurntable::ManualTurntable(ManualSettings settings, const Clock& clock, int input, std::ostream& out,
                                 GravitySense sense)
    : settings_(settings),
      clock_(clock),
      input_(input),
      out_(out),
      sense_(std::move(sense)),
      texts_(OperatorTexts::of(settings_.language)) {}

void ManualTurntable::say(const std::string& text) {
  if (!lines_) return;
  for (std::string_view remaining = text; !remaining.empty();) out_ << next_line(remaining) << '\n';
  out_ << std::flush;
}

void ManualTurntable::note(const std::string& text, bool wrong) {
  note_ = text;
  wrong_ = wrong;
  say(text);
  tell_changed();
}

double ManualTurntable::patience_s() const { return rehearsed_ ? monotonic_s() : clock_.now_s(); }

Status ManualTurntable::usable() {
  if (!connected_) return device_error("manual table: not connected");
  look_at_input();
  const bool ends_now = end_ && (end_->kind == ErrorKind::aborted || !queue_.empty());
  return ends_now && !stopped_ ? Status(*end_) : Status{};
}

void ManualTurntable::end(ErrorKind kind, const std::string& why) {
  if (!end_) end_ = Error{kind, "manual table: " + why};
}

OperatorTask ManualTurntable::task() const {
  OperatorTask task;
  task.note = note_;
  task.wrong = wrong_;
  task.answers = answers_;
  if (end_ || queue_.empty()) return task;
  const Wanted& now = queue_.front();
  using enum OperatorTask::Kind;
  task.kind = paused_ ? paused : answered_ ? compare : now.homing ? where : turn;
  task.axis = now.axis;
  if (hands_[index(now.axis)].known) task.from_deg = hands_[index(now.axis)].position_deg;
  task.target_deg = now.target_deg;
  return task;
}

// ---- the interface ----

Status ManualTurntable::connect() {
  connected_ = true;
  enabled_ = false;
  stopped_ = false;
  paused_ = false;
  queue_.clear();
  answered_.reset();
  return usable();
}

Result<TableIdentity> ManualTurntable::identify() {
  TRY(usable());
  return TableIdentity{"table turned by hand", rehearsed_.has_value()};
}

Status ManualTurntable::enable() {
  TRY(usable());
  enabled_ = true;
  return {};
}

Status ManualTurntable::home() {
  TRY(usable());
  if (end_) return *end_;
  if (!enabled_) return device_error("manual table: home: not enabled");
  if (!queue_.empty()) return device_error("manual table: home: a move is under way");
  stopped_ = false;
  for (const Axis axis : {Axis::roll, Axis::pitch, Axis::heading}) {
    hands_[index(axis)] = {};
    queue_.push_back({.axis = axis, .homing = true});
  }
  begin_question();
  return {};
}

Status ManualTurntable::move_absolute(Axis axis, double position_deg, double rate_degps, double acceleration_degps2) {
  TRY(usable());
  if (end_) return *end_;
  const auto refused = [&](const std::string& what) {
    return device_error(std::string("manual table: ") + to_string(axis) + ": " + what);
  };
  // A manual table has no rate, but invalid numbers are still errors.
  if (!std::isfinite(position_deg))
    return refused("move to " + format_number(position_deg) + " deg: expected an angle");
  if (!(rate_degps > 0.0) || !std::isfinite(rate_degps) || !(acceleration_degps2 > 0.0) ||
      !std::isfinite(acceleration_degps2))
    return refused("rate and acceleration: expected numbers above 0");
  if (!enabled_) return refused("not enabled");
  if (!hands_[index(axis)].homed) return refused("not homed");
  for (const Wanted& wanted : queue_)
    if (wanted.axis == axis) return refused("a move is under way: expected it finished or stopped");
  stopped_ = false;
  queue_.push_back({axis, position_deg, false, rate_degps, acceleration_degps2});
  asked_s_ = patience_s();
  if (queue_.size() == 1) begin_question();
  return {};
}

Status ManualTurntable::stop_all() {
  if (!connected_) return device_error("manual table: not connected");
  if (!queue_.empty()) {
    for (const Wanted& wanted : queue_) hands_[index(wanted.axis)].known = false;
    queue_.clear();
    answered_.reset();
    note(texts_.say("said.stop"), false);
  }
  if (rehearsed_) rehearsed_->stop();
  paused_ = false;
  stopped_ = true;
  return {};  // even without an operator: nothing turns by itself
}

Status ManualTurntable::abort_all() {
  const Status status = stop_all();
  enabled_ = false;
  return status;
}

Status ManualTurntable::clear_fault() { return usable(); }

Result<AxisStatus> ManualTurntable::status(Axis axis) {
  TRY(usable());
  const Hand& hand = hands_[index(axis)];
  AxisStatus report;
  report.position_deg = hand.position_deg;
  report.moving = std::ranges::any_of(queue_, [axis](const Wanted& wanted) { return wanted.axis == axis; });
  report.rate_degps = report.moving ? std::numeric_limits<double>::quiet_NaN() : 0.0;
  report.enabled = report.drive_on = enabled_;
  report.homed = hand.homed;
  report.in_position = hand.known && !report.moving;
  report.remote = true;
  report.time_s = clock_.now_s();
  if (paused_) report.text = "paused";
  return report;
}

// ---- the dialogue: questions to the operator, and answers ----

namespace {

constexpr std::size_t longest_line = 1000;
constexpr int rehearsal_wait_ms = 1000;

void replace_all(std::string& text, std::string_view typed, std::string_view meant) {
  for (std::size_t at; (at = text.find(typed)) != std::string::npos;) text.replace(at, typed.size(), meant);
}

// Parses a number as people type it: with a decimal comma, with a degree sign as on the screen, or in full-width characters.
std::optional<double> typed_number(std::string text) {
  constexpr std::pair<std::string_view, std::string_view> spellings[] = {
      {"\uff0c", ","}, {"\uff0e", "."}, {"\u3002", "."}, {"\uff0d", "-"}, {"\u2212", "-"}, {"\uff0b", "+"}};
  for (const auto& [typed, meant] : spellings) replace_all(text, typed, meant);
  for (int digit = 0; digit <= 9; ++digit)
    replace_all(text, std::string("\xef\xbc") + char('\x90' + digit), std::to_string(digit));
  for (const std::string_view degrees : {"\u00b0", "\u5ea6"})
    if (text.ends_with(degrees)) text.resize(text.size() - degrees.size());
  if (const std::size_t comma = text.find(','); comma != std::string::npos && text.find('.') == std::string::npos)
    text[comma] = '.';
  // No dial shows 1e3.
  return text.find_first_of("eE") == std::string::npos ? device_number(text) : std::nullopt;
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
  // In a rehearsal a line is read only when it can be handled: otherwise it answers a later question.
  if (rehearsed_) {
    handle_lines();
    if (waits_for_answer() && read_input(true)) handle_lines();
  } else {
    while (read_input(false)) handle_lines();
  }
  if (input_ended_ && (!rehearsed_ || waits_for_answer()))
    end(ErrorKind::interrupted, "end of input: expected the operator's answers");
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
  typed_.append(chunk, std::size_t(got));
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
  if (!paused_ && patience_s() - asked_s_ > settings_.answer_timeout_s)
    pause(texts_.say("said.no_answer", {{"seconds", texts_.shown(settings_.answer_timeout_s)}}));
  else if (paused_ && patience_s() - std::max(paused_s_, asked_s_) > settings_.pause_limit_s)
    end(ErrorKind::interrupted, "paused for longer than " + format_number(settings_.pause_limit_s) + " s");
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
  std::transform(word.begin(), word.end(), word.begin(), [](unsigned char c) { return char(std::tolower(c)); });
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
  const auto axis = std::ranges::find(all_axes, axis_and_angle.substr(0, blank), [](Axis a) { return to_string(a); });
  const std::optional<double> angle_deg =
      device_number(blank == std::string::npos ? "" : axis_and_angle.substr(blank + 1));
  if (axis == all_axes.end() || !angle_deg)
    return note(texts_.say("wrong.rehearsed", {{"text", quoted(axis_and_angle)}}), true);
  rehearsed_->turn(*axis, *angle_deg, queue_.front().rate_degps, queue_.front().acceleration_degps2);
}

constexpr double farthest_deg = 720.0;  // limit for the position of an axis: two turns of a cable

void ManualTurntable::handle_angle(const std::string& text, bool turned) {
  const Wanted now = queue_.front();
  const std::optional<double> typed_deg = typed_number(text);
  if (!typed_deg || (now.homing && !(std::abs(*typed_deg) <= farthest_deg)))
    return note(texts_.say("wrong.number", {{"text", quoted(text)}}), true);
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

// ---- check of an answer by the unit: gravity for the tilt, the gyros for the turn ----

namespace {

// Gravity is the mean of one second, made of complete half seconds: after this time all of it is later than the answer.
constexpr double gravity_settle_s = 1.6;
constexpr double gravity_deadline_s = 10.0;
constexpr double quarter_deg = 90.0;
constexpr double sum_error_deg = 15.0;         // of the gyros' sum over a turn, by their bias
constexpr double least_scale_turn_deg = 30.0;  // smallest turn from which the gyros' scale is learned

}  // namespace

void ManualTurntable::check_answer() {
  if (!answered_) return;
  const double now_s = clock_.now_s();
  if (rehearsed_ && rehearsed_->moving()) {
    answered_->since_s = now_s;
    return;
  }
  const Wanted now = queue_.front();
  const double angle_deg = answered_->angle_deg;
  // The tilt depends on both angles, so there is no check while one of them is unknown.
  const Axis other = now.axis == Axis::pitch ? Axis::roll : Axis::pitch;
  const bool tilts = now.axis != Axis::heading && sense_ && hands_[index(other)].known;
  if (!tilts && (now.homing || !felt_deg(now.axis))) return accept(angle_deg);
  if (now_s - answered_->since_s < gravity_settle_s) return;
  if (sense_ && !sense_()) {
    if (now_s - answered_->since_s < gravity_deadline_s) return;
    return object(texts_.say("wrong.not_still"));
  }
  if (const auto objection = tilts ? gravity_objection(now.axis, angle_deg) : std::nullopt) {
    object(*objection);
    if (now.homing) {  // either of the two may be wrong
      hands_[index(other)] = {};
      queue_.push_front({.axis = other, .homing = true});
      begin_question();
    }
    return;
  }
  if (const auto objection = turn_objection(now, angle_deg)) return object(*objection);
  accept(angle_deg);
}

void ManualTurntable::object(const std::string& why) {
  answered_.reset();
  note(why, true);
}

void ManualTurntable::accept(double angle_deg) {
  const Wanted now = queue_.front();
  Hand& hand = hands_[index(now.axis)];
  const double way_deg = angle_deg - hand.position_deg;
  if (const std::optional<double> felt = felt_deg(now.axis);
      felt && hand.known && now.axis != Axis::heading && sense_ && std::abs(way_deg) >= least_scale_turn_deg)
    felt_of_a_degree_ = std::clamp(*felt / way_deg, 0.4, 1.7);  // no calibration copes with more
  hand.position_deg = angle_deg;
  hand.known = true;
  hand.homed = hand.homed || now.homing;
  answered_.reset();
  note_.clear();
  queue_.pop_front();
  begin_question();
  tell_changed();
}

std::optional<double> ManualTurntable::felt_deg(Axis axis) const {
  if (!felt_before_ || !turn_sense_) return {};
  const std::optional<std::array<double, 3>> felt = turn_sense_();
  const Hand &pitch = hands_[index(Axis::pitch)], &roll = hands_[index(Axis::roll)];
  if (!felt || (axis != Axis::roll && !roll.known) || (axis == Axis::heading && !pitch.known)) return {};
  const double p = pitch.position_deg * std::numbers::pi / 180.0, r = roll.position_deg * std::numbers::pi / 180.0;
  // The body axis of a positive turn: heading is about -y of n, pitch about z of the middle ring, roll about x.
  const std::array<double, 3> about =
      axis == Axis::roll    ? std::array{1.0, 0.0, 0.0}
      : axis == Axis::pitch ? std::array{0.0, std::sin(r), std::cos(r)}
                            : std::array{-std::sin(p), -std::cos(p) * std::cos(r), std::cos(p) * std::sin(r)};
  double along = 0.0;
  for (std::size_t i = 0; i < 3; ++i) along += about[i] * ((*felt)[i] - (*felt_before_)[i]);
  return along;
}

std::optional<std::string> ManualTurntable::turn_objection(const Wanted& now, double angle_deg) const {
  const Hand& hand = hands_[index(now.axis)];
  const std::optional<double> felt = felt_deg(now.axis);
  if (now.homing || !hand.known || !felt) return {};
  const double way_deg = angle_deg - hand.position_deg;
  const double made_deg = *felt / felt_of_a_degree_.value_or(1.0);
  const double sign = way_deg < 0.0 ? -1.0 : 1.0, way = std::abs(way_deg);
  // Gravity shows a tilt, so only whole turns of it can be missing. A heading must be nearer to the asked turn than to none.
  const bool tilts = now.axis != Axis::heading;
  const double slack_deg = tilts ? 60.0 : sum_error_deg;
  const double most_deg = tilts ? quarter_deg : std::clamp(0.5 * way, sum_error_deg, quarter_deg);
  const auto agrees = [&](double turned_deg) { return std::abs(turned_deg - way_deg) < most_deg; };
  // The learned scale may come from a turn in which another axis took part, so the nominal one is accepted, too.
  if (felt_of_a_degree_ ? agrees(made_deg) || agrees(*felt)
                        : sign * *felt >= 0.25 * way - slack_deg && sign * *felt <= 2.0 * way + slack_deg)
    return {};
  const double left_deg = std::abs(way_deg - made_deg), whole_deg = 360.0 * std::round(left_deg / 360.0);
  const bool whole = tilts || std::abs(left_deg - whole_deg) <= sum_error_deg;
  const double missing_deg = whole ? std::max(360.0, whole_deg) : std::round(left_deg);
  return texts_.say("wrong.turn", {{"axis", name(now.axis)},
                                   {"felt", texts_.exact(std::round(made_deg) + 0.0)},
                                   {"way", texts_.exact(std::round(way_deg) + 0.0)},
                                   {"missing", texts_.exact(missing_deg)},
                                   {"sense", sense_words(way_deg - made_deg)}});
}

std::optional<std::string> ManualTurntable::gravity_objection(Axis axis, double angle_deg) const {
  const Axis other = axis == Axis::pitch ? Axis::roll : Axis::pitch;
  const std::optional<std::array<double, 3>> sensed = sense_();
  const double other_deg = hands_[index(other)].position_deg;
  const double pitch = (axis == Axis::pitch ? angle_deg : other_deg) * std::numbers::pi / 180.0;
  const double roll = (axis == Axis::roll ? angle_deg : other_deg) * std::numbers::pi / 180.0;
  const std::array<double, 3> expected = {std::sin(pitch), std::cos(pitch) * std::cos(roll),
                                          -std::cos(pitch) * std::sin(roll)};
  double along = 0.0, squared = 0.0;
  for (std::size_t i = 0; i < 3; ++i) {
    along += expected[i] * (*sensed)[i];
    squared += (*sensed)[i] * (*sensed)[i];
  }
  if (!(squared > 0.0)) return texts_.say("wrong.no_gravity");
  const double away_deg = std::acos(std::clamp(along / std::sqrt(squared), -1.0, 1.0)) * 180.0 / std::numbers::pi;
  if (away_deg <= settings_.gravity_tolerance_deg) return {};
  return texts_.say("wrong.gravity", {{"away", texts_.shown(away_deg)},
                                      {"axis", name(axis)},
                                      {"angle", texts_.exact(angle_deg)},
                                      {"most", texts_.shown(settings_.gravity_tolerance_deg)}});
}

}  // namespace turncal
