#include "imu_io/base/text.h"

#include <algorithm>
#include <cctype>
#include <tuple>

namespace turncal {

std::string_view trimmed(std::string_view text) {
  const auto blank = [](char c) { return c == ' ' || c == '\t'; };
  while (!text.empty() && blank(text.front())) text.remove_prefix(1);
  while (!text.empty() && blank(text.back())) text.remove_suffix(1);
  return text;
}

std::vector<std::string_view> split(std::string_view text, char separator) {
  std::vector<std::string_view> parts;
  for (;;) {
    const std::size_t end = text.find(separator);
    parts.push_back(trimmed(text.substr(0, end)));
    if (end == std::string_view::npos) return parts;
    text.remove_prefix(end + 1);
  }
}

std::vector<std::string_view> split_words(std::string_view text) {
  std::vector<std::string_view> words = split(text, ' ');
  std::erase_if(words, [](std::string_view word) { return word.empty(); });
  return words;
}

void split_cells(std::string_view row, char separator, std::vector<std::string_view>& cells) {
  cells.clear();
  const std::string_view separators = separator == ' ' ? std::string_view(" \t") : std::string_view(&separator, 1);
  for (std::size_t at = 0; at <= row.size();) {
    if (separator == ' ') at = std::min(row.find_first_not_of(separators, at), row.size());
    if (separator == ' ' && at == row.size()) break;
    const std::size_t end =
        std::min(separator == ' ' ? row.find_first_of(separators, at) : row.find(separator, at), row.size());
    std::string_view cell = trimmed(row.substr(at, end - at));
    if (cell.size() > 1 && cell.front() == '"' && cell.back() == '"') cell = trimmed(cell.substr(1, cell.size() - 2));
    cells.push_back(cell);
    at = end + 1;
  }
}

std::size_t utf8_character(std::string_view text, std::uint32_t* code) {
  if (text.empty()) return 0;
  const auto byte = [&text](std::size_t i) { return std::uint32_t(static_cast<unsigned char>(text[i])); };
  const std::uint32_t first = byte(0);
  const std::size_t length = first < 0x80 ? 1 : first >= 0xF0 ? 4 : first >= 0xE0 ? 3 : 2;
  if ((first >= 0x80 && first < 0xC2) || first > 0xF4 || text.size() < length) return 0;
  std::uint32_t point = length == 1 ? first : first & (0x7FU >> length);
  for (std::size_t i = 1; i < length; ++i) {
    if ((byte(i) & 0xC0) != 0x80) return 0;
    point = point << 6 | (byte(i) & 0x3F);
  }
  constexpr std::uint32_t least[] = {0, 0, 0x80, 0x800, 0x10000};  // a smaller code point has a shorter encoding
  if (point < least[length] || point > 0x10FFFF || (point >= 0xD800 && point <= 0xDFFF)) return 0;
  if (code) *code = point;
  return length;
}

std::size_t printable_character(std::string_view text) {
  std::uint32_t code = 0;
  const std::size_t length = utf8_character(text, &code);
  const bool control = code < 0x20 || (code >= 0x7F && code <= 0x9F);
  const bool turns = code == 0x061C || code == 0x200E || code == 0x200F || (code >= 0x2028 && code <= 0x202E) ||
                     (code >= 0x2066 && code <= 0x2069);
  const bool unseen = code == 0xAD || code == 0x180E || (code >= 0x200B && code <= 0x200D) ||
                      (code >= 0x2060 && code <= 0x2064) || code == 0xFEFF;
  return control || turns || unseen ? 0 : length;
}

std::string quoted(std::string_view text) {
  constexpr std::size_t longest = 60;
  std::string result = "'";
  std::string_view remaining = text.substr(0, longest);
  while (!remaining.empty()) {
    const std::size_t length = printable_character(remaining);
    result += length > 0 ? remaining.substr(0, length) : "?";
    remaining.remove_prefix(std::max<std::size_t>(length, 1));
  }
  if (text.size() > longest) result += "...";
  result += '\'';
  return result;
}

std::string shell_path(std::string_view path) {
  const std::string text = (path.starts_with('-') ? "./" : "") + std::string(path);
  const auto plain = [](unsigned char c) {
    return std::isalnum(c) || std::string_view("/._-+:,=@").find(char(c)) != std::string_view::npos;
  };
  if (!text.empty() && std::ranges::all_of(text, plain)) return text;
  std::string word = "'";
  for (const char c : text) word += c == '\'' ? "'\\''" : std::string(1, c);
  return word + "'";
}

std::string_view next_line(std::string_view& text, bool* had_end) {
  const std::size_t end = text.find('\n');
  std::string_view line = text.substr(0, end);
  text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
  if (line.ends_with('\r')) line.remove_suffix(1);
  if (had_end != nullptr) *had_end = end != std::string_view::npos;
  return line;
}

std::string ascii_units(std::string_view text) {
  constexpr std::pair<std::string_view, std::string_view> signs[] = {{"°", "deg"},  {"º", "deg"}, {"⁻¹", "^-1"},
                                                                     {"⁻²", "^-2"}, {"²", "^2"},  {"·", "."},
                                                                     {"⋅", "."},    {"µ", "u"},   {"μ", "u"}};
  std::string plain(text);
  for (const auto& [sign, ascii] : signs)
    for (std::size_t at = 0; (at = plain.find(sign, at)) != plain.npos;) plain.replace(at, sign.size(), ascii);
  return plain;
}

std::optional<double> device_number(std::string_view text, bool decimal_comma) {
  text = trimmed(text);
  if (text.starts_with('+') && text.size() > 1 && text[1] != '-') text.remove_prefix(1);
  if (const std::optional<double> number = parse_number(text)) return number;
  std::string plain(text);
  if (decimal_comma && text.find('.') == text.npos) std::ranges::replace(plain, ',', '.');
  std::ranges::replace(plain, 'D', 'E');
  return parse_number(plain);
}

std::size_t edit_distance(std::string_view a, std::string_view b) {
  // rows[k] is for a's first i - k letters.
  std::array<std::vector<std::size_t>, 3> rows;
  for (auto& row : rows) row.resize(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) rows[0][j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::rotate(rows.begin(), rows.end() - 1, rows.end());
    rows[0][0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const bool same = std::tolower(std::uint8_t(a[i - 1])) == std::tolower(std::uint8_t(b[j - 1]));
      rows[0][j] = std::min({rows[1][j] + 1, rows[0][j - 1] + 1, rows[1][j - 1] + (same ? 0 : 1)});
      if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1])
        rows[0][j] = std::min(rows[0][j], rows[2][j - 2] + 1);
    }
  }
  return rows[0][b.size()];
}

