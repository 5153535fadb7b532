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
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "imu_io/base/crc.h"
#include "imu_io/frames/frame_field.h"

namespace turncal {

enum class CheckKind { none, sum, exclusive_or, crc, fletcher };
enum class Complement { none, ones, twos };

struct FrameCheck {
  CheckKind kind = CheckKind::none;
  FrameField field;  // offset counts from the frame's end when from_end
  bool from_end = false;
  std::size_t start = 0;  // first byte covered
  std::size_t gap = 0;    // bytes before the check's place that are not covered
  int bytes() const { return field.form.bytes; }
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
