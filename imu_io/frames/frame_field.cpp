#include "imu_io/frames/frame_field.h"

namespace turncal {
namespace {

// What is added up: bytes, or words filled up with a zero byte.
template <typename Take>
void for_each_part(const FrameCheck& check, std::span<const std::byte> covered, const Take& take) {
  const auto at = [&](std::size_t i) { return i < covered.size() ? std::to_integer<std::uint32_t>(covered[i]) : 0U; };
  if (!check.of_words) {
    for (std::size_t i = 0; i < covered.size(); ++i) take(at(i));
    return;
  }
  for (std::size_t i = 0; i < covered.size(); i += 2)
    take(check.words_big_endian ? at(i) << 8 | at(i + 1) : at(i + 1) << 8 | at(i));
}

// At most 1024 parts of 16 bits: no carry is lost in 64.
std::uint32_t sum(const FrameCheck& check, std::span<const std::byte> covered) {
  std::uint64_t total = 0;
  for_each_part(check, covered, [&](std::uint32_t part) { total += part; });
  const int bits = 8 * check.bytes();
  while (check.end_around && total >> bits != 0) total = (total & ((std::uint64_t{1} << bits) - 1)) + (total >> bits);
  return static_cast<std::uint32_t>(total);
}

std::uint32_t fletcher(const FrameCheck& check, std::span<const std::byte> covered) {
  std::uint32_t a = 0;
  std::uint32_t b = 0;
  for_each_part(check, covered, [&](std::uint32_t part) {
    a = (a + part) % check.modulus;
    b = (b + a) % check.modulus;
  });
  return b << (check.of_words ? 16 : 8) | a;
}

}  // namespace

std::size_t check_offset(const FrameCheck& check, std::size_t frame_length) {
  if (!check.from_end) return check.field.offset();
  return frame_length - std::min(check.field.offset(), frame_length);
}

std::uint32_t frame_check_value(const FrameCheck& check, const Crc& crc, std::span<const std::byte> frame) {
  const std::size_t end = check_offset(check, frame.size()) - check.gap;
  const auto covered = frame.subspan(check.start, end - check.start);
  std::uint32_t value = 0;
  switch (check.kind) {
    case CheckKind::none: break;
    case CheckKind::sum: value = sum(check, covered); break;
    case CheckKind::exclusive_or: for_each_part(check, covered, [&](std::uint32_t part) { value ^= part; }); break;
    case CheckKind::crc: value = crc(covered, (check.pad - covered.size() % check.pad) % check.pad); break;
    case CheckKind::fletcher: value = fletcher(check, covered); break;
  }
  if (check.complement != Complement::none) value = ~value + (check.complement == Complement::twos ? 1U : 0U);
  return check.bytes() == 4 ? value : value & ((1U << (8 * check.bytes())) - 1U);
}

}  // namespace turncal