std::string did_you_mean(std::string_view typed, const std::vector<std::string>& known) {
  constexpr std::size_t longest = 80;  // no word that anybody means is longer; it bounds the work
  if (typed.empty() || typed.size() > longest) return "";
  const std::size_t most = std::min<std::size_t>(3, (typed.size() + 1) / 3);
  std::tuple<std::size_t, bool, std::ptrdiff_t> closest(most, true, 1);
  std::string meant;
  for (const std::string& word : known) {
    if (word == typed) return "";
    if (word.empty() || word.size() > longest) continue;
    const std::ptrdiff_t alike = typed.begin() - std::ranges::mismatch(typed, word).in1;
    for (std::size_t end = 0; end < word.size(); ++end) {
      end = std::min(word.find('-', end), word.size());
      const std::tuple distance(edit_distance(typed, word.substr(0, end)), end < word.size(), alike);
      if (end > 0 && distance < closest) std::tie(closest, meant) = std::tuple(distance, word);
    }
  }
  return meant.empty() ? "" : "; did you mean " + turncal::quoted(meant) + "?";
}

std::string one_of(std::string_view typed, const std::vector<std::string>& known) {
  constexpr std::size_t shown = 20;
  std::string words;
  for (std::size_t k = 0; k < std::min(shown, known.size()); ++k)
    words += (k == 0 ? "" : k + 1 == known.size() ? " or " : ", ") + known[k];
  return words + (known.size() > shown ? ", ..." : "") + did_you_mean(typed, known);
}

Status check_known(const std::string& where, const std::string& what, const std::string& name,
                   const std::vector<std::string>& known) {
  if (std::ranges::find(known, name) != known.end()) return {};
  return input_error(where + ": there is no " + what + " " + turncal::quoted(name) +
                     (known.empty() ? ": there is none at all" : did_you_mean(name, known)));
}

}  // namespace turncal
