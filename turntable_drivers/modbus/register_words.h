// A number as 16-bit Modbus registers and back: pure functions.
//
// A 32-bit value takes two registers, f64 four. Word order: whether the highest or the lowest comes first; it differs between makers. Byte swap: the two bytes
// of every register are exchanged as well. Signed values are two's complement; f32 and f64 are IEEE 754. Registers are given in the
// order of their addresses.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

namespace turncal {

enum class WordType { u16, s16, u32, s32, f32, f64 };
constexpr int register_count(WordType type) {
  return type == WordType::u16 || type == WordType::s16 ? 1 : type == WordType::f64 ? 4 : 2;
}
constexpr bool is_floating(WordType type) { return type == WordType::f32 || type == WordType::f64; }
// "u16" ... "f64"
std::optional<WordType> word_type_of(std::string_view name);
std::string_view to_string(WordType type);

struct WordLayout {
  bool high_word_first = true;
  bool swap_bytes = false;
};

struct Words {
  std::array<std::uint16_t, 4> value{};
  int count = 0;
  std::span<const std::uint16_t> span() const { return {value.data(), static_cast<std::size_t>(count)}; }
};

// REQUIRES: at least register_count(type) registers. NaN and infinity come back as they are.
double decode_words(std::span<const std::uint16_t> registers, WordType type, WordLayout layout);

// Rounded to the nearest whole number (not f32 and f64). Empty: not finite, or beyond the type.
std::optional<Words> encode_words(double value, WordType type, WordLayout layout);

}  // namespace turncal
