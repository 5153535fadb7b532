// Numbers in and out of frames: what a description says of them compiled into shifts, so that one loop serves every byte and word order.
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

// Byte stuffing: how a unit keeps the bytes that mark its frames out of their contents. The description's offsets and its check count
// the bytes as they are without it; sync and tail stand on the line as they are.
//
//   escape    a byte that means something on the line is sent as `byte`, then itself xor `flip`       (HDLC, RFC 1662: 7D, 20)
//   slip      the same with C0 as DB DC and DB as DB DD                                                (RFC 1055)
//   repeat    `byte` in the contents is sent twice; sync and tail begin with one                       (DLE STX ... DLE ETX)
//   cobs      consistent overhead: a 00 ends every frame, and the contents hold none (Cheshire, Baker, IEEE/ACM ToN 7, 1999). The 00
//             before the contents is their sync: it is byte 0 of the frame, whether the unit sends one or the frame before ended so
// A byte that was lost costs the frame that it belonged to, and no other. Not modelled: bit stuffing, COBS/R and other variants.

enum class StuffingKind { none, escape, slip, repeat, cobs };

struct ByteStuffing {
  StuffingKind kind = StuffingKind::none;
  std::byte byte{0x7D};
  std::byte flip{0x20};
};

// Takes stuffing out of a stream that comes in pieces.
class Unstuffer {
 public:
  explicit Unstuffer(const ByteStuffing& stuffing) : stuffing_(stuffing) {}
  // data[1, 1 + count) is new; what it says is put from data[0] on: at most count + 1 bytes. Returns how many.
  std::size_t unstuff(std::byte* data, std::size_t count);
  void restart();

 private:
  std::byte* decode_cobs(std::byte now, std::byte* to);

  ByteStuffing stuffing_;
  bool pending_ = false;  // the last byte was `byte`: what it means the next one tells
  // Of cobs: bytes left in the group, none after a 00; whether a 00 follows it unless the frame ends; a 00 came last.
  int group_ = 0;
  bool zero_due_ = false;
  bool ended_ = false;
};

// The bytes of a frame as they go over the line, appended to `out`; the first `sync` and the last `tail` of them stay as they are.
void append_stuffed(const ByteStuffing& stuffing, std::span<const std::byte> frame, std::size_t sync, std::size_t tail,
                    std::vector<std::byte>& out);

// ---- fields ----

// How a number lies in a frame: plain data.
enum class NumberType { unsigned_integer, signed_integer, sign_magnitude, floating };

struct FieldForm {
  NumberType type = NumberType::unsigned_integer;
  int bytes = 1;            // 1, 2, 3, 4 or 8; floating: 4 or 8
  bool big_endian = false;  // bytes in a 16-bit word, and words too unless swapped
  bool swap_words = false;  // 16-bit words in the opposite order
  std::uint64_t mask =
      ~std::uint64_t{0};  // of the raw bits; the value is what is left, shifted down; its top bit is the sign
};

class FrameField {
 public:
  FrameField() : FrameField(0, {}) {}
  FrameField(std::size_t offset, const FieldForm& form) : offset_(offset), form_(form) {
    for (int i = 0; i < 8 && i < form_.bytes; ++i) {
      // Place of byte i in significance: within its word, then of the word.
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
  // 2^bits - 1: the values that fit.
  std::uint64_t largest_bits() const { return used_; }
  int bits() const { return bits_; }  // that the mask leaves of the raw number, shifted down
  NumberType type() const { return form_.type; }

  // REQUIRES of all below: `frame` reaches to offset + bytes.
  std::uint64_t bits_at(const std::byte* place) const {
    std::uint64_t value = 0;
    for (int i = 0; i < form_.bytes; ++i) value |= std::to_integer<std::uint64_t>(place[i]) << shift_[i];
    return (value & mask_) >> down_;
  }
  std::uint64_t bits_of(const std::byte* frame) const { return bits_at(frame + offset_); }
  // Integers beyond 2^53 lose their last bits; may be NaN or infinite for floats.
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

  // Leaves the bits outside the mask as they are; what does not fit is cut off.
  void put_bits_at(std::byte* place, std::uint64_t value) const {
    const std::uint64_t placed = (value << down_) & mask_;
    for (int i = 0; i < form_.bytes; ++i) {
      const auto keep = std::to_integer<std::uint64_t>(place[i]) & ~(mask_ >> shift_[i]);
      place[i] = static_cast<std::byte>((keep | (placed >> shift_[i])) & 0xFFU);
    }
  }
  void put_bits(std::byte* frame, std::uint64_t value) const { put_bits_at(frame + offset_, value); }
  // False when the number does not fit the field.
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

// The check of a frame: which bytes it covers and what it is of them. Pure functions.
//
// sum and exclusive_or are of bytes or of 16-bit words, and may be kept as their complement: a receiver that adds everything up then
// gets 0 (twos) or all ones (ones). fletcher is two sums, the second of the first's running values:
//   a = sum x_i mod m,  b = sum a_i mod m,  value = b * 2^w + a         (Fletcher, IEEE Trans. Comm. COM-30, 1982)
// with bytes, w = 8 and m = 255 (fletcher16), or 16-bit words, w = 16 and m = 65535 (fletcher32); check.modulus = 256 is what
// u-blox and others call the 8-bit Fletcher algorithm. In a little-endian field a comes first.
// Check values: Fletcher-16 of "abcdef" 2057, Fletcher-32 56502D2A.
// A sum with an end-around carry adds what runs over its width at the other end: ones'-complement arithmetic. Of 16-bit words, kept as
// its ones' complement, it is the checksum of the Internet (RFC 1071): 0001 F203 F4F5 F6F7 gives 220D.
// Not modelled: checks over the bytes as they are stuffed on the line.
enum class CheckKind { none, sum, exclusive_or, crc, fletcher };
enum class Complement { none, ones, twos };

struct FrameCheck {
  CheckKind kind = CheckKind::none;
  FrameField field;  // offset counts from the frame's end when from_end
  bool from_end = false;
  std::size_t start = 0;  // first byte covered
  std::size_t gap = 0;    // bytes before the check's place that are not covered
  int bytes() const { return field.form().bytes; }
  CrcParameters crc;
  std::size_t pad = 1;  // covered bytes are filled up with zeros to a multiple of this
  bool of_words = false;
  bool words_big_endian = false;
  bool end_around = false;  // of a sum: what is carried out comes in again
  Complement complement = Complement::none;
  std::uint32_t modulus = 255;  // of fletcher
  // 8 bits let 0.4 % of damaged frames pass: more has to agree before a frame is believed.
  bool weak() const { return kind == CheckKind::none || bytes() == 1; }
};

// Where the check stands in a frame of this length; at the frame's length or beyond when it has no room.
std::size_t check_offset(const FrameCheck& check, std::size_t frame_length);

// The check over a frame, as the unit must have computed it. REQUIRES: check.kind is not none.
std::uint32_t frame_check_value(const FrameCheck& check, const Crc& crc, std::span<const std::byte> frame);

}  // namespace turncal
