#include "imu_io/frames/frame_field.h"

#include <cmath>

namespace turncal {

bool FieldCodec::put_number(std::byte* frame, double value) const {
  if (form_.type == NumberType::floating) {
    if (form_.bytes == 4) {
      put_bits(frame, std::bit_cast<std::uint32_t>(static_cast<float>(value)));
    } else {
      put_bits(frame, std::bit_cast<std::uint64_t>(value));
    }
    return true;
  }
  const double whole = std::nearbyint(value);
  const bool is_signed = form_.type == NumberType::signed_integer;
  const double low = is_signed ? -std::ldexp(1.0, bits_ - 1) : 0.0;
  const double end = std::ldexp(1.0, is_signed ? bits_ - 1 : bits_);
  if (!(whole >= low && whole < end)) return false;
  put_bits(frame, is_signed ? static_cast<std::uint64_t>(static_cast<std::int64_t>(whole))
                            : static_cast<std::uint64_t>(whole));
  return true;
}

}  // namespace turncal
