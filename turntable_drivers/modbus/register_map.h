// A Modbus drive described in configuration: link, registers, scales, bits, and the writes that make it move. docs/tables.md
// lists the keys; turntable_drivers/modbus/maps/ has maps for three makers' drives.
//
// One map serves three axes that speak the same language: three drives on one bus (a unit id each), or one controller (the same
// unit id, an address offset each). All reading of an axis is one contiguous block, so that its values belong together, or two
// where the drive scatters them; a block of the whole table (scope) is read at its own address for every axis, and each axis has its own
// registers or bits in it. All blocks have different lengths (status.count, + 1, + 2, likewise status2.count): a stale
// reply of another request then has the wrong length and is refused.
//
// Angles:  register = sign * counts_per_degree * (angle_deg - zero_deg), taken modulo counts of modulo_deg if that is not 0.
//
// Not modelled: coils and discrete inputs, several links, function codes 22 and 23.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "calib/types/axis.h"
#include "calib/types/status.h"
#include "imu_io/base/key_value.h"
#include "imu_io/lines/serial_port.h"
#include "turntable_drivers/modbus/register_words.h"
#include "turntable_drivers/modbus/write_step.h"
#include "turntable_drivers/table/table_description.h"

namespace turncal {

struct ModbusLinkSettings {
  bool tcp = true;
  bool rtu_frames = false;  // over TCP: a serial server that passes on what it gets, without the protocol's TCP header
  bool header() const { return tcp && !rtu_frames; }  // frames of Modbus TCP: a transaction number, no CRC
  std::string address;                                // host:port, or the device (a name of /dev/serial/by-id)
  SerialSettings serial{.device = "", .parity = SerialParity::even};  // rtu; its device is the address
  double response_timeout_s = 1.0;
  double byte_timeout_s = 0.1;  // silence inside a reply
  double quiet_s = 0.5;         // after trouble the line is read empty until it has been quiet for this long
  double gap_s = 0.0;           // silence before a request, which some drives need
  int read_retries = 2;         // the third failure in a row is a lost link
};

struct RegisterField {
  int address = 0;
  WordType type = WordType::u16;
};

struct StatusBit {
  int address = 0;
  std::uint16_t mask = 0;
  bool active_high = true;
  bool pulse = false;  // shows only for a moment: once seen after a command it counts as set
  // Of a status that is a code: set when what the mask leaves, shifted down, is one of these.
  std::vector<std::uint16_t> codes;
  int shift() const;  // of the mask's lowest bit
  bool is_set(std::uint16_t word) const;
};

enum class DriveOperation { setup, enable, home, move, stop, abort, clear_fault };
inline constexpr int drive_operation_count = 7;
const char* to_string(DriveOperation operation);

struct MapAxis {
  int unit = 1;
  int address_offset = 0;  // added to every address
  double counts_per_degree = 1.0;
  int sign = 1;
  double zero_deg = 0.0;    // the angle at which the register reads 0
  double modulo_deg = 0.0;  // 0: the register is cumulative; 360: it knows only a circle
  double rate_scale = 1.0;  // commanded rate register = rate_scale * deg/s
  double measured_rate_scale = 1.0;
  double acceleration_scale = 1.0;  // register = scale * deg/s^2, or scale / (deg/s^2) when acceleration is a ramp time
  int code = 0;                     // the `axis` of a write: what the table calls it
  RegisterField position;
  std::optional<RegisterField> rate;
  std::array<std::optional<StatusBit>, drive_bit_count> bits;
  std::optional<RegisterField> alarm;
  double signed_counts_per_degree() const { return sign * counts_per_degree; }
  const std::optional<StatusBit>& bit(DriveBit which) const { return bits[static_cast<std::size_t>(which)]; }
};

struct RegisterMap : TableDescription {
  ModbusLinkSettings link;
  WordLayout layout;
  std::array<MapAxis, 3> axis;  // indexed by Axis
  bool acceleration_is_ramp_time = false;
  bool home_by_encoder = false;  // absolute encoder: homing moves nothing

  int status_function = 3;  // 3 or 4
  int status_address = 0;
  int status_count = 0;
  int status2_address = 0;
  int status2_count = 0;         // 0: one block
  bool status_of_table = false;  // no axis offset
  bool status2_of_table = false;
  std::map<long, std::string> alarm_text;

  int write_function = 6;  // of single registers: 6 or 16
  std::array<WriteList, drive_operation_count> writes;
  std::array<bool, drive_operation_count> of_table{};  // written once, to heading's unit and without offset

  std::vector<int>
      code_registers;  // addresses as in the lists: what is written there is the number of a command, not bits

  std::optional<int> heartbeat_address;
  bool heartbeat_of_table = false;
  std::vector<std::uint16_t> heartbeat_values;  // written in turn; empty: another number each time
  double heartbeat_period_s = 0.2;
  double watchdog_s = 1.0;  // what the drive is set to: it stops when no heartbeat came for this long

  const MapAxis& of(Axis which) const { return axis[static_cast<std::size_t>(which)]; }
  const WriteList& list(DriveOperation operation) const { return writes[static_cast<std::size_t>(operation)]; }
  bool once(DriveOperation operation) const { return of_table[static_cast<std::size_t>(operation)]; }
  // Where a request goes: a step's of a list, or a block's.
  int address_of(const WriteStep& step, DriveOperation operation, Axis which) const {
    return step.address + (step.of_table || once(operation) ? 0 : of(which).address_offset);
  }
  int unit_of(DriveOperation operation, Axis which) const { return of(once(operation) ? Axis::heading : which).unit; }
  bool in_first_block(int address) const {
    return address >= status_address && address < status_address + status_count;
  }
  // Where a status register stands in the two blocks put together.
  std::size_t place_of(int address) const {
    return static_cast<std::size_t>(in_first_block(address) ? address - status_address
                                                            : status_count + address - status2_address);
  }
  // At which register it is read: a block of the whole table has no offset.
  int read_at(int address, Axis which) const {
    const bool of_whole_table = in_first_block(address) ? status_of_table : status2_of_table;
    return address + (of_whole_table ? 0 : of(which).address_offset);
  }
};

Result<RegisterMap> read_register_map(const std::string& path);
Result<RegisterMap> parse_register_map(const std::string& text, const std::string& file_name);

// What a user should know before a run although the map is good; empty: nothing.
std::string caution_of(const RegisterMap& map);

// Angle to register value and back; `modulo_deg` is not applied.
double counts_of(const MapAxis& axis, double angle_deg);
double angle_of(const MapAxis& axis, double counts);

}  // namespace turncal
