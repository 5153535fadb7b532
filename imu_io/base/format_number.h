// Numbers as text and back, without locale: the fewest digits that read back as the same number, and strict parsing
// (the whole token, finite, no leading `+` or blanks).
#pragma once

#include <array>
#include <charconv>
#include <cmath>
#include <concepts>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>

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
  return {buffer.data(), static_cast<std::size_t>(result.ptr - buffer.data())};
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

}  // namespace turncal
