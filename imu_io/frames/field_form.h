// How a number lies in a frame: plain data. frame_field.h reads and writes it.
#pragma once

#include <cstddef>
#include <cstdint>

namespace turncal {

enum class NumberType { unsigned_integer, signed_integer, sign_magnitude, floating };

struct FieldForm {
  NumberType type = NumberType::unsigned_integer;
  int bytes = 1;            // 1, 2, 3, 4 or 8; floating: 4 or 8
  bool big_endian = false;  // bytes in a 16-bit word, and words too unless swapped
  bool swap_words = false;  // 16-bit words in the opposite order
  std::uint64_t mask =
      ~std::uint64_t{0};  // of the raw bits; the value is what is left, shifted down; its top bit is the sign
};

struct FrameField {
  std::size_t offset = 0;
  FieldForm form;
};

// The bits that are left of a raw number, shifted down: how many, and by how much.
int used_bits(const FieldForm& form);
int used_shift(const FieldForm& form);

}  // namespace turncal
