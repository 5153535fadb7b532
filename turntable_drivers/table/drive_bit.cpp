#include "turntable_drivers/table/drive_bit.h"

#include <array>
#include <cstddef>

namespace turncal {

const char* to_string(DriveBit bit) {
  constexpr std::array<const char*, drive_bit_count> names = {"enabled",        "in_position",    "fault",
                                                              "moving",         "homed",          "limit_positive",
                                                              "limit_negative", "emergency_stop", "remote"};
  return names[static_cast<std::size_t>(bit)];
}

}  // namespace turncal
