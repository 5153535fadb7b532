#include "sequences/token.h"

#include "imu_io/base/format_number.h"

namespace turncal {

namespace {

constexpr std::size_t longest_shown = 40;

bool is_blank(char c) { return c == ' ' || c == '\t'; }
bool ends_word(char c) { return is_blank(c) || c == '=' || c == '#' || c == '"'; }

}  // namespace

std::optional<double> as_number(const Token& token) {
  std::string_view text = token.text;
  if (token.kind != Token::Kind::word || text.starts_with("+-")) return std::nullopt;
  if (text.starts_with('+'))
    text.remove_prefix(1);  // a turn is written with its sign, which parse_number does not take
  return parse_number(text);
}

std::optional<std::int64_t> as_integer(const Token& token) {
  return token.kind == Token::Kind::word ? parse_integer(token.text) : std::nullopt;
}

std::optional<Axis> as_axis(const Token& token) {
  if (is_word(token, "H") || is_word(token, "heading")) return Axis::heading;
  if (is_word(token, "P") || is_word(token, "pitch")) return Axis::pitch;
  if (is_word(token, "R") || is_word(token, "roll")) return Axis::roll;
  return std::nullopt;
}

bool is_word(const Token& token, std::string_view word) {
  return token.kind == Token::Kind::word && token.text == word;
}

std::string shown(const Token& token) {
  if (token.kind == Token::Kind::end) return "the end of the line";
  std::string text;
  for (const char c : token.text.substr(0, longest_shown)) text += (c >= ' ' && c <= '~') ? c : '?';
  if (token.text.size() > longest_shown) text += "...";
  return token.kind == Token::Kind::title ? "the title \"" + text + "\"" : "'" + text + "'";
}

Error problem_at(const Place& place, std::string_view what) {
  std::string message(place.file);
  message += ":" + std::to_string(place.line) + ":" + std::to_string(place.column) + ": ";
  message += what;
  return input_error(std::move(message));
}

Error unexpected(const Place& place, const Token& found, std::string_view expected) {
  const std::string what = "found " + shown(found) + ", expected " + std::string(expected);
  return problem_at({place.file, place.line, found.column}, what);
}

Result<std::vector<Token>> tokenize(std::string_view line, std::string_view file, int line_number) {
  std::vector<Token> tokens;
  std::size_t at = 0;
  while (at < line.size() && line[at] != '#') {
    const char c = line[at];
    const int column = static_cast<int>(at) + 1;
    if (is_blank(c)) {
      ++at;
    } else if (c == '=') {
      tokens.push_back({Token::Kind::equals, line.substr(at, 1), column});
      ++at;
    } else if (c == '"') {
      const std::size_t close = line.find('"', at + 1);
      if (close == std::string_view::npos) {
        return unexpected({file, line_number, column}, {Token::Kind::word, line.substr(at), column},
                          "a title that ends with '\"' on the same line");
      }
      tokens.push_back({Token::Kind::title, line.substr(at + 1, close - at - 1), column});
      at = close + 1;
    } else {
      std::size_t end = at;
      while (end < line.size() && !ends_word(line[end])) ++end;
      tokens.push_back({Token::Kind::word, line.substr(at, end - at), column});
      at = end;
    }
  }
  tokens.push_back({Token::Kind::end, {}, static_cast<int>(at) + 1});
  return tokens;
}

}  // namespace turncal
