// Reads and writes the numbers in frames. A description is compiled into shifts, so that one loop serves every byte and word order.
#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "imu_io/base/crc.h"

namespace turncal {

// Byte stuffing keeps the bytes that mark a frame out of its contents. Offsets and checks of a description refer to the unstuffed
// bytes; sync and tail are sent unchanged.
//
//   escape    a byte with a special meaning is sent as `byte`, followed by itself xor `flip`           (HDLC, RFC 1662: 7D, 20)
//   slip      C0 is sent as DB DC, DB as DB DD                                                         (RFC 1055)
//   repeat    `byte` in the contents is sent twice; sync and tail begin with a single one              (DLE STX ... DLE ETX)
//   cobs      consistent overhead byte stuffing: a 00 ends every frame and occurs nowhere else (Cheshire, Baker, IEEE/ACM ToN 7, 1999).
//             The 00 before the contents is the sync, byte 0 of the frame: sent by the unit, or the end of the frame before
// A lost byte destroys only its own frame. Not modelled: bit stuffing, COBS/R and other variants.

enum class StuffingKind { none, escape, slip, repeat, cobs };

struct ByteStuffing {
  StuffingKind kind = StuffingKind::none;
  std::byte byte{0x7D};
  std::byte flip{0x20};
};

// Removes the stuffing from a stream that arrives in pieces.
class Unstuffer {
 public:
  explicit Unstuffer(const ByteStuffing& stuffing) : stuffing_(stuffing) {}
  // The bytes data[1, 1 + count) are new. Writes the unstuffed ones from data[0] on and returns their number, at most count + 1.
  std::size_t unstuff(std::byte* data, std::size_t count);
  void restart();

 private:
  std::byte* decode_cobs(std::byte now, std::byte* to);

  ByteStuffing stuffing_;
  bool pending_ = false;  // the last byte was `byte`; the next one gives its meaning
  // COBS: bytes left in the group (none after a 00); a 00 follows the group unless the frame ends; the last byte was a 00.
  int group_ = 0;
  bool zero_due_ = false;
  bool ended_ = false;
};

// Appends a frame to `out` as it is sent over the line. Its first `sync` and last `tail` bytes are not stuffed.
void append_stuffed(const ByteStuffing& stuffing, std::span<const std::byte> frame, std::size_t sync, std::size_t tail,
                    std::vector<std::byte>& out);

// ---- fields ----

// The layout of a number in a frame.
enum class NumberType { unsigned_integer, signed_integer, sign_magnitude, floating };

struct FieldForm {
  NumberType type = NumberType::unsigned_integer;
  int bytes = 1;                           // 1, 2, 3, 4 or 8; floating: 4 or 8
  bool big_endian = false;                 // bytes within a 16-bit word, and the words too unless swapped
  bool swap_words = false;                 // reverses the order of the 16-bit words
  std::uint64_t mask = ~std::uint64_t{0};  // the masked raw bits are shifted down; the highest one is the sign
};

class FrameField {
 public:
  FrameField() : FrameField(0, {}) {}
  FrameField(std::size_t offset, const FieldForm& form) : offset_(offset), form_(form) {
    for (int i = 0; i < 8 && i < form_.bytes; ++i) {
      // The significance of byte i: first within its word, then that of the word.
      int place = i;
      if (form_.big_endian) place = form_.bytes - 1 - place;
      if (form_.swap_words) place = (form_.bytes / 2 - 1 - place / 2) * 2 + place % 2;
      shift_[i] = static_cast<unsigned char>(8 * place);
    }
    mask_ = form_.mask & (~std::uint64_t{0} >> (64 - 8 * form_.bytes));
    down_ = mask_ == 0 ? 0 : std::countr_zero(mask_);
    bits_ = std::max(64 - std::countl_zero(mask_) - down_, 1);
    used_ = ~std::uint64_t{0} >> (64 - bits_);
  }

  std::size_t offset() const { return offset_; }
  const FieldForm& form() const { return form_; }
  void shift(std::size_t bytes) { offset_ += bytes; }
  std::size_t bytes() const { return std::size_t(form_.bytes); }
  std::size_t end() const { return offset_ + bytes(); }
  // The largest value that fits, 2^bits - 1.
  std::uint64_t largest_bits() const { return used_; }
  int bits() const { return bits_; }  // width of the masked value
  NumberType type() const { return form_.type; }

  // All functions below REQUIRE that `frame` extends to offset + bytes.
  std::uint64_t bits_at(const std::byte* place) const {
    std::uint64_t value = 0;
    for (int i = 0; i < form_.bytes; ++i) value |= std::to_integer<std::uint64_t>(place[i]) << shift_[i];
    return (value & mask_) >> down_;
  }
  std::uint64_t bits_of(const std::byte* frame) const { return bits_at(frame + offset_); }
  // Integers beyond 2^53 lose their lowest bits; a float may be NaN or infinite.
  double number(const std::byte* frame) const { return number_from(bits_of(frame)); }
  double number_from(std::uint64_t value) const {
    switch (form_.type) {
      case NumberType::unsigned_integer: return double(value);
      case NumberType::signed_integer: return double(signed_from(value));
      case NumberType::sign_magnitude: {
        const std::uint64_t sign = std::uint64_t{1} << (bits_ - 1);
        const auto magnitude = double(value & (sign - 1));
        return (value & sign) != 0 ? -magnitude : magnitude;
      }
      case NumberType::floating: break;
    }
    if (form_.bytes == 4) return double(std::bit_cast<float>(std::uint32_t(value)));
    return std::bit_cast<double>(value);
  }
  std::int64_t signed_from(std::uint64_t value) const {
    const std::uint64_t sign = std::uint64_t{1} << (bits_ - 1);
    return std::int64_t((value ^ sign) - sign);
  }

