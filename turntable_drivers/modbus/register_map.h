// A Modbus drive described in configuration: link, registers, scales, status bits, and the writes for each operation. docs/tables.md
// lists the keys; turntable_drivers/modbus/maps/ has maps for drives of three makers.
//
// One map serves three axes with the same registers: three drives on one bus (a unit id each), or one controller (one
// unit id, an address offset each). An axis is read as one contiguous block, so that its values are simultaneous, or as two
// if the drive scatters them. A block of the whole table (scope) is read at its own address for every axis, and each axis has its own
// registers or bits in it. All blocks have different lengths (status.count, + 1, + 2, likewise status2.count), so that a stale
// reply to another request has the wrong length and is rejected.
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
  bool rtu_frames = false;  // over TCP, but as RTU frames: a serial server that passes bytes on unchanged
  bool header() const { return tcp && !rtu_frames; }  // Modbus TCP: a transaction number and no CRC
};

// Reads the keys link.*: tcp, rtu or rtu_tcp.
void read_modbus_link(KeyValueFile& file, ModbusLinkSettings& link);

struct RegisterField {
  int address = 0;
  WordType type = WordType::u16;
};

struct StatusBit {
  int address = 0;
  std::uint16_t mask = 0;
  bool active_high = true;
  // For a status that is a code: the bit is set if the masked value, shifted down, is one of these.
  std::vector<std::uint16_t> codes;
  int shift() const;  // position of the mask's lowest bit
  bool is_set(std::uint16_t word) const;
};

// What is written to a drive: steps 'ADDRESS TYPE VALUE', 'ADDRESS TYPE VALUE + TYPE VALUE ...' (one request of consecutive registers) or
// 'wait SECONDS'. `table` before an address: a register of the whole table, to which no address_offset of an axis is added.
//
// VALUE is a number, or a quantity of a move: position, distance, rate, acceleration. With .heading .pitch .roll it is that axis's quantity,
// whichever axis is written to; `axis` is the number by which the table knows the axis (axis.NAME.code).
struct WriteOperand {
  enum class Kind { constant, axis, quantity };
  Kind kind = Kind::constant;
  WordType type = WordType::u16;
  double constant = 0.0;
  MoveQuantity quantity = MoveQuantity::position;
  std::optional<Axis> of_axis;  // axis of the quantity; empty: the axis that is written to
  bool asks_for(MoveQuantity which) const { return kind == Kind::quantity && quantity == which; }
  bool operator==(const WriteOperand&) const = default;
};

// One request (operands at consecutive addresses) or a pause.
struct WriteStep {
  int address = 0;
  bool of_table = false;  // no offset of an axis is added
  std::vector<WriteOperand> operands;
  double wait_s = 0.0;  // for a step without operands
  int length() const;   // in registers
  bool operator==(const WriteStep&) const = default;
};
using WriteList = std::vector<WriteStep>;

inline constexpr int longest_block = 120;  // registers of one request; the protocol allows 125

// Returns empty for anything else.
std::optional<WriteStep> parse_write_step(std::string_view text);

struct MapAxis : AxisScale {
  int unit = 1;
  int address_offset = 0;  // added to every address
  int code = 0;            // VALUE `axis` of a write: the table's number for it
  RegisterField position;
  std::optional<RegisterField> rate;
  std::array<std::optional<StatusBit>, drive_bit_count> bits;
  std::optional<RegisterField> alarm;
  const std::optional<StatusBit>& bit(DriveBit which) const { return bits[index(which)]; }
};

// Registers that are read in one request.
struct StatusBlock {
  int address = 0;
  int count = 0;
  bool of_table = false;  // no offset of an axis is added
  bool holds(int register_address) const { return register_address >= address && register_address < address + count; }
  int read_at(const MapAxis& axis) const { return address + (of_table ? 0 : axis.address_offset); }
};

struct RegisterMap : TableDescription {
  ModbusLinkSettings link;
  WordLayout layout;
  std::array<MapAxis, 3> axis;   // indexed by Axis
  bool home_by_encoder = false;  // absolute encoder: homing does not move

