#include "turntable_drivers/table/drive_bit.h"

#include <initializer_list>

namespace turncal {

const char* to_string(DriveBit bit) {
  constexpr std::array<const char*, drive_bit_count> names = {"enabled",        "in_position",    "fault",
                                                              "moving",         "homed",          "limit_positive",
                                                              "limit_negative", "emergency_stop", "remote"};
  return names[static_cast<std::size_t>(bit)];
}

std::array<DriveState, 4> drive_states(bool searches) {
  const auto with = [](DriveBit about, const char* expected, std::initializer_list<DriveBit> set,
                       std::initializer_list<DriveBit> clear) {
    DriveState state{about, expected};
    for (const DriveBit bit : set) state.flags[static_cast<std::size_t>(bit)] = true;
    for (const DriveBit bit : clear) state.flags[static_cast<std::size_t>(bit)] = false;
    return state;
  };
  using enum DriveBit;
  DriveState before_homing =
      with(homed,
           "a status that can say of an axis that it is on and not homed: enabled and remote, without homed, "
           "moving, fault or emergency_stop",
           {enabled, remote}, {homed, moving, fault, emergency_stop});
  if (!searches) before_homing.flags = {};
  return {with(in_position,
               "a status that can say of an axis that it has arrived: enabled, in_position, homed and remote, without "
               "moving, fault, a limit or emergency_stop",
               {enabled, in_position, homed, remote}, {fault, moving, limit_positive, limit_negative, emergency_stop}),
          with(enabled,
               "a status that can say of an axis that it moves: enabled, moving, homed and remote, without "
               "in_position, fault, a limit "
               "or emergency_stop",
               {enabled, moving, homed, remote}, {in_position, fault, limit_positive, limit_negative, emergency_stop}),
          with(enabled, "a status that can say of an axis that it is off and at rest: without enabled and moving", {},
               {enabled, moving}),
          before_homing};
}

}  // namespace turncal
