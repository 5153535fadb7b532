// The parser of docs/sequences.md, and the appending of sequences. One pass over the lines carries the commanded angles
// along, so that rotations, which are relative in the file, become absolute targets.
#include "sequences/sequence.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <optional>

#include "calib/model/parameters.h"
#include "imu_io/base/file_kind.h"
#include "imu_io/base/files.h"
#include "imu_io/base/text.h"

namespace turncal {

namespace {

constexpr std::size_t largest_file_bytes = 1'000'000;
// From the inner to the outer axis.
constexpr std::array<Axis, 3> approach_order = {Axis::roll, Axis::pitch, Axis::heading};
constexpr std::int64_t shortest_dwell_samples = 200;        // 1 s at 200 Hz: one stillness window
constexpr std::int64_t longest_dwell_samples = 17'280'000;  // a day at 200 Hz: more is a typing mistake
constexpr int largest_step_number = 9999;
constexpr double largest_angle_deg = 3600.0;
constexpr double smallest_rate = 0.001;  // deg/s or deg/s^2: any turn ends within a few months
constexpr double largest_rate = 100'000.0;

// Commanded angles are rounded to 1e-9 deg, so that turns that cancel end exactly where they began.
double rounded_deg(double angle_deg) { return std::round(angle_deg * 1e9) / 1e9 + 0.0; }  // + 0.0: no negative zero

bool is_name(std::string_view text) {
  return !text.empty() && std::ranges::all_of(text, [](char c) {
    return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_' || c == '-' || c == '.';
  });
}

// A line is words separated by blanks; `"..."` is one title; `=` is a token of its own; `#` outside a title starts a comment. The last
// token of a line is `end`. Columns count bytes from 1.
struct Token {
  enum class Kind { word, title, equals, end } kind = Kind::end;
  std::string_view text;  // a title without its quotes; empty at the end
  int column = 1;
  bool is(std::string_view word) const { return kind == Kind::word && text == word; }
};

bool is_blank(char c) { return c == ' ' || c == '\t'; }
bool ends_word(char c) { return is_blank(c) || c == '=' || c == '#' || c == '"'; }

// Returns the value of a word; nothing for anything else (a title, two signs, trailing characters, overflow, inf or NaN).
std::optional<double> as_number(const Token& token) {
  std::string_view text = token.text;
  if (token.kind != Token::Kind::word || text.starts_with("+-")) return std::nullopt;
  if (text.starts_with('+'))
    text.remove_prefix(1);  // turns are written with their sign, which parse_number() does not accept
  return parse_number(text);
}

std::optional<std::int64_t> as_integer(const Token& token) {
  return token.kind == Token::Kind::word ? parse_integer(token.text) : std::nullopt;
}

std::optional<Axis> as_axis(const Token& token) {
  for (const Axis axis : all_axes)
    if (token.is(to_string(axis)) || token.is(std::string_view("HPR").substr(index(axis), 1))) return axis;
  return std::nullopt;
}

std::string shown(const Token& token) {
  if (token.kind == Token::Kind::end) return "the end of the line";
  return (token.kind == Token::Kind::title ? "the title " : "") + quoted(token.text);
}

class Parser {
 public:
  Parser(std::string_view text, std::string_view file) : text_(text), file_(file) {}

  Result<Sequence> run() {
    if (text_.empty()) return problem(1, 1, "found an empty file, expected 'format = 1' and the steps of a sequence");
    std::string_view remaining = text_;
    if (remaining.starts_with("\xEF\xBB\xBF")) remaining.remove_prefix(3);  // the byte order mark of some editors
    while (!remaining.empty()) {
      ++line_;
      TRY(parse_line(next_line(remaining)));
    }
    TRY(close_file());
    return std::move(sequence_);
  }

 private:
  Error problem(int line, int column, std::string_view what) const {
    return input_error("{}:{}:{}: {}", file_, line, column, what);
  }
  Error wrong(const Token& found, std::string_view expected) const {
    return problem(line_, found.column, fmt::format("found {}, expected {}", shown(found), expected));
  }

