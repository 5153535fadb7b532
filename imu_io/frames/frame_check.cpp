#include "imu_io/frames/frame_check.h"

#include <algorithm>
#include <cmath>

#include "imu_io/frames/frame_description.h"
#include "imu_io/frames/frame_keys.h"

namespace turncal {
namespace {

void read_crc(FrameKeys& keys, CrcParameters& crc) {
  KeyValueFile& file = keys.file();
  int width = static_cast<int>(file.integer("crc.width", 8, 32));
  if (width % 8 != 0) file.reject("crc.width", "8, 16, 24 or 32");
  width = std::clamp(width / 8 * 8, 8, 32);
  const std::uint64_t most = (std::uint64_t{1} << width) - 1;
  const auto read_bits = [&](const char* key, std::optional<std::uint64_t> otherwise) {
    const std::uint64_t value = keys.bits(key, otherwise);
    if (value > most) file.reject(key, "at most " + std::to_string(width) + " bits");
    return static_cast<std::uint32_t>(value & most);
  };
  crc.width = width;
  crc.polynomial = read_bits("crc.polynomial", std::nullopt);
  if (crc.polynomial % 2 == 0) file.reject("crc.polynomial", "an odd number: the term 1 is in every polynomial");
  crc.initial = read_bits("crc.initial", 0);
  crc.final_xor = read_bits("crc.final_xor", 0);
  crc.reflect_input = file.boolean_or("crc.reflect_input", false);
  crc.reflect_output = file.boolean_or("crc.reflect_output", false);
}

// What is added up: bytes, or words filled up with a zero byte.
template <typename Take>
void for_each_part(const FrameCheck& check, std::span<const std::byte> covered, const Take& take) {
  const auto at = [&](std::size_t i) { return i < covered.size() ? std::to_integer<std::uint32_t>(covered[i]) : 0U; };
  if (!check.of_words) {
    for (std::size_t i = 0; i < covered.size(); ++i) take(at(i));
    return;
  }
  for (std::size_t i = 0; i < covered.size(); i += 2) {
    take(check.words_big_endian ? at(i) << 8 | at(i + 1) : at(i + 1) << 8 | at(i));
  }
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

FrameCheck read_frame_check(FrameKeys& keys) {
  FrameCheck check;
  KeyValueFile& file = keys.file();
  const std::string kind =
      file.one_of("check", {"none", "sum8", "sum16", "sum32", "xor8", "xor16", "crc", "fletcher16", "fletcher32"});
  if (kind == "none" || kind.empty()) return check;
  check.kind = kind == "crc"                ? CheckKind::crc
               : kind.starts_with("xor")    ? CheckKind::exclusive_or
               : kind.starts_with("fletch") ? CheckKind::fletcher
                                            : CheckKind::sum;
  check.field.form.bytes = kind.ends_with("32") ? 4 : kind.ends_with("16") ? 2 : 1;
  if (check.kind == CheckKind::crc) {
    read_crc(keys, check.crc);
    check.field.form.bytes = check.crc.width / 8;
  }
  const std::string order_key = file.has("check.order") ? "check.order" : "order";
  check.field.form.big_endian = file.one_of_or(order_key, "little", {"little", "big"}) == "big";
  check.words_big_endian = check.field.form.big_endian;
  if (check.kind == CheckKind::fletcher) {
    check.of_words = kind == "fletcher32";
    const std::int64_t most = check.of_words ? 65536 : 256;
    const std::int64_t modulus = file.integer_or("check.modulus", most - 1, most - 1, most);
    check.modulus = static_cast<std::uint32_t>(std::clamp(modulus, most - 1, most));
  } else if (check.kind != CheckKind::crc) {
    check.of_words = kind == "xor16" || (kind != "sum8" && kind != "xor8" &&
                                         file.one_of_or("check.of", "bytes", {"bytes", "words"}) == "words");
    if (check.kind == CheckKind::sum) {
      check.end_around = file.one_of_or("check.carry", "dropped", {"dropped", "end_around"}) == "end_around";
    }
    const std::string complement = file.one_of_or("check.complement", "none", {"none", "ones", "twos"});
    check.complement = complement == "ones"   ? Complement::ones
                       : complement == "twos" ? Complement::twos
                                              : Complement::none;
  }
  if (check.of_words && file.has("check.word_order")) {
    check.words_big_endian = file.one_of("check.word_order", {"little", "big"}) == "big";
  }
  constexpr auto far = static_cast<std::int64_t>(longest_frame);
  const std::int64_t offset = file.integer("check.offset", -far, far);
  check.from_end = offset < 0;
  check.field.offset = static_cast<std::size_t>(std::abs(offset));
  check.start = static_cast<std::size_t>(file.integer_or("check.start", 0, 0, far));
  check.gap = static_cast<std::size_t>(file.integer_or("check.gap", 0, 0, far));
  check.pad = static_cast<std::size_t>(file.integer_or("check.pad", 1, 1, 64));
  return check;
}

std::size_t check_offset(const FrameCheck& check, std::size_t frame_length) {
  if (!check.from_end) return check.field.offset;
  return check.field.offset <= frame_length ? frame_length - check.field.offset : frame_length;
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
