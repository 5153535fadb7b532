// Formats numbers with the fewest digits that read back as the same number, and parses them strictly (the whole token, finite,
// no leading `+` or blanks); no locale. Also what every text reader needs: trimming, splitting, and quoting part of a user's file in a
// message.
#pragma once

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <concepts>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>
#include <vector>

#include "calib/types/status.h"
#include "calib/types/value_text.h"

namespace turncal {

// Large enough for the longest shortest-form double or 64-bit integer.
using NumberBuffer = std::array<char, 32>;

// Formats double, float and every integer type. -0.0 gives "-0". Numbers from 1e-4 to 1e15 have no exponent, which is easier
// to read ("0.0005", not "5e-04"); the digits are the same.
template <class T>
requires(std::integral<T> || std::floating_point<T>) std::string_view format_number(T value, NumberBuffer& buffer) {
  char* const begin = buffer.data();
  char* const end = begin + buffer.size();
  std::to_chars_result result{};
  if constexpr (std::floating_point<T>) {
    const T magnitude = std::abs(value);
    const bool plain = magnitude >= T(1e-4) && magnitude < T(1e15);
    result = plain ? std::to_chars(begin, end, value, std::chars_format::fixed) : std::to_chars(begin, end, value);
  } else {
    result = std::to_chars(begin, end, value);
  }
  return {buffer.data(), std::size_t(result.ptr - buffer.data())};
}

template <class T>
requires(std::integral<T> || std::floating_point<T>) std::string format_number(T value) {
  NumberBuffer buffer;
  return std::string(format_number(value, buffer));
}

template <class T = double>
requires std::floating_point<T> std::optional<T> parse_number(std::string_view token) {
  T value{};
  const auto result = std::from_chars(token.data(), token.data() + token.size(), value);
  if (result.ec != std::errc{} || result.ptr != token.data() + token.size() || !std::isfinite(value)) return {};
  return value;
}

// Empty also when the number is out of T's range.
template <class T = std::int64_t>
requires std::integral<T> std::optional<T> parse_integer(std::string_view token, int base = 10) {
  T value{};
  const auto result = std::from_chars(token.data(), token.data() + token.size(), value, base);
  if (result.ec != std::errc{} || result.ptr != token.data() + token.size()) return {};
  return value;
}

// Parses a decimal integer, or a hexadecimal one after 0x.
template <class T = std::int64_t>
std::optional<T> parse_whole(std::string_view token) {
  const bool hex = token.starts_with("0x") || token.starts_with("0X");
  return parse_integer<T>(hex ? token.substr(2) : token, hex ? 16 : 10);
}

// ---- pieces of text ----

// Removes blanks and tabs at both ends.
std::string_view trimmed(std::string_view text);

// Returns the trimmed parts between separators; an empty text has one empty part.
std::vector<std::string_view> split(std::string_view text, char separator);
// Returns the words between blanks, without empty ones.
std::vector<std::string_view> split_words(std::string_view text);
// Splits a row into `cells` and removes the quotes around them. A blank as separator stands for any run of blanks.
void split_cells(std::string_view row, char separator, std::vector<std::string_view>& cells);

// Returns the length in bytes and the code point of a text's first UTF-8 character (RFC 3629); 0 if it is not valid.
std::size_t utf8_character(std::string_view text, std::uint32_t* code = nullptr);
// Returns the same, but 0 for an unprintable character: a control character (C0, DEL, C1: U+0080 to U+009F), a line or paragraph
// separator, an invisible character (soft hyphen, zero width), or one that changes the direction of writing.
std::size_t printable_character(std::string_view text);

// Puts a text from a file in quotes for a message: one line, at most 60 bytes of it, unprintable characters as '?'.
std::string quoted(std::string_view text);

// Returns a path as a POSIX shell and turncal take it, for a line to paste: in quotes unless it is plain, never taken for an option.
std::string shell_path(std::string_view path);

// Removes the next line from the front and returns it without its LF or CRLF. had_end: the line had an end.
std::string_view next_line(std::string_view& text, bool* had_end = nullptr);

// Returns a text with the signs of units in ASCII: "(°/s)" is "(deg/s)", "m·s⁻²" "m.s^-2", "µs" "us".
std::string ascii_units(std::string_view text);

// Parses a number as devices and people write it: blanks around it, a leading + and the exponent letter D are allowed.
// decimal_comma: 1,5 is a number, too.
std::optional<double> device_number(std::string_view text, bool decimal_comma = false);

// "Did you mean ...?": finds the known word that was probably meant.
//
// The distance is the smallest number of letters inserted, deleted, replaced or swapped with their neighbour, with no part edited twice
// (optimal string alignment), ignoring case. A word is close up to (n + 1) / 3 edits, three at most, where n letters were typed.
std::size_t edit_distance(std::string_view a, std::string_view b);

// Returns "; did you mean 'run'?" to append to a message, or nothing when no word is close or the word itself is known. The beginning of
// a word up to a - stands for the word. Of equally close words it takes a whole one, then the one that shares the longest beginning
// with what was typed, then the first.
std::string did_you_mean(std::string_view typed, const std::vector<std::string>& known);
// Returns what a message says was expected instead of `typed`: "add, remove or stop; did you mean 'stop'?".
std::string one_of(std::string_view typed, const std::vector<std::string>& known);
// Returns "WHERE: there is no unit 'SN17'; did you mean 'SN1'?" unless `known` has the name.
Status check_known(const std::string& where, const std::string& what, const std::string& name,
                   const std::vector<std::string>& known);

// ---- enumerators and their words ----

// The words of an enumeration, in the order of its enumerators. Specialise it below the enumeration:
//   template <>
//   inline constexpr auto enum_words<Colour> = std::to_array({"red", "green"});
template <class Enum>
inline constexpr std::array<const char*, 0> enum_words{};
template <class Enum>
concept Worded = !enum_words<Enum>.empty();

template <Worded Enum>
std::vector<std::string> words_of() {
  return {enum_words<Enum>.begin(), enum_words<Enum>.end()};
}
template <Worded Enum>
constexpr const char* to_string(Enum one) {
  return enum_words<Enum>[std::size_t(one)];
}
template <Worded Enum>
std::optional<Enum> enum_from(std::string_view word) {
  const auto at = std::ranges::find(enum_words<Enum>, word);
  return at == enum_words<Enum>.end() ? std::nullopt : std::optional(static_cast<Enum>(at - enum_words<Enum>.begin()));
}

}  // namespace turncal