  Status tokenize(std::string_view line) {
    tokens_.clear();
    next_ = 0;
    std::size_t at = 0;
    while (at < line.size() && line[at] != '#') {
      const char c = line[at];
      const int column = int(at) + 1;
      if (is_blank(c)) {
        ++at;
      } else if (c == '=') {
        tokens_.push_back({Token::Kind::equals, line.substr(at++, 1), column});
      } else if (c == '"') {
        const std::size_t close = line.find('"', at + 1);
        if (close == std::string_view::npos)
          return wrong({Token::Kind::word, line.substr(at), column}, "a title that ends with '\"' on the same line");
        tokens_.push_back({Token::Kind::title, line.substr(at + 1, close - at - 1), column});
        at = close + 1;
      } else {
        const std::size_t begin = at;
        while (at < line.size() && !ends_word(line[at])) ++at;
        tokens_.push_back({Token::Kind::word, line.substr(begin, at - begin), column});
      }
    }
    tokens_.push_back({Token::Kind::end, {}, int(at) + 1});
    return {};
  }

  // The tokens of a line are taken in order; next() never passes the end token.
  const Token& peek() const { return tokens_[next_]; }
  Token next() { return tokens_[peek().kind == Token::Kind::end ? next_ : next_++]; }
  Status expect_end(std::string_view otherwise) const {
    return peek().kind == Token::Kind::end ? Status() : Status(wrong(peek(), otherwise));
  }

  Status parse_line(std::string_view line) {
    TRY(tokenize(line));
    if (peek().kind == Token::Kind::end) return {};
    const Token word = next();
    if (word.is("step")) return parse_step(word);
    if (sequence_.steps.empty()) return parse_header(word);
    if (word.is("determines")) return parse_determines(word);
    if (word.is("initial")) return parse_initial(word);
    if (word.is("align")) return parse_dwell(word, SegmentKind::align);
    if (word.is("dwell")) return parse_dwell(word, SegmentKind::still);
    if (word.is("rotate")) return parse_rotate(word);
    return wrong(word, one_of(word.text, {"step", "determines", "initial", "align", "dwell", "rotate"}));
  }

  // Parses a header line `key = value` above the first step.
  Status parse_header(const Token& key) {
    const bool is_format = key.is("format");
    const bool is_the_name = key.is("name");
    double* number = key.is("rate_degps")            ? &sequence_.rate_degps
                     : key.is("acceleration_degps2") ? &sequence_.acceleration_degps2
                                                     : nullptr;
    if (!has_format_ && !is_format)
      return wrong(key, "'format = 1' as the first entry" + did_you_mean(key.text, {"format"}));
    if (number == nullptr && !is_format && !is_the_name)
      return wrong(key, one_of(key.text, {"format", "name", "rate_degps", "acceleration_degps2", "step"}));
    if ((is_format && has_format_) || (is_the_name && !sequence_.name.empty()) || (number != nullptr && *number != 0.0))
      return wrong(key, "each of format, name, rate_degps and acceleration_degps2 only once");
    if (const Token equals = next(); equals.kind != Token::Kind::equals)
      return wrong(equals, "'=' after " + std::string(key.text));
    const Token value = next();
    if (number != nullptr) {
      TRY(read_rate(value, key.text, *number));
    } else if (is_format) {
      if (!value.is("1")) return wrong(value, "1, the format this program reads");
      has_format_ = true;
    } else {
      if (value.kind != Token::Kind::word || !is_name(value.text))
        return wrong(value, "a name of letters, digits, '_', '-' and '.'");
      sequence_.name = value.text;
    }
    return expect_end("nothing after the value");
  }

  Status parse_step(const Token& word) {
    if (sequence_.steps.empty()) {
      const char* missing = !has_format_                           ? "format = 1"
                            : sequence_.name.empty()               ? "name = NAME"
                            : sequence_.rate_degps == 0.0          ? "rate_degps = NUMBER"
                            : sequence_.acceleration_degps2 == 0.0 ? "acceleration_degps2 = NUMBER"
                                                                   : nullptr;
      if (missing != nullptr) return wrong(word, "'" + std::string(missing) + "' above the first step");
    } else
      TRY(close_step());
    const int previous = sequence_.steps.empty() ? 0 : sequence_.steps.back().number;
    const Token number = next();
    const std::optional<std::int64_t> value = as_integer(number);
    if (!value || *value <= previous || *value > largest_step_number)
      return wrong(number,
                   previous == 0
                       ? "a step number of 1 to 9999"
                       : fmt::format("a step number above {}, that of the step before, and at most 9999", previous));
    Step step;
    step.number = int(*value);
    step.line = line_;
    if (peek().kind == Token::Kind::title) step.title = next().text;
    has_initial_ = false;
    sequence_.steps.push_back(std::move(step));
    return expect_end("a title in quotes or the end of the line");
  }

