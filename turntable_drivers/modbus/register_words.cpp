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
    case WordType::f64: return {-1.0e300, 1.0e300};
  }
  return {0.0, 0.0};
}

constexpr std::pair<std::string_view, WordType> type_names[] = {{"u16", WordType::u16}, {"s16", WordType::s16},
                                                                {"u32", WordType::u32}, {"s32", WordType::s32},
                                                                {"f32", WordType::f32}, {"f64", WordType::f64}};

}  // namespace

std::optional<WordType> word_type_of(std::string_view name) {
  for (const auto& [known, type] : type_names) {
    if (known == name) return type;
  }
  return {};
}

std::string_view to_string(WordType type) {
  for (const auto& [name, known] : type_names) {
    if (known == type) return name;
  }
  return "";
}

double decode_words(std::span<const std::uint16_t> registers, WordType type, WordLayout layout) {
  const auto count = static_cast<std::size_t>(register_count(type));
  assert(registers.size() >= count);
  std::uint64_t all = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint16_t word = registers[layout.high_word_first ? i : count - 1 - i];
    all = all << 16 | (layout.swap_bytes ? bytes_swapped(word) : word);
  }
  switch (type) {
    case WordType::u16:
    case WordType::u32: return static_cast<double>(all);
    case WordType::s16: return static_cast<std::int16_t>(all);
    case WordType::s32: return static_cast<std::int32_t>(all);
    case WordType::f32: return static_cast<double>(std::bit_cast<float>(static_cast<std::uint32_t>(all)));
    case WordType::f64: break;
  }
  return std::bit_cast<double>(all);
}

std::optional<Words> encode_words(double value, WordType type, WordLayout layout) {
  const double wanted = is_floating(type) ? value : std::round(value);
  const Range range = range_of(type);
  if (!(wanted >= range.min && wanted <= range.max)) return {};
  // Through 64 bits, so that negative numbers keep their two's complement.
  const std::uint64_t all = type == WordType::f64   ? std::bit_cast<std::uint64_t>(wanted)
                            : type == WordType::f32 ? std::bit_cast<std::uint32_t>(static_cast<float>(wanted))
                                                    : static_cast<std::uint64_t>(static_cast<std::int64_t>(wanted));
  Words words;
  words.count = register_count(type);
  for (int i = 0; i < words.count; ++i) {
    const auto word = static_cast<std::uint16_t>(all >> (16 * i));
    const int place = layout.high_word_first ? words.count - 1 - i : i;
    words.value[static_cast<std::size_t>(place)] = layout.swap_bytes ? bytes_swapped(word) : word;
  }
  return words;
}

}  // namespace turncal
