// What one axis of a drive can say of itself: the status words of every register map and dialect are read into these.
#pragma once

namespace turncal {

enum class DriveBit {
  enabled,
  in_position,
  fault,
  moving,
  homed,
  limit_positive,
  limit_negative,
  emergency_stop,
  remote
};
inline constexpr int drive_bit_count = 9;
const char* to_string(DriveBit bit);

}  // namespace turncal
