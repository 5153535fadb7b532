// For tests of the Modbus driver: maps of tables that are one controller for three axes.
#pragma once

#include <string>

namespace turncal {

// Modbus RTU through a serial server. One block of the whole table: masks of each axis in a shared word, a state code and numbers of
// 64 bits for each; all three angles in one command block; a heartbeat of two documented values.
inline std::string one_block_map_text() {
  return "format = 1\nname = one block for three\ncommissioned = true\nlink.kind = rtu_tcp\nlink.quiet_s = 0.1\n"
         "axis.heading.unit = 9\naxis.pitch.unit = 9\naxis.roll.unit = 9\n"
         "axis.heading.counts_per_degree = 1\naxis.pitch.counts_per_degree = 1\naxis.roll.counts_per_degree = 60\n"
         "axis.pitch.sign = -1\nwords.order = low_first\n"
         "status.address = 0x100\nstatus.count = 28\n"
         "position.type = f64\nrate.type = f64\n"
         "axis.heading.position.address = 0x104\naxis.pitch.position.address = 0x108\naxis.roll.position.address = "
         "0x10C\n"
         "axis.heading.rate.address = 0x110\naxis.pitch.rate.address = 0x114\naxis.roll.rate.address = 0x118\n"
         "bit.enabled.address = 0x100\naxis.heading.bit.enabled.mask = 0x001\naxis.pitch.bit.enabled.mask = 0x002\n"
         "axis.roll.bit.enabled.mask = 0x004\n"
         "bit.in_position.address = 0x100\naxis.heading.bit.in_position.mask = 0x010\n"
         "axis.pitch.bit.in_position.mask = 0x020\naxis.roll.bit.in_position.mask = 0x040\n"
         "bit.homed.address = 0x100\naxis.heading.bit.homed.mask = 0x100\naxis.pitch.bit.homed.mask = 0x200\n"
         "axis.roll.bit.homed.mask = 0x400\n"
         "bit.fault.mask = 0xFF00\nbit.fault.codes = 7, 8\naxis.heading.bit.fault.address = 0x101\n"
         "axis.pitch.bit.fault.address = 0x102\naxis.roll.bit.fault.address = 0x103\n"
         "bit.moving.mask = 0xFF00\nbit.moving.codes = 2\naxis.heading.bit.moving.address = 0x101\n"
         "axis.pitch.bit.moving.address = 0x102\naxis.roll.bit.moving.address = 0x103\n"
         "write.enable = 0x200 u16 7\nwrite.enable.scope = table\n"
         "write.home = 0x201 u16 1, 0x201 u16 0\nwrite.home.scope = table\n"
         "write.move = 0x210 f64 position.heading + f64 position.pitch + f64 position.roll + f64 rate.heading + "
         "f64 rate.pitch + f64 rate.roll, 0x228 u16 1\nwrite.move.scope = table\n"
         "write.stop = 0x202 u16 1, 0x202 u16 0\nwrite.stop.scope = table\n"
         "write.abort = 0x203 u16 1\nwrite.abort.scope = table\n"
         "write.clear_fault = 0x204 u16 1\nwrite.clear_fault.scope = table\n"
         "heartbeat.address = 0x230\nheartbeat.scope = table\nheartbeat.values = 0x55, 0xAA\nheartbeat.watchdog_s = "
         "1\n";
}

// Status registers of each axis with an offset; the mode, the word that says who commands and the heartbeat are of the whole table; one
// command block, in front of which stands the number of the axis.
inline std::string selecting_map_text() {
  return "format = 1\nname = one command block\ncommissioned = true\nlink.kind = tcp\nlink.quiet_s = 0.1\n"
         "axis.heading.unit = 4\naxis.pitch.unit = 4\naxis.roll.unit = 4\n"
         "axis.pitch.address_offset = 0x100\naxis.roll.address_offset = 0x200\n"
         "axis.heading.code = 10\naxis.pitch.code = 20\naxis.roll.code = 30\n"
         "axis.heading.counts_per_degree = 10000\naxis.pitch.counts_per_degree = 10000\naxis.roll.counts_per_degree = "
         "10000\n"
         "words.order = high_first\nstatus.address = 0x10\nstatus.count = 5\nstatus2.address = 0x950\nstatus2.count = "
         "1\n"
         "status2.scope = table\nposition.address = 0x11\nrate.address = 0x13\n"
         "bit.enabled.address = 0x10\nbit.enabled.codes = 1, 2, 3\nbit.in_position.address = "
         "0x10\nbit.in_position.codes = 1, 3\n"
         "bit.moving.address = 0x10\nbit.moving.codes = 2\nbit.fault.address = 0x10\nbit.fault.codes = 9\n"
         "bit.remote.address = 0x950\nbit.remote.mask = 0x0001\n"
         "bit.homed.address = 0x10\nbit.homed.codes = 1, 2\nwrite.home = table 0x900 u16 axis, table 0x901 u16 16\n"
         "write.setup = table 0x940 u16 3\nwrite.setup.scope = table\n"
         "write.enable = table 0x900 u16 axis, table 0x901 u16 1\n"
         "write.move = table 0x910 u16 axis + s32 position + u32 rate + u32 acceleration, table 0x917 u16 1\n"
         "write.stop = table 0x900 u16 axis, table 0x901 u16 2\n"
         "write.abort = table 0x900 u16 axis, table 0x901 u16 4\n"
         "write.clear_fault = table 0x900 u16 axis, table 0x901 u16 8\n"
         "heartbeat.address = 0x960\nheartbeat.scope = table\n";
}

}  // namespace turncal
