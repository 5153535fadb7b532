// Numbers as text and back, without locale: the fewest digits that read back as the same number, and strict parsing
// (the whole token, finite, no leading `+` or blanks). Small pieces that every text reader needs: trimming, splitting, and showing a stretch
// of somebody's file in a message.
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

namespace turncal {

// Room for the longest shortest-form double or 64-bit integer.
using NumberBuffer = std::array<char, 32>;

// double, float and every integer type. -0.0 gives "-0". From 1e-4 to 1e15 without an exponent, which people read more
// easily ("0.0005", not "5e-04"); the digits are the same.
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

// Out of T's range is a failure.
template <class T = std::int64_t>
requires std::integral<T> std::optional<T> parse_integer(std::string_view token, int base = 10) {
  T value{};
  const auto result = std::from_chars(token.data(), token.data() + token.size(), value, base);
  if (result.ec != std::errc{} || result.ptr != token.data() + token.size()) return {};
  return value;
}

// Decimal, or hexadecimal after 0x.
template <class T = std::int64_t>
std::optional<T> parse_whole(std::string_view token) {
  const bool hex = token.starts_with("0x") || token.starts_with("0X");
  return parse_integer<T>(hex ? token.substr(2) : token, hex ? 16 : 10);
}

// ---- pieces ----

// Without blanks and tabs at both ends.
std::string_view trimmed(std::string_view text);

// The parts between separators, trimmed; one empty part for an empty text.
std::vector<std::string_view> split(std::string_view text, char separator);
// Those between blanks, the empty ones left out.
std::vector<std::string_view> split_words(std::string_view text);
// Into `cells`, without the quotes about them; between any run of blanks where the separator is one.
void split_cells(std::string_view row, char separator, std::vector<std::string_view>& cells);

// How many bytes the first character of a UTF-8 text has (RFC 3629), and its code point; 0 when it is none.
std::size_t utf8_character(std::string_view text, std::uint32_t* code = nullptr);
// The same; 0 too for one that is not printed: a control character (C0, DEL, C1: U+0080 to U+009F), a line or paragraph
// separator, or one that turns the direction of writing.
std::size_t printable_character(std::string_view text);

// 'text' in quotes, on one line and of bounded length, whatever stood in the file.
std::string quoted(std::string_view text);

// Takes the next line off the front, without its LF or CRLF. had_end: whether there was one.
std::string_view next_line(std::string_view& text, bool* had_end = nullptr);

// A number as devices and people write it: blanks around it and a leading + are allowed; nothing else beside the number is.
// decimal_comma: 1,5 is one, too.
std::optional<double> device_number(std::string_view text, bool decimal_comma = false);

// "Did you mean ...?": the known word that somebody probably meant to type.
//
// Distance: the smallest number of letters inserted, left out, replaced or swapped with their neighbour, no stretch edited twice
// (optimal string alignment), in either case. Close is up to one error for every three letters of what was typed, three at most.
std::size_t edit_distance(std::string_view a, std::string_view b);

// "; did you mean 'run'?", to put behind a message; nothing when no word is close. Of equally close ones: the one
// with the longest beginning typed as it is, then the first.
std::string did_you_mean(std::string_view typed, const std::vector<std::string>& known);

// ---- enumerators and their words ----

// In the order of the enumerators, said below the enumeration:
//   template <>
//   inline constexpr auto enum_words<Colour> = std::to_array({"red", "green"});
template <class Enum>
inline constexpr std::array<const char*, 0> enum_words{};
template <class Enum>
concept Worded = !enum_words<Enum>.empty();

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
