#include "imu_io/base/crc.h"

namespace turncal {
namespace {

std::uint32_t reflected(std::uint32_t value, int width) {
  std::uint32_t result = 0;
  for (int bit = 0; bit < width; ++bit) {
    if ((value >> bit & 1U) != 0) result |= 1U << (width - 1 - bit);
  }
  return result;
}

}  // namespace

// The register stands at the top of 32 bits when bits enter there, at the bottom and mirrored when input is reflected.
Crc::Crc(const CrcParameters& parameters) : parameters_(parameters) {
  const int width = parameters.width;
  const int shift = 32 - width;
  if (parameters.reflect_input) {
    const std::uint32_t polynomial = reflected(parameters.polynomial, width);
    start_ = reflected(parameters.initial, width);
    for (std::uint32_t byte = 0; byte < 256; ++byte) {
      std::uint32_t state = byte;
      for (int bit = 0; bit < 8; ++bit) state = (state >> 1) ^ ((state & 1U) != 0 ? polynomial : 0U);
      table_[byte] = state;
    }
  } else {
    const std::uint32_t polynomial = parameters.polynomial << shift;
    start_ = parameters.initial << shift;
    for (std::uint32_t byte = 0; byte < 256; ++byte) {
      std::uint32_t state = byte << 24;
      for (int bit = 0; bit < 8; ++bit) state = (state << 1) ^ ((state & 0x80000000U) != 0 ? polynomial : 0U);
      table_[byte] = state;
    }
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

}  // namespace turncal
