#include "imu_io/base/crc.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>

#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace turncal {
namespace {

std::uint32_t reflected(std::uint32_t value, int width) {
  std::uint32_t result = 0;
  for (int bit = 0; bit < width; ++bit)
    if ((value >> bit & 1U) != 0) result |= 1U << (width - 1 - bit);
  return result;
}

constexpr std::string_view checksum_key = "checksum = ";

std::string checksum_line(std::string_view text) { return fmt::format("{}{:08x}\n", checksum_key, crc32c(text)); }

#if defined(__x86_64__)
__attribute__((target("sse4.2"))) std::uint32_t crc32c_sse42(std::span<const std::byte> data, std::uint32_t before) {
  const std::byte* p = data.data();
  std::size_t n = data.size();
  std::uint64_t crc = std::uint32_t(~before);
  for (; n >= 8; n -= 8, p += 8) {
    std::uint64_t word = 0;
    std::memcpy(&word, p, 8);
    crc = _mm_crc32_u64(crc, word);
  }
  std::uint32_t crc32 = std::uint32_t(crc);
  for (; n > 0; --n, ++p) crc32 = _mm_crc32_u8(crc32, std::to_integer<std::uint8_t>(*p));
  return ~crc32;
}
#endif

}  // namespace

// The register is left-aligned in 32 bits; with reflected input it is mirrored and right-aligned.
Crc::Crc(const CrcParameters& parameters) : parameters_(parameters) {
  const bool mirrored = parameters.reflect_input;
  const auto placed = [&](std::uint32_t value) {
    return mirrored ? reflected(value, parameters.width) : value << (32 - parameters.width);
  };
  const std::uint32_t polynomial = placed(parameters.polynomial);
  start_ = placed(parameters.initial);
  for (std::uint32_t byte = 0; byte < 256; ++byte) {
    std::uint32_t& state = table_[byte] = mirrored ? byte : byte << 24;
    for (int bit = 0; bit < 8; ++bit)
      state = mirrored ? (state >> 1) ^ ((state & 1U) * polynomial) : (state << 1) ^ ((state >> 31) * polynomial);
  }
}

std::uint32_t Crc::step(std::uint32_t state, std::uint32_t byte) const {
  if (parameters_.reflect_input) return (state >> 8) ^ table_[(state ^ byte) & 0xFFU];
  return (state << 8) ^ table_[(state >> 24) ^ byte];
}

std::uint32_t Crc::operator()(std::span<const std::byte> data, std::size_t zeros) const {
  std::uint32_t state = start_;
  for (const std::byte byte : data) state = step(state, std::to_integer<std::uint32_t>(byte));
  for (; zeros > 0; --zeros) state = step(state, 0);
  if (!parameters_.reflect_input) state >>= 32 - parameters_.width;
  if (parameters_.reflect_input != parameters_.reflect_output) state = reflected(state, parameters_.width);
  const std::uint32_t all = parameters_.width == 32 ? 0xFFFFFFFFU : (1U << parameters_.width) - 1U;
  return (state ^ parameters_.final_xor) & all;
}

std::uint32_t Crc::go_on(std::span<const std::byte> data, std::uint32_t before) const {
  std::uint32_t state = ~before;
  for (const std::byte byte : data) state = step(state, std::to_integer<std::uint32_t>(byte));
  return ~state;
}

std::string with_checksum(std::string text) {
  text += checksum_line(text);
  return text;
}

Result<std::string_view> without_checksum(std::string_view text, const std::string& file_name) {
  const std::size_t place = text.rfind("\n" + std::string(checksum_key));
  if (place == std::string_view::npos)
    return input_error(file_name + ": no checksum: expected 'checksum = ' and 8 hex digits in the last line");
  const std::string_view above = text.substr(0, place + 1);
  const std::string_view last = text.substr(place + 1);
  const std::string_view after = last.substr(std::min(last.size(), checksum_key.size() + 8));
  if (after != "\n" && after.find_first_not_of("\r\n") != std::string_view::npos)
    return input_error(file_name + ": text after the checksum: expected it to be the last line");
  if (last != checksum_line(above))
    return input_error(file_name + ": wrong checksum: the file was damaged or edited after it was written");
  return above;
}

std::uint32_t crc32c_portable(std::span<const std::byte> data, std::uint32_t before) {
  static const Crc crc({32, 0x1EDC6F41, 0xFFFFFFFF, true, true, 0xFFFFFFFF});
  return crc.go_on(data, before);
}

std::uint32_t crc32c(std::span<const std::byte> data, std::uint32_t before) {
#if defined(__x86_64__)
  static const bool has_instruction = __builtin_cpu_supports("sse4.2") != 0;
  if (has_instruction) return crc32c_sse42(data, before);
#endif
  return crc32c_portable(data, before);
}

std::uint32_t crc32c(std::string_view text, std::uint32_t before) {
  return crc32c(std::as_bytes(std::span(text.data(), text.size())), before);
}

}  // namespace turncal
