#include "turntable_drivers/modbus/register_words.h"

#include <bit>
#include <cassert>
#include <cmath>
#include <utility>

namespace turncal {
namespace {

std::uint16_t bytes_swapped(std::uint16_t word) { return static_cast<std::uint16_t>(word << 8 | word >> 8); }

struct Range {
  double min, max;
};
Range range_of(WordType type) {
  switch (type) {
    case WordType::u16: return {0.0, 65535.0};
    case WordType::s16: return {-32768.0, 32767.0};
    case WordType::u32: return {0.0, 4294967295.0};
    case WordType::s32: return {-2147483648.0, 2147483647.0};
    case WordType::f32: return {-3.0e38, 3.0e38};
  }
  return {0.0, 0.0};
}

}  // namespace

double decode_words(std::span<const std::uint16_t> registers, WordType type, WordLayout layout) {
  assert(registers.size() >= static_cast<std::size_t>(register_count(type)));
  std::uint16_t first = registers[0];
  if (layout.swap_bytes) first = bytes_swapped(first);
  if (type == WordType::u16) return first;
  if (type == WordType::s16) return static_cast<std::int16_t>(first);
  std::uint16_t second = registers[1];
  if (layout.swap_bytes) second = bytes_swapped(second);
  if (!layout.high_word_first) std::swap(first, second);
  const std::uint32_t all = static_cast<std::uint32_t>(first) << 16 | second;
  if (type == WordType::u32) return all;
  if (type == WordType::s32) return static_cast<std::int32_t>(all);
  return static_cast<double>(std::bit_cast<float>(all));
}

std::optional<Words> encode_words(double value, WordType type, WordLayout layout) {
  const bool is_whole = type != WordType::f32;
  const double wanted = is_whole ? std::round(value) : value;
  const Range range = range_of(type);
  if (!(wanted >= range.min && wanted <= range.max)) return {};
  // Through 64 bits, so that negative numbers keep their two's complement.
  const std::uint32_t all = is_whole ? static_cast<std::uint32_t>(static_cast<std::int64_t>(wanted))
                                     : std::bit_cast<std::uint32_t>(static_cast<float>(wanted));
  Words words;
  words.count = register_count(type);
  if (words.count == 1) {
    words.value[0] = static_cast<std::uint16_t>(all);
  } else {
    words.value = {static_cast<std::uint16_t>(all >> 16), static_cast<std::uint16_t>(all)};
    if (!layout.high_word_first) std::swap(words.value[0], words.value[1]);
  }
  if (layout.swap_bytes) {
    for (std::uint16_t& word : words.value) word = bytes_swapped(word);
  }
  return words;
}

}  // namespace turncal
