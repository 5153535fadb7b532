// What a register map and a dialect alike say of a table.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "imu_io/base/key_table.h"
#include "imu_io/base/key_value.h"
#include "turntable_drivers/table/drive_rules.h"

namespace turncal {

struct TableDescription {
  std::string file;
  std::string name;
  bool verified_on_hardware = false;
  bool simulated = false;               // a twin answers; not a key of the file: the station says it
  bool commissioned = false;            // scale, sign and order were checked against a known angle; else no motion
  bool can_switch_off = true;           // abort does
  double moving_rate_degps = 0.01;      // of an axis that does not tell: faster than this is moving
  double plausible_deg = 7200.0;        // a position beyond this is not believed
  double plausible_rate_degps = 400.0;  // nor is one that the axis cannot have reached since the last
  std::vector<LineSource> lines;        // of the file: where each comes from
};

// Whether a line says what moves an axis, stops it, or tells that it is on, has arrived or is at fault.
bool decides_motion(std::string_view key);

// Beyond these no table is: a number outside is a slip of the pen.
inline constexpr NumberRange scale_range{1e-6, 1e9};        // counts or units for a degree, a deg/s, a deg/s^2
inline constexpr NumberRange link_wait_range{0.001, 60.0};  // seconds

void read_table_description(KeyValueFile& file, TableDescription& description);

// A circle of the device's positions; 0: it counts turns.
double circle_deg(KeyValueFile& file, const std::string& key);

// What one axis of a drive can say of itself: the status words of every register map and dialect are read into these. And what it must
// be able to say: with a status that never says one of these states nothing arrives, or homes, or is believed to be off.
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

// What a described table is sent and answers, as rows that somebody holds against its manual. explain() of a register map
// (turntable_drivers/modbus/explain_map.h) and of a dialect (turntable_drivers/ascii/explain_dialect.h) makes them: what the drivers send,
// in the order in which it is sent.
struct TableRow {
  std::string operation;  // connect, enable, home, move, stop, abort, status, fault reset, heartbeat
  std::string axis;       // or table
  std::string sent;       // registers, or a sentence; of a status what is read
  std::string says;       // numbers with their scale, bits with mask and polarity
  std::string answer;     // what is expected
  std::string source;     // line and mark
};

// The move that the rows show: an axis from 0 to 90 deg at 10 deg/s and 20 deg/s^2.
inline constexpr MoveNumbers shown_move{90.0, 90.0, 10.0, 20.0};

// "line 12 [manual]"; empty: the file has no such line.
std::string source_of(const TableDescription& table, const std::string& key);
// In columns, a line each, under one line of headings.
std::string format_rows(const std::vector<TableRow>& rows);

}  // namespace turncal
