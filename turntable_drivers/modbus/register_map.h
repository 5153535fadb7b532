// A Modbus drive described in configuration: link, registers, scales, bits, and the writes that make it move. docs/tables.md
// lists the keys; turntable_drivers/modbus/maps/ has maps for three makers' drives.
//
// One map serves three axes that speak the same language: three drives on one bus (a unit id each), or one controller (the same
// unit id, an address offset each). All reading of an axis is one contiguous block, so that its values belong together, or two
// where the drive scatters them; a block of the whole table (scope) is read at its own address for every axis, and each axis has its own
// registers or bits in it. All blocks have different lengths (status.count, + 1, + 2, likewise status2.count): a stale
// reply of another request then has the wrong length and is refused.
//
// Not modelled: coils and discrete inputs, several links, function codes 22 and 23.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "calib/types/axis.h"
#include "calib/types/status.h"
#include "imu_io/base/key_value.h"
#include "turntable_drivers/modbus/modbus_frame.h"
#include "turntable_drivers/table/table_description.h"

namespace turncal {

struct ModbusLinkSettings : TableLinkSettings {
  bool rtu_frames = false;  // over TCP: a serial server that passes on what it gets, without the protocol's TCP header
  bool header() const { return tcp && !rtu_frames; }  // frames of Modbus TCP: a transaction number, no CRC
};

// link.* of a file: tcp, rtu or rtu_tcp.
void read_modbus_link(KeyValueFile& file, ModbusLinkSettings& link);

struct RegisterField {
  int address = 0;
  WordType type = WordType::u16;
};

struct StatusBit {
  int address = 0;
  std::uint16_t mask = 0;
  bool active_high = true;
  // Of a status that is a code: set when what the mask leaves, shifted down, is one of these.
  std::vector<std::uint16_t> codes;
  int shift() const;  // of the mask's lowest bit
  bool is_set(std::uint16_t word) const;
};

// What is written to a drive: steps 'ADDRESS TYPE VALUE', 'ADDRESS TYPE VALUE + TYPE VALUE ...' (one request of consecutive registers) or
// 'wait SECONDS'. `table` in front of an address: it is a register of the whole table, to which no address_offset of an axis is added.
//
// VALUE is a number, or what a move asks for: position, distance, rate, acceleration; with .heading .pitch .roll that of one axis,
// whichever the list is written for; `axis` is the number by which the table calls the axis (axis.NAME.code).
struct WriteOperand {
  enum class Kind { constant, axis, quantity };
  Kind kind = Kind::constant;
  WordType type = WordType::u16;
  double constant = 0.0;
  MoveQuantity quantity = MoveQuantity::position;
  std::optional<Axis> of_axis;  // whose quantity; empty: of the axis that is written to
  bool asks_for(MoveQuantity which) const { return kind == Kind::quantity && quantity == which; }
  bool operator==(const WriteOperand&) const = default;
};

// One request (operands at consecutive addresses), or a pause.
struct WriteStep {
  int address = 0;
  bool of_table = false;  // no axis offset
  std::vector<WriteOperand> operands;
  double wait_s = 0.0;  // a pause when there are no operands
  int length() const;   // registers
  bool operator==(const WriteStep&) const = default;
};
using WriteList = std::vector<WriteStep>;

inline constexpr int longest_block = 120;  // registers of one request; the protocol ends at 125

// Empty: not a step.
std::optional<WriteStep> parse_write_step(std::string_view text);

struct MapAxis : AxisScale {
  int unit = 1;
  int address_offset = 0;  // added to every address
  int code = 0;            // the `axis` of a write: what the table calls it
  RegisterField position;
  std::optional<RegisterField> rate;
  std::array<std::optional<StatusBit>, drive_bit_count> bits;
  std::optional<RegisterField> alarm;
  const std::optional<StatusBit>& bit(DriveBit which) const { return bits[index(which)]; }
};

// Registers that are read together.
struct StatusBlock {
  int address = 0;
  int count = 0;
  bool of_table = false;  // no axis offset
  bool holds(int register_address) const { return register_address >= address && register_address < address + count; }
  int read_at(const MapAxis& axis) const { return address + (of_table ? 0 : axis.address_offset); }
};

struct RegisterMap : TableDescription {
  ModbusLinkSettings link;
  WordLayout layout;
  std::array<MapAxis, 3> axis;   // indexed by Axis
  bool home_by_encoder = false;  // absolute encoder: homing moves nothing

