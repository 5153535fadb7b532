#include "orchestrator/watch/operator_screen.h"

#include <sys/ioctl.h>
#include <unistd.h>

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <ctime>
#include <string_view>

#include "imu_io/base/data_text.h"
#include "imu_io/base/text.h"
#include "orchestrator/station/number_text.h"

namespace turncal {

namespace {

// Returns "1:40".
std::string minutes_left(double seconds) {
  const long long whole = std::llround(std::ceil(std::max(0.0, seconds)));
  return fmt::format("{}:{:02}", whole / 60, whole % 60);
}

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

constexpr int input_row = 22;
constexpr std::string_view bold = "\x1b[1m", reverse = "\x1b[7m", amber = "\x1b[1;33m", plain = "\x1b[0m";

// Glyphs of three by five dots, row by row.
constexpr std::string_view glyphs = "0123456789-.,:";
constexpr std::array<std::string_view, 14> dots = {
    "####.##.##.####", ".#.##..#..#.###", "###..#####..###", "###..####..####", "#.##.####..#..#",
    "####..###..####", "####..####.####", "###..#..#..#..#", "####.#####.####", "####.####..####",
    "......###......", ".............#.", "..........#.#..", "....#.....#...."};

void add_lines(std::vector<std::string>& lines, std::string_view text, std::size_t columns,
               std::string_view style = "") {
  if (text.empty()) return;
  for (const std::string& line : wrap(text, columns))
    lines.push_back(std::string(style) + line + std::string(style.empty() ? "" : plain));
}

void draw_big(std::vector<std::string>& lines, const std::string& text) {
  for (std::size_t row = 0; row < 5; ++row) {
    std::string line = "  ";
    for (const char c : text) {
      const std::size_t glyph = glyphs.find(c);
      if (glyph == std::string_view::npos) continue;
      for (std::size_t column = 0; column < 3; ++column)
        line += dots[glyph][3 * row + column] == '#' ? std::string(reverse) + "  " + std::string(plain) : "  ";
      line += "  ";
    }
    lines.push_back(line);
  }
}

// Draws the axes from outer to inner, and the way along the numbers of the dial, which grow to the right.
void draw_table(std::vector<std::string>& lines, const OperatorScreen& screen) {
  const OperatorTask& task = screen.task;
  std::string axes = "  ";
  for (const Axis axis : all_axes) {
    const std::string& name = screen.axes[index(axis)];
    axes += "( " + (axis == task.axis ? std::string(reverse) + " " + name + " " + std::string(plain) : name) + " ";
  }
  lines.push_back(axes + ") ) )");
  if (task.kind != OperatorTask::Kind::turn || !task.from_deg) return;
  const std::string way(24, '=');
  lines.push_back(task.target_deg < *task.from_deg ? "  [" + screen.big + "] <" + way + "o " + screen.from
                                                   : "  " + screen.from + " o" + way + "> [" + screen.big + "]");
}

}  // namespace

std::string local_time(double utc_s) {
  const auto seconds = static_cast<std::time_t>(utc_s);
  std::tm local{};
  ::localtime_r(&seconds, &local);
  return fmt::format("{:02}:{:02}", local.tm_hour, local.tm_min);
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
  if (!resume.empty()) screen.how = texts.say("screen.go_on", {{"folder", shell_path(resume)}});
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
      // A dial cannot show whole turns.
      const auto turns = int((std::abs(way_deg) + 1.0) / 360.0);
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
      if (!task.wrong) screen.note.clear();  // the note says the same
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
  o.text("kind", kinds[std::size_t(screen.task.kind)]);
  o.flag("wants_hands", screen.wants_hands());
  o.text("instruction", screen.instruction);
  o.text("big", screen.big);
  o.text("way", screen.way);
  o.text("how", screen.how);
  o.text("answer", screen.answer);
  o.text("note", screen.note);
  o.flag("wrong", screen.task.wrong);
  o.text("step", screen.step);
  o.text("left", screen.left);
  o.number("axis", double(index(screen.task.axis)));
  o.texts("axes", {screen.axes.begin(), screen.axes.end()});
  o.number("from_deg", screen.task.from_deg);
  o.number("target_deg", screen.task.target_deg);
  o.text("sound", screen.sound);
  o.text("silent", screen.silent);
  return o.end();
}

TerminalSize stdout_size() {
  winsize size{};
  if (::ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) != 0) return {};
  return {size.ws_col, size.ws_row};
}

std::vector<std::string> drawn(const OperatorScreen& screen, const std::string& time, TerminalSize size) {
  const auto columns = std::size_t(size.columns - 1);
  std::vector<std::string> lines;
  add_lines(lines, time + "   " + screen.step, columns);
  add_lines(lines, screen.left, columns);
  lines.emplace_back();
  add_lines(lines, screen.instruction, columns, screen.wants_hands() ? amber : bold);
  if (!screen.big.empty()) {
    lines.emplace_back();
    draw_big(lines, screen.big);
  }
  lines.emplace_back();
  if (!screen.answer.empty()) draw_table(lines, screen);
  for (const std::string* text : {&screen.way, &screen.how}) add_lines(lines, *text, columns);
  add_lines(lines, screen.note, columns, screen.task.wrong ? amber : bold);
  add_lines(lines, screen.answer, columns);
  add_lines(lines, screen.words, columns);
  const auto most = std::size_t(input_row - 1);
  if (lines.size() > most) lines.resize(most);
  return lines;
}

OperatorTerminal::OperatorTerminal(std::string tag, std::function<void(const std::string&)> write, TerminalSize size,
                                   std::function<double()> utc_s)
    : tag_(std::move(tag)), write_(std::move(write)), size_(size), utc_s_(std::move(utc_s)) {}

OperatorTerminal::~OperatorTerminal() {
  if (before_) write_("\x1b[" + std::to_string(input_row) + ";1H\x1b[J");
}

bool OperatorTerminal::rings(const OperatorScreen& screen) const {
  const OperatorTask& now = screen.task;
  if (!screen.wants_hands()) return false;
  if (!before_ || before_->kind != now.kind || before_->axis != now.axis || before_->target_deg != now.target_deg)
    return true;
  return now.wrong && !now.note.empty() && before_->answers != now.answers;
}

void OperatorTerminal::show(const OperatorScreen& screen) {
  std::vector<std::string> lines = drawn(screen, tag_ + local_time(utc_s_()), size_);
  const bool typed = !before_ || before_->answers != screen.task.answers;
  if (!typed && lines == lines_) return;
  std::string out = !before_ ? "\033[2J" : typed ? "" : "\0337";
  for (int row = 1; row < input_row; ++row) {
    out += "\x1b[" + std::to_string(row) + ";1H";
    if (std::size_t(row) <= lines.size()) out += lines[std::size_t(row) - 1];
    out += "\x1b[K";
  }
  out += typed ? "\033[" + std::to_string(input_row) + ";1H\033[J> " : "\0338";
  if (rings(screen)) out += "\a";
  write_(out);
  lines_ = std::move(lines);
  before_ = screen.task;
}

}  // namespace turncal
