#include "orchestrator/watch/operator_screen.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>

#include "imu_io/base/data_text.h"
#include "imu_io/base/format_number.h"

namespace turncal {

namespace {

double hundredths(double angle_deg) { return std::round(100.0 * angle_deg) / 100.0 + 0.0; }

std::string hands_off_words(RunState state) {
  switch (state) {
    case RunState::moving:
    case RunState::settling: return "screen.settle";
    case RunState::dwelling: return "screen.measure";
    case RunState::resting: return "screen.rest";
    default: return "screen.wait";
  }
}

}  // namespace

std::string local_time(double utc_s) {
  const auto seconds = static_cast<std::time_t>(utc_s);
  std::tm local{};
  ::localtime_r(&seconds, &local);
  char text[16];
  std::snprintf(text, sizeof text, "%02d:%02d", local.tm_hour, local.tm_min);
  return text;
}

std::string minutes_left(double seconds) {
  const long long whole = std::llround(std::ceil(std::max(0.0, seconds)));
  char text[40];
  std::snprintf(text, sizeof text, "%lld:%02lld", whole / 60, whole % 60);
  return text;
}

std::string step_words(const RunSnapshot& at, const OperatorTexts& texts) {
  return texts.say("screen.step", {{"step", std::to_string(at.step_place)},
                                   {"steps", std::to_string(at.step_count)},
                                   {"percent", format_number(std::floor(100.0 * at.run_fraction))}});
}

std::string left_words(const RunSnapshot& at, std::optional<double> left_s, const OperatorTexts& texts) {
  std::string text = texts.say("screen.turns_left", {{"turns", std::to_string(at.moves_left)}});
  if (left_s) text += "; " + texts.say("screen.until", {{"end", local_time(at.utc_s + *left_s)}});
  return text;
}

OperatorScreen last_screen(bool done, const std::string& resume, const OperatorTexts& texts) {
  OperatorScreen screen;
  screen.instruction = texts.say(done ? "screen.done" : "screen.ended");
  if (!resume.empty()) screen.how = texts.say("screen.go_on", {{"folder", resume}});
  return screen;
}

OperatorScreen operator_screen(const OperatorTask& task, const RunSnapshot& at, std::optional<double> left_s,
                               const OperatorTexts& texts) {
  using enum OperatorTask::Kind;
  OperatorScreen screen;
  screen.task = task;
  for (const Axis axis : all_axes) screen.axes[index(axis)] = texts.say(std::string("axis.") + to_string(axis));
  const std::string& axis = screen.axes[index(task.axis)];
  screen.sound = texts.say("screen.sound");
  screen.silent = texts.say("screen.silent");
  screen.note = task.note;
  if (at.step_place > 0) {
    screen.step = step_words(at, texts);
    screen.left = left_words(at, left_s, texts);
  }
  switch (task.kind) {
    case nothing: {
      screen.measures = at.state == RunState::dwelling || at.state == RunState::resting;
      screen.instruction = texts.say(hands_off_words(at.state));
      if (screen.measures && at.item_end_utc_s > 0.0) screen.big = minutes_left(at.item_end_utc_s - at.utc_s);
      break;
    }
    case where:
      screen.instruction = texts.say("screen.where", {{"axis", axis}});
      screen.how = texts.say("screen.where_how");
      break;
    case turn: {
      screen.instruction = texts.say("screen.turn", {{"axis", axis}, {"target", texts.exact(task.target_deg)}});
      screen.big = texts.exact(task.target_deg);
      if (!task.from_deg) break;
      screen.from = texts.exact(hundredths(*task.from_deg));
      const double way_deg = task.target_deg - *task.from_deg;
      const std::string sense = texts.say(way_deg < 0.0 ? "sense.backward" : "sense.forward");
      // What a dial cannot show: that it is a whole turn, or more.
      const auto turns = static_cast<int>((std::abs(way_deg) + 1.0) / 360.0);
      const std::string way = texts.exact(hundredths(std::abs(way_deg)));
      screen.way = turns > 0 ? texts.say("screen.whole_turns",
                                         {{"way", way}, {"sense", sense}, {"turns", std::to_string(turns)}})
                             : texts.say("screen.way", {{"way", way}, {"sense", sense}});
      break;
    }
    case compare: screen.instruction = texts.say("screen.compare"); break;
    case paused:
      screen.instruction = texts.say("screen.paused");
      screen.how = texts.say("screen.paused_how");
      if (!task.wrong) screen.note.clear();  // it says the same
      break;
  }
  if (task.kind == where || task.kind == turn) {
    screen.answer = texts.say("screen.answer", {{"axis", axis}});
    screen.words = texts.say("screen.words");
  }
  return screen;
}

std::string json_of(const OperatorScreen& screen) {
  constexpr const char* kinds[] = {"nothing", "where", "turn", "compare", "paused"};
  JsonObject o;
  o.text("kind", kinds[static_cast<std::size_t>(screen.task.kind)]);
  o.raw("wants_hands", screen.wants_hands() ? "true" : "false");
  o.text("instruction", screen.instruction);
  o.text("big", screen.big);
  o.text("way", screen.way);
  o.text("how", screen.how);
  o.text("answer", screen.answer);
  o.text("note", screen.note);
  o.raw("wrong", screen.task.wrong ? "true" : "false");
  o.text("step", screen.step);
  o.text("left", screen.left);
  o.number("axis", static_cast<double>(index(screen.task.axis)));
  o.texts("axes", {screen.axes.begin(), screen.axes.end()});
  o.raw("from_deg", screen.task.from_deg ? json_number(*screen.task.from_deg) : "null");
  o.number("target_deg", screen.task.target_deg);
  o.text("sound", screen.sound);
  o.text("silent", screen.silent);
  return o.end();
}

}  // namespace turncal
