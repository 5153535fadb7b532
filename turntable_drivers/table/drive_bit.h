// What one axis of a drive can say of itself: the status words of every register map and dialect are read into these. And what it must
// be able to say: with a status that never says one of these states nothing arrives, or homes, or is believed to be off.
#pragma once

#include <array>
#include <cstddef>
#include <optional>

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

struct DriveState {
  DriveBit bit;          // what it is about
  const char* expected;  // of a status
  std::array<std::optional<bool>, drive_bit_count> flags{};
  std::optional<bool> operator[](DriveBit which) const { return flags[static_cast<std::size_t>(which)]; }
};
// searches: its zero has to be looked for, so that there is a time before.
std::array<DriveState, 4> drive_states(bool searches);

}  // namespace turncal
