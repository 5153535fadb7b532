#include "turntable_drivers/modbus/map_check.h"

#include <algorithm>

namespace turncal {
namespace {

// Whether one register can hold, all at once, what the axis's bits in it have to say. Those of other registers are not asked.
bool can_say(const MapAxis& axis, int address, const DriveState& state) {
  for (unsigned word = 0; word <= 0xFFFF; ++word) {
    bool says = true;
    for (int i = 0; says && i < drive_bit_count; ++i) {
      const auto which = static_cast<DriveBit>(i);
      const std::optional<StatusBit>& bit = axis.bit(which);
      if (!bit || bit->address != address || !state[which]) continue;
      says = bit->is_set(static_cast<std::uint16_t>(word)) == *state[which];
    }
    if (says) return true;
  }
  return false;
}

bool is_trouble(int bit) {
  const auto which = static_cast<DriveBit>(bit);
  return which == DriveBit::fault || which == DriveBit::emergency_stop || which == DriveBit::limit_positive ||
         which == DriveBit::limit_negative;
}

// Two troubles may share a bit, and a done bit may tell of arrived and, the other way round, of moving.
bool may_share(int one, const StatusBit& a, int other, const StatusBit& b) {
  if (a.address != b.address || (a.mask & b.mask) == 0 || !a.codes.empty() || !b.codes.empty()) return true;
  const bool done =
      static_cast<DriveBit>(one) == DriveBit::in_position && static_cast<DriveBit>(other) == DriveBit::moving;
  return (is_trouble(one) && is_trouble(other)) || (done && a.active_high != b.active_high);
}

// What a run has to be told, its bits can tell; and none of them is a part of the position, or of another.
void check_status(KeyValueFile& file, const RegisterMap& map) {
  const auto reject = [&file](Axis which, const std::string& name, const std::string& expected) {
    const std::string own = "axis." + std::string(to_string(which)) + "." + name;
    file.reject(file.has(own) ? own : name, expected);
  };
  for (const Axis which : all_axes) {
    const MapAxis& axis = map.of(which);
    const auto in_position = [&](int address, int count) {
      return address < axis.position.address + register_count(axis.position.type) &&
             axis.position.address < address + count;
    };
    if (map.heartbeat_address && map.heartbeat_of_table == map.status_of_table &&
        in_position(*map.heartbeat_address, 1))
      file.reject("heartbeat.address", "a register of its own: the position is there");
    if (axis.rate && in_position(axis.rate->address, register_count(axis.rate->type)))
      reject(which, "rate.address", "a register of its own: the position is there");
    for (int i = 0; i < drive_bit_count; ++i) {
      const std::optional<StatusBit>& bit = axis.bits[static_cast<std::size_t>(i)];
      if (!bit) continue;
      const std::string name = std::string("bit.") + to_string(static_cast<DriveBit>(i));
      if (in_position(bit->address, 1))
        reject(which, name + ".address", "a register of its own: the position is there");
      for (int j = 0; j < i; ++j) {
        const std::optional<StatusBit>& other = axis.bits[static_cast<std::size_t>(j)];
        if (other && !may_share(j, *other, i, *bit))
          reject(which, name + ".mask",
                 std::string("bits of its own, not those of bit.") + to_string(static_cast<DriveBit>(j)));
      }
    }
    for (int i = 0; i < drive_bit_count; ++i) {
      const std::optional<StatusBit>& bit = axis.bits[static_cast<std::size_t>(i)];
      if (!bit) continue;
      const std::string key =
          std::string("bit.") + to_string(static_cast<DriveBit>(i)) + (bit->codes.empty() ? ".mask" : ".codes");
      for (const DriveState& state : drive_states(!map.home_by_encoder))
        if (state.flags[static_cast<std::size_t>(i)] && !can_say(axis, bit->address, state))
          reject(which, key, state.expected);
    }
  }
}

// With the axis's offset every address is one of 65536.
void check_addresses(KeyValueFile& file, const RegisterMap& map) {
  for (const Axis which : all_axes) {
    int last = std::max(map.status_of_table ? 0 : map.status_address + map.status_count,
                        map.status2_of_table ? 0 : map.status2_address + map.status2_count) +
               static_cast<int>(index(which));
    if (map.heartbeat_address && !map.heartbeat_of_table) last = std::max(last, *map.heartbeat_address + 1);
    for (int i = 0; i < drive_operation_count; ++i) {
      const auto operation = static_cast<DriveOperation>(i);
      for (const WriteStep& step : map.list(operation))
        if (!step.of_table && !map.once(operation)) last = std::max(last, step.address + step.length());
    }
    if (last + map.of(which).address_offset <= 65536) continue;
    file.reject("axis." + std::string(to_string(which)) + ".address_offset",
                "at most " + std::to_string(65536 - last) + ": the last register used is " + std::to_string(last - 1) +
                    " without it");
  }
}

}  // namespace

void check_map(KeyValueFile& file, const RegisterMap& map) {
  check_addresses(file, map);
  check_status(file, map);
}

}  // namespace turncal
