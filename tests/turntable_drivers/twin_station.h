// For tests of the Modbus driver: two very different maps.
#pragma once

#include <string>

#include <gtest/gtest.h>

#include "tests/turntable_drivers/served_twin.h"
#include "turntable_drivers/modbus/modbus_turntable.h"

namespace turncal {

// Three drives on one line, 32 bit, a unit id each, a heartbeat.
inline std::string plain_map_text(const std::string& kind) {
  return "format = 1\nname = three plain drives\ncommissioned = true\nlink.kind = " + kind + R"(
link.response_timeout_s = 1
link.byte_timeout_s = 0.1
link.quiet_s = 0.1
axis.heading.unit = 1
axis.pitch.unit = 2
axis.roll.unit = 3
axis.heading.counts_per_degree = 10000
axis.pitch.counts_per_degree = 10000
axis.roll.counts_per_degree = 10000
axis.pitch.sign = -1
axis.roll.zero_deg = 12.5
words.order = high_first
status.address = 0x100
status.count = 6
position.address = 0x100
rate.address = 0x102
alarm.address = 0x104
alarm.type = u16
alarm.text.0x26 = overload
bit.enabled.address = 0x105
bit.enabled.mask = 1
bit.in_position.address = 0x105
bit.in_position.mask = 2
bit.fault.address = 0x105
bit.fault.mask = 4
bit.moving.address = 0x105
bit.moving.mask = 8
bit.homed.address = 0x105
bit.homed.mask = 0x10
bit.limit_positive.address = 0x105
bit.limit_positive.mask = 0x20
bit.emergency_stop.address = 0x105
bit.emergency_stop.mask = 0x40
bit.emergency_stop.active = low
bit.remote.address = 0x105
bit.remote.mask = 0x8000
write.enable = 0x200 u16 1
write.home = 0x201 u16 1, 0x201 u16 0
write.move = 0x210 s32 position + u32 rate + u32 acceleration, 0x216 u16 1
write.stop = 0x202 u16 1, 0x202 u16 0
write.abort = 0x203 u16 1
write.clear_fault = 0x204 u16 1, 0x204 u16 0
heartbeat.address = 0x220
heartbeat.period_s = 0.2
heartbeat.watchdog_s = 1
)";
}

// One controller that knows only a circle, low word first, bytes swapped, no rate register, ramp times, no moving bit.
inline std::string circle_map_text(const std::string& kind) {
  return "format = 1\nname = one odd controller\ncommissioned = true\nlink.kind = " + kind + R"(
link.quiet_s = 0.1
axis.heading.unit = 7
axis.pitch.unit = 7
axis.roll.unit = 7
axis.pitch.address_offset = 0x100
axis.roll.address_offset = 0x200
axis.heading.counts_per_degree = 36000
axis.pitch.counts_per_degree = 36000
axis.roll.counts_per_degree = 36000
axis.heading.modulo_deg = 360
axis.pitch.sign = -1
axis.pitch.zero_deg = 5
axis.pitch.modulo_deg = 360
axis.roll.modulo_deg = 360
axis.heading.acceleration_scale = 100000
axis.pitch.acceleration_scale = 100000
axis.roll.acceleration_scale = 100000
acceleration.kind = ramp_time
words.order = low_first
words.swap_bytes = true
status.function = 4
status.address = 10
status.count = 3
position.address = 11
position.type = u32
bit.enabled.address = 10
bit.enabled.mask = 1
bit.in_position.address = 10
bit.in_position.mask = 2
bit.fault.address = 10
bit.fault.mask = 4
bit.fault.active = low
bit.homed.address = 10
bit.homed.mask = 8
write.function = 16
write.enable = 30 u16 1
write.home = 31 u16 1
write.move = 40 s32 distance, 42 f32 rate, 44 u16 acceleration, 46 u16 1, wait 0.001, 46 u16 0
write.stop = 46 u16 2
write.abort = 46 u16 4
write.clear_fault = 47 u16 1
)";
}

inline RegisterMap map_of(const std::string& text) {
  const Result<RegisterMap> map = parse_register_map(text, "test.map");
  EXPECT_TRUE(map.ok()) << (map.ok() ? "" : map.error().message);
  return map.ok() ? *map : RegisterMap();
}

}  // namespace turncal