  // Leaves bits outside the mask unchanged; a value that is too large is truncated.
  void put_bits_at(std::byte* place, std::uint64_t value) const {
    const std::uint64_t placed = (value << down_) & mask_;
    for (int i = 0; i < form_.bytes; ++i) {
      const auto keep = std::to_integer<std::uint64_t>(place[i]) & ~(mask_ >> shift_[i]);
      place[i] = static_cast<std::byte>((keep | (placed >> shift_[i])) & 0xFFU);
    }
  }
  void put_bits(std::byte* frame, std::uint64_t value) const { put_bits_at(frame + offset_, value); }
  // Returns false when the number does not fit the field.
  bool put_number(std::byte* frame, double value) const;

 private:
  std::size_t offset_;
  FieldForm form_;
  unsigned char shift_[8] = {};
  std::uint64_t mask_, used_;
  int down_, bits_;
};

inline bool FrameField::put_number(std::byte* frame, double value) const {
  if (form_.type == NumberType::floating) {
    if (form_.bytes == 4)
      put_bits(frame, std::bit_cast<std::uint32_t>(float(value)));
    else
      put_bits(frame, std::bit_cast<std::uint64_t>(value));
    return true;
  }
  const double whole = std::nearbyint(value);
  if (form_.type == NumberType::sign_magnitude) {
    const double end_of_magnitude = std::ldexp(1.0, bits_ - 1);
    if (!(std::abs(whole) < end_of_magnitude)) return false;
    const auto sign = whole < 0.0 ? std::uint64_t{1} << (bits_ - 1) : 0;
    put_bits(frame, sign | std::uint64_t(std::abs(whole)));
    return true;
  }
  const bool is_signed = form_.type == NumberType::signed_integer;
  const double low = is_signed ? -std::ldexp(1.0, bits_ - 1) : 0.0;
  const double end = std::ldexp(1.0, is_signed ? bits_ - 1 : bits_);
  if (!(whole >= low && whole < end)) return false;
  put_bits(frame, is_signed ? std::uint64_t(std::int64_t(whole)) : std::uint64_t(whole));
  return true;
}

// The check of a frame: the bytes that it covers and how it is computed from them. Pure functions.
//
// sum and exclusive_or work on bytes or 16-bit words. The check may be their complement: a receiver that adds up everything then
// gets 0 (twos) or all ones (ones). fletcher has two sums, the second over the running values of the first:
//   a = sum x_i mod m,  b = sum a_i mod m,  value = b * 2^w + a         (Fletcher, IEEE Trans. Comm. COM-30, 1982)
// with bytes, w = 8 and m = 255 (fletcher16), or 16-bit words, w = 16 and m = 65535 (fletcher32). With check.modulus = 256 it is what
// u-blox and others call the 8-bit Fletcher algorithm. In a little-endian field a comes first.
// Check values: Fletcher-16 of "abcdef" 2057, Fletcher-32 56502D2A.
// A sum with end-around carry adds the overflow at its lower end (ones'-complement arithmetic). Over 16-bit words, stored as the
// ones' complement, it is the Internet checksum (RFC 1071): 0001 F203 F4F5 F6F7 gives 220D.
// Not modelled: checks over the stuffed bytes.
enum class CheckKind { none, sum, exclusive_or, crc, fletcher };
enum class Complement { none, ones, twos };

struct FrameCheck {
  CheckKind kind = CheckKind::none;
  FrameField field;  // its offset counts back from the frame's end if from_end
  bool from_end = false;
  std::size_t start = 0;  // first byte covered
  std::size_t gap = 0;    // uncovered bytes before the check
  int bytes() const { return field.form().bytes; }
  CrcParameters crc;
  std::size_t pad = 1;  // covered bytes are padded with zeros to a multiple of this
  bool of_words = false;
  bool words_big_endian = false;
  bool end_around = false;  // for a sum: the carry is added at the lower end
  Complement complement = Complement::none;
  std::uint32_t modulus = 255;  // for fletcher
  // An 8-bit check passes 0.4 % of damaged frames, so a frame needs further confirmation.
  bool weak() const { return kind == CheckKind::none || bytes() == 1; }
};

// Returns the offset of the check in a frame of this length; at or beyond its end when there is no room.
std::size_t check_offset(const FrameCheck& check, std::size_t frame_length);

// Computes the check of a frame as the unit must have done. REQUIRES: check.kind is not none.
std::uint32_t frame_check_value(const FrameCheck& check, const Crc& crc, std::span<const std::byte> frame);

}  // namespace turncal