  int status_function = 3;  // 3 or 4
  std::array<StatusBlock, 2> status;
  std::map<long, std::string> alarm_text;

  int write_function = 6;  // for single registers: 6 or 16
  std::array<WriteList, table_operation_count> writes;
  std::array<bool, table_operation_count> of_table{};  // written once, to heading's unit and without offset

  // Addresses, as in the lists, of registers that take command numbers instead of bits.
  std::vector<std::uint16_t> code_registers;

  std::optional<int> heartbeat_address;
  bool heartbeat_of_table = false;
  std::vector<std::uint16_t> heartbeat_values;  // written in turn; empty: a counter
  double heartbeat_period_s = 0.2;
  double watchdog_s = 1.0;  // the drive's setting: it stops after this time without a heartbeat

  const MapAxis& of(Axis which) const { return axis[index(which)]; }
  const WriteList& list(TableOperation operation) const { return writes[index(operation)]; }
  bool once(TableOperation operation) const { return of_table[index(operation)]; }
  std::span<const StatusBlock> blocks() const { return std::span(status).first(status[1].count > 0 ? 2 : 1); }
  // Returns the address of a step of a list, or of a heartbeat.
  int address_of(const WriteStep& step, TableOperation operation, Axis which) const {
    return step.address + (step.of_table || once(operation) ? 0 : of(which).address_offset);
  }
  int unit_of(TableOperation operation, Axis which) const { return of(once(operation) ? Axis::heading : which).unit; }
  int heartbeat_at(Axis which) const {  // REQUIRES: the map has a heartbeat
    return *heartbeat_address + (heartbeat_of_table ? 0 : of(which).address_offset);
  }
  // Returns the register at which a field of an axis is read.
  int read_at(int address, Axis which) const {
    return address + (status[status[0].holds(address) ? 0 : 1].of_table ? 0 : of(which).address_offset);
  }
};

Result<RegisterMap> read_register_map(const std::string& path);
Result<RegisterMap> parse_register_map(const std::string& text, const std::string& file_name);

// Returns what a user should know about a valid map before a run; empty if nothing.
std::string caution_of(const RegisterMap& map);

// Encodes one operand of a step as registers. An error: it does not fit its type, or rounds a rate or acceleration too coarsely.
Result<Words> words_of(const RegisterMap& map, const WriteOperand& operand, int address, Axis axis, const Moves& moves);
Result<std::vector<std::uint16_t>> words_of(const RegisterMap& map, const WriteStep& step, Axis axis,
                                            const Moves& moves);
// Returns an error unless the registers can hold a move of this axis and read it back.
Status check_move(const RegisterMap& map, Axis axis, const Moves& moves);

std::string register_text(int address);  // "100 (0x0064)"
// Returns what the driver sends and reads, request by request.
std::vector<TableRow> explain(const RegisterMap& map);

// map_check.cpp: rejects in the file what a table could not work with, beyond the checks of each key: a status that cannot express what
// a run needs, or addresses out of range.
void check_map(KeyValueFile& file, const RegisterMap& map);

// Finds writes with an unintended effect: a `setup`, `heartbeat`, `stop`, `abort` or `clear_fault` that writes what enables, homes or moves
// a drive, a heartbeat that revokes a stop, and axes that cannot be told apart.
//
// The trigger of an operation is the register that its list writes last: for `enable` its final value (earlier ones are steps of
// the drive's state machine), for `home` and `move` every value written there. A 0 after another value in a register is a
// release and triggers nothing. No other list may write the register of a move's position or distance, whatever the value: an
// enabled drive may follow it. The bits of a control word act independently: a word with all bits of a trigger value counts
// as that value (if a drive is enabled without any bit: a word without those that `abort` leaves), except in a register of command numbers
// (`write.codes`). A brake may keep the drive enabled, with other bits. A stop or abort of one axis must not write only to a register of
// another. Numbers of 32 bits are compared as two registers. Two lists that first write different values to another register, as a command
// block does, are different commands.
std::optional<Clash> write_clash(const RegisterMap& map);

// True if the word that a stop leaves in the register of `enable` has all bits of the enabling value.
bool stop_holds_enable(const RegisterMap& map);

}  // namespace turncal