  int status_function = 3;  // 3 or 4
  std::array<StatusBlock, 2> status;
  std::map<long, std::string> alarm_text;

  int write_function = 6;  // of single registers: 6 or 16
  std::array<WriteList, table_operation_count> writes;
  std::array<bool, table_operation_count> of_table{};  // written once, to heading's unit and without offset

  // Addresses as in the lists: what is written there is the number of a command, not bits.
  std::vector<std::uint16_t> code_registers;

  std::optional<int> heartbeat_address;
  bool heartbeat_of_table = false;
  std::vector<std::uint16_t> heartbeat_values;  // written in turn; empty: another number each time
  double heartbeat_period_s = 0.2;
  double watchdog_s = 1.0;  // what the drive is set to: it stops when no heartbeat came for this long

  const MapAxis& of(Axis which) const { return axis[index(which)]; }
  const WriteList& list(TableOperation operation) const { return writes[index(operation)]; }
  bool once(TableOperation operation) const { return of_table[index(operation)]; }
  std::span<const StatusBlock> blocks() const { return std::span(status).first(status[1].count > 0 ? 2 : 1); }
  // Where a request goes: a step's of a list, or a heartbeat.
  int address_of(const WriteStep& step, TableOperation operation, Axis which) const {
    return step.address + (step.of_table || once(operation) ? 0 : of(which).address_offset);
  }
  int unit_of(TableOperation operation, Axis which) const { return of(once(operation) ? Axis::heading : which).unit; }
  int heartbeat_at(Axis which) const {  // REQUIRES: there is one
    return *heartbeat_address + (heartbeat_of_table ? 0 : of(which).address_offset);
  }
  // At which register a field is read.
  int read_at(int address, Axis which) const {
    return address + (status[status[0].holds(address) ? 0 : 1].of_table ? 0 : of(which).address_offset);
  }
};

Result<RegisterMap> read_register_map(const std::string& path);
Result<RegisterMap> parse_register_map(const std::string& text, const std::string& file_name);

// What a user should know before a run although the map is good; empty: nothing.
std::string caution_of(const RegisterMap& map);

// A step of a list as registers, and one number of it. An error: it does not fit its type, or is a rate or acceleration told coarsely.
Result<Words> words_of(const RegisterMap& map, const WriteOperand& operand, int address, Axis axis, const Moves& moves);
Result<std::vector<std::uint16_t>> words_of(const RegisterMap& map, const WriteStep& step, Axis axis,
                                            const Moves& moves);
// Whether the map's registers are wide enough for a move of this axis, and can read it back.
Status check_move(const RegisterMap& map, Axis axis, const Moves& moves);

// What the driver sends and reads, request by request.
std::vector<TableRow> explain(const RegisterMap& map);

// map_check.cpp: remembers in the file what a table could not work with, beyond what each key is checked for: a status that cannot tell what
// a run has to know, addresses that there are not.
void check_map(KeyValueFile& file, const RegisterMap& map);

// Writes that would do more than they are called, and a heartbeat that takes a stop back: a `setup`, `heartbeat`, `stop`, `abort` or
// `clear_fault` that writes what enables a drive, homes or moves it, and axes that cannot be told apart.
//
// What starts something is the register that its list writes last: for `enable` the value that it ends with (those before are steps of
// the drive's own state machine), for `home` and `move` every value written there. A 0 that follows another value in a register is a
// release, and starts nothing. The register of a move's position or distance is written by no other list, whatever the value: a drive that
// is on may follow it. Bits of a control word do what they do whatever stands beside them: a word that holds all bits of such a value counts
// as that value (where a drive is on without any bit: a word without those that `abort` leaves), but in a register of command numbers
// (`write.codes`). A brake may hold the drive on, with other bits. A stop or abort of one axis writes to no register of another alone. All of
// it register by register: a number of 32 bits writes two. A register that both lists write with different values first, as a command
// block does, tells them apart.
std::optional<Clash> write_clash(const RegisterMap& map);

// Whether the word that a stop leaves in the register of `enable` holds all bits of the value that enables.
bool stop_holds_enable(const RegisterMap& map);

}  // namespace turncal