  Status parse_determines(const Token& word) {
    Step& step = sequence_.steps.back();
    if (!step.determines.empty() || !step.items.empty())
      return wrong(word, "determines once in a step, above its first item");
    std::vector<std::string> known;
    for (const int k : free_parameters()) known.push_back(parameter_key(k));
    do {
      const Token key = next();
      if (key.kind != Token::Kind::word || std::ranges::find(known, key.text) == known.end())
        return wrong(key,
                     "one of the 21 parameters that are estimated (N01 to N03, A01 to A03, n11 to n33, "
                     "a11 to a33 without a21, a31, a32)" +
                         did_you_mean(key.text, known));
      if (std::ranges::find(step.determines, key.text) != step.determines.end())
        return wrong(key, "each parameter once");
      step.determines.emplace_back(key.text);
    } while (peek().kind != Token::Kind::end);
    return {};
  }

  Status parse_initial(const Token& word) {
    Step& step = sequence_.steps.back();
    if (has_initial_) return wrong(word, "one initial position in a step");
    std::array<bool, 3> given{};
    for (std::size_t i = 0; i < all_axes.size(); ++i) {
      const Token name = next();
      const std::optional<Axis> axis = as_axis(name);
      if (!axis || given[index(*axis)])
        return wrong(name, "H, P and R, each once and with its angle, as in 'initial H 0 P 0 R 0'");
      given[index(*axis)] = true;
      const Token angle = next();
      const std::optional<double> value = as_number(angle);
      if (!value || std::abs(*value) > largest_angle_deg) return wrong(angle, "an angle from -3600 to 3600 deg");
      step.initial_deg[*axis] = rounded_deg(*value);
    }
    has_initial_ = true;
    if (sequence_.steps.size() == 1) {
      sequence_.start_deg = step.initial_deg;
      commanded_deg_ = step.initial_deg;
    }
    step.items = approach(commanded_deg_, step.initial_deg, sequence_.rate_degps, sequence_.acceleration_degps2, line_);
    commanded_deg_ = step.initial_deg;
    positioning_moves_ = step.items.size();
    return expect_end("the end of the line after three axes");
  }

  Status parse_dwell(const Token& word, SegmentKind kind) {
    if (!has_initial_) return wrong(word, "'initial' before the first item of a step");
    Step& step = sequence_.steps.back();
    if (sequence_.steps.size() == 1 && step.items.empty() && kind != SegmentKind::align)
      return wrong(word, first_item_expected);
    const Token length = next();
    const std::optional<std::int64_t> samples = as_integer(length);
    if (!samples || *samples < shortest_dwell_samples || *samples > longest_dwell_samples)
      return wrong(length, "a whole number of samples from 200 (1 s) to 17280000 (a day)");
    step.items.push_back({SequenceItem::Kind::dwell, {}, {kind, *samples}, line_});
    has_still_dwell_ = has_still_dwell_ || kind == SegmentKind::still;
    return expect_end("the end of the line after the number of samples");
  }

  Status parse_rotate(const Token& word) {
    if (!has_initial_) return wrong(word, "'initial' before the first item of a step");
    if (sequence_.steps.size() == 1 && sequence_.steps.back().items.empty()) return wrong(word, first_item_expected);
    const Token name = next();
    const std::optional<Axis> axis = as_axis(name);
    if (!axis) return wrong(name, "an axis: H, P or R");
    const Token angle = next();
    const std::optional<double> turn = as_number(angle);
    const bool is_signed = angle.text.starts_with('+') || angle.text.starts_with('-');
    const double target_deg = rounded_deg(commanded_deg_[*axis] + turn.value_or(0.0));
    if (!turn || !is_signed || target_deg == commanded_deg_[*axis] || std::abs(*turn) > largest_angle_deg)
      return wrong(angle, "an angle to turn by, with its sign and not zero, from -3600 to +3600 deg");
    Move move{*axis, target_deg, sequence_.rate_degps, sequence_.acceleration_degps2};
    if (std::abs(move.target_deg) > largest_angle_deg)
      return wrong(angle, "an angle that keeps the axis within -3600 to 3600 deg");
    bool has_rate = false, has_acceleration = false;
    while (peek().kind != Token::Kind::end) {
      const Token option = next();
      const bool is_rate = option.is("rate");
      bool& given = is_rate ? has_rate : has_acceleration;
      if (given || !(is_rate || option.is("acceleration")))
        return wrong(option, "rate NUMBER, acceleration NUMBER (each at most once) or the end of the line" +
                                 did_you_mean(option.text, {"rate", "acceleration"}));
      given = true;
      TRY(read_rate(next(), option.text, is_rate ? move.rate_degps : move.acceleration_degps2));
    }
    sequence_.steps.back().items.push_back({SequenceItem::Kind::move, move, {}, line_});
    commanded_deg_[move.axis] = move.target_deg;
    return {};
  }

