#include "imu_io/frames/frame_field.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace turncal {

int used_shift(const FieldForm& form) { return form.mask == 0 ? 0 : std::countr_zero(form.mask); }

int used_bits(const FieldForm& form) {
  const int width = 8 * form.bytes;
  const std::uint64_t room = width == 64 ? ~std::uint64_t{0} : (std::uint64_t{1} << width) - 1;
  return std::max(64 - std::countl_zero(form.mask & room) - used_shift(form), 1);
}

bool FieldCodec::put_number(std::byte* frame, double value) const {
  if (form_.type == NumberType::floating) {
    if (form_.bytes == 4)
      put_bits(frame, std::bit_cast<std::uint32_t>(static_cast<float>(value)));
    else
      put_bits(frame, std::bit_cast<std::uint64_t>(value));
    return true;
  }
  const double whole = std::nearbyint(value);
  if (form_.type == NumberType::sign_magnitude) {
    const double end_of_magnitude = std::ldexp(1.0, bits_ - 1);
    if (!(std::abs(whole) < end_of_magnitude)) return false;
    const auto sign = whole < 0.0 ? std::uint64_t{1} << (bits_ - 1) : 0;
    put_bits(frame, sign | static_cast<std::uint64_t>(std::abs(whole)));
    return true;
  }
  const bool is_signed = form_.type == NumberType::signed_integer;
  const double low = is_signed ? -std::ldexp(1.0, bits_ - 1) : 0.0;
  const double end = std::ldexp(1.0, is_signed ? bits_ - 1 : bits_);
  if (!(whole >= low && whole < end)) return false;
  put_bits(frame, is_signed ? static_cast<std::uint64_t>(static_cast<std::int64_t>(whole))
                            : static_cast<std::uint64_t>(whole));
  return true;
}

}  // namespace turncal