  Status read_rate(const Token& token, std::string_view what, double& value) const {
    const std::optional<double> number = as_number(token);
    if (!number || *number < smallest_rate || *number > largest_rate)
      return wrong(token, "a number from 0.001 to 100000 for " + std::string(what));
    value = *number;
    return {};
  }

  // Checks what is known only at the end of a step.
  Status close_step() const {
    const Step& step = sequence_.steps.back();
    const auto found = [&](std::string_view what) {
      return problem(step.line, 1, fmt::format("found step {} {}", step.number, what));
    };
    if (!has_initial_) return found("without its initial position, expected 'initial H 0 P 0 R 0'");
    if (step.items.size() == positioning_moves_) return found("with nothing to do, expected align, dwell or rotate");
    return {};
  }

  Status close_file() const {
    const int last = std::max(line_, 1);
    if (sequence_.steps.empty()) return problem(last, 1, "found the end of the file without a step, expected 'step 1'");
    TRY(close_step());
    if (!has_still_dwell_)
      return problem(last, 1, "found the end of the file without a dwell, expected at least one 'dwell SAMPLES'");
    return {};
  }

  static constexpr std::string_view first_item_expected =
      "'align' as the first item of the first step (the recording begins with an alignment)";

  std::string_view text_;
  std::string_view file_;
  int line_ = 0;
  std::vector<Token> tokens_;
  std::size_t next_ = 0;
  Sequence sequence_;
  AxisTriple commanded_deg_;
  std::size_t positioning_moves_ = 0;  // at the start of the current step
  bool has_format_ = false;
  bool has_initial_ = false;  // of the current step
  bool has_still_dwell_ = false;
};

}  // namespace

std::vector<SequenceItem> approach(const AxisTriple& from_deg, const AxisTriple& to_deg, double rate_degps,
                                   double acceleration_degps2, int line) {
  std::vector<SequenceItem> moves;
  for (const Axis axis : approach_order) {
    if (from_deg[axis] != to_deg[axis])
      moves.push_back(
          {SequenceItem::Kind::move, {axis, to_deg[axis], rate_degps, acceleration_degps2}, {}, line, true});
  }
  return moves;
}

Result<Sequence> read_sequence(const std::string& path) {
  std::error_code none;
  const std::filesystem::path program = std::filesystem::read_symlink("/proc/self/exe", none);
  const std::string installed = program.parent_path() / "../share/turncal/sequences" / path;
  const std::string& file = path_exists(path) ? path : installed;
  if (const std::string meant = file_meant(path); !path_exists(file))
    return input_error(path + ": there is no such file, and no sequence of turncal has this name: expected a sequence" +
                       (meant.empty() ? file_meant(installed) : meant));
  TRY(expect_file(file, FileKind::sequence));
  return parse_sequence(TRY(read_whole_file(file, largest_file_bytes)), file);
}

void append_steps(const Sequence& more, Sequence& sequence) {
  AxisTriple stands_deg = sequence.start_deg;
  int number = 0;
  for (const Step& step : sequence.steps) {
    number = std::max(number, step.number);
    for (const SequenceItem& item : step.items)
      if (item.kind == SequenceItem::Kind::move) stands_deg[item.move.axis] = item.move.target_deg;
  }
  for (const Step& step : more.steps) {
    sequence.steps.push_back(step);
    sequence.steps.back().number = ++number;
    sequence.steps.back().file = more.file;
    if (&step != &more.steps.front()) continue;
    const std::vector<SequenceItem> moves =
        approach(stands_deg, step.initial_deg, more.rate_degps, more.acceleration_degps2, step.line);
    std::vector<SequenceItem>& items = sequence.steps.back().items;
    items.insert(items.begin(), moves.begin(), moves.end());
  }
}

Result<Sequence> parse_sequence(const std::string& text, const std::string& file_name) {
  Sequence sequence = TRY(Parser(text, file_name).run());
  sequence.file = file_name;
  sequence.text = text;
  return sequence;
}

}  // namespace turncal
