// What a register map and a dialect alike say of a table: its line, how it counts its axes, what its drives can say of themselves.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "calib/types/axis.h"
#include "imu_io/base/key_value.h"
#include "imu_io/base/text.h"
#include "imu_io/lines/serial_port.h"

namespace turncal {

// What a table is told or asked, in the order in which files list it. A map has nothing to identify; a dialect has no heartbeat, and calls
// setup `prepare`.
enum class TableOperation { setup, identify, enable, home, move, status, stop, abort, clear_fault, heartbeat };
inline constexpr int table_operation_count = 9;  // heartbeat aside, which is no list of steps
constexpr std::size_t index(TableOperation operation) { return std::size_t(operation); }
inline constexpr TableOperation all_operations[] = {
    TableOperation::setup, TableOperation::identify, TableOperation::enable,
    TableOperation::home,  TableOperation::move,     TableOperation::status,
    TableOperation::stop,  TableOperation::abort,    TableOperation::clear_fault};
template <>
inline constexpr auto enum_words<TableOperation> = std::to_array({"setup", "identify", "enable", "home", "move",
                                                                  "status", "stop", "abort", "clear_fault",
                                                                  "heartbeat"});
// Operations that start something, what that is, and those that must not.
inline constexpr TableOperation starting_operations[] = {TableOperation::enable, TableOperation::home,
                                                         TableOperation::move};
const char* harm_of(TableOperation starts);
// Whom an operation is sent for: one axis stands for all where it is of the whole table.
constexpr std::span<const Axis> axes_for(bool of_table) { return std::span(all_axes).first(of_table ? 1 : 3); }

struct TableLinkSettings {
  bool tcp = true;
  std::string address;  // host:port, or the device (a name of /dev/serial/by-id)
  SerialSettings serial;
  double reply_timeout_s = 1.0;
  double byte_timeout_s = 0.0;  // silence inside a reply; 0: not looked for
  double quiet_s = 0.5;         // after trouble the line is read empty until it has been quiet for this long
  double gap_s = 0.0;           // silence before a request, which some devices need
  int read_retries = 2;         // the third failure in a row is a lost link
};

// The numbers of a move as the program has them: what a register map or a dialect makes registers or a sentence of.
struct MoveNumbers {
  double position_deg = 0.0, distance_deg = 0.0, rate_degps = 1.0, acceleration_degps2 = 1.0;
};
using Moves = std::array<MoveNumbers, 3>;  // by Axis

// One of them, as a map or a dialect asks for it: "position", or of a certain axis "rate.pitch".
enum class MoveQuantity { position, distance, rate, acceleration };
template <>
inline constexpr auto enum_words<MoveQuantity> = std::to_array({"position", "distance", "rate", "acceleration"});
// Takes the axis off the end of such a name; empty: it names none.
std::optional<Axis> take_axis(std::string_view& name);

// How a device counts an axis: units = sign * units_per_degree * (angle_deg - zero_deg), taken modulo those of modulo_deg if that is not 0.
struct AxisScale {
  int sign = 1;
  double zero_deg = 0.0;  // the angle at which it reads 0
  double units_per_degree = 1.0;
  double modulo_deg = 0.0;   // 0: it counts turns; 360: it knows only a circle
  bool shorter_way = false;  // of a circle: it takes positions of it and goes there the shorter way; else distances
  bool arrives_in_a_pulse = false;  // in_position shows only for a moment: once seen after a command it counts
  double rate_scale = 1.0;          // units of a commanded rate for 1 deg/s
  double measured_rate_scale = 1.0;
  double acceleration_scale = 1.0;
  bool ramp_time = false;  // an acceleration a is told as acceleration_scale / a
  double signed_units() const { return sign * units_per_degree; }  // per degree
  double units_of(double angle_deg) const { return signed_units() * (angle_deg - zero_deg); }
  double angle_of(double units) const { return units / signed_units() + zero_deg; }
  double units_of(MoveQuantity quantity, const MoveNumbers& move) const;
};
// "2500 per deg, 0 at 0 deg": of what it is told, or else tells.
std::string scale_text(const AxisScale& scale, MoveQuantity quantity, bool told);

// A rate or acceleration that a device gets as another one: beyond it a drive that does as it is told is at fault by its rate.
inline bool is_told_coarsely(double told, double units) { return !(std::abs(told - units) <= 0.05 * std::abs(units)); }

// Which of angle_deg + n turns lies nearest to near_deg: how a cumulative position is kept of a device that knows a circle only.
inline double unwrapped_deg(double angle_deg, double near_deg, double turn_deg) {
  return angle_deg + turn_deg * std::round((near_deg - angle_deg) / turn_deg);
}

// What the file of any device says first.
struct DeviceDescription {
  std::string file, name;
  bool verified_on_hardware = false;
  bool commissioned = false;      // tried as docs/tables.md and docs/thermal.md have it; else nothing is switched on
  std::vector<LineSource> lines;  // of the file: where each comes from
};

struct TableDescription : DeviceDescription {
  bool simulated = false;               // a twin answers; not a key of the file: the station says it
  bool can_switch_off = true;           // abort does
  double moving_rate_degps = 0.01;      // of an axis that does not tell: faster than this is moving
  double plausible_deg = 7200.0;        // a position beyond this is not believed
  double plausible_rate_degps = 400.0;  // nor is one that the axis cannot have reached since the last
};

// Whether a line says what moves an axis, stops it, or tells that it is on, has arrived or is at fault.
bool decides_motion(std::string_view key);

void read_device_description(KeyValueFile& file, DeviceDescription& description);
void read_table_description(KeyValueFile& file, TableDescription& description);
// The keys of a line that both have; `timeout`: the name of the first.
void read_link_times(KeyTable& keys, TableLinkSettings& link, const std::string& timeout);
inline constexpr NumberRange link_wait_range{0.001, 60.0};  // seconds; a number beyond is a slip of the pen
// The keys of axis.NAME. that both have; `units`: the name of units_per_degree, which may be missing where it has a default.
void read_axis_scale(KeyValueFile& file, Axis axis, AxisScale& scale, const std::string& units, bool has_default);

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
template <>
inline constexpr auto enum_words<DriveBit> = std::to_array({"enabled", "in_position", "fault", "moving", "homed",
                                                            "limit_positive", "limit_negative", "emergency_stop",
                                                            "remote"});
inline constexpr std::size_t drive_bit_count = enum_words<DriveBit>.size();
constexpr std::size_t index(DriveBit bit) { return std::size_t(bit); }
inline constexpr auto all_drive_bits = [] {
  std::array<DriveBit, drive_bit_count> all{};
  for (std::size_t i = 0; i < all.size(); ++i) all[i] = static_cast<DriveBit>(i);
  return all;
}();

struct DriveState {
  DriveBit bit;          // what it is about
  const char* expected;  // of a status
  std::array<std::optional<bool>, drive_bit_count> flags{};
  std::optional<bool> operator[](DriveBit which) const { return flags[index(which)]; }
};
// searches: its zero has to be looked for, so that there is a time before.
std::array<DriveState, 4> drive_states(bool searches);

// A line of a description that would do more than it is called.
struct Clash {
  std::string key;
  std::string expected;
};

// What a described table is sent and answers, as rows that somebody holds against its manual. explain() of a register map and of a dialect
// makes them: what the driver sends, in the order in which it is sent.
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

// The operations in that order, and what the rows call them.
struct ShownOperation {
  TableOperation operation;
  const char* name;
};
inline constexpr ShownOperation shown_operations[] = {{TableOperation::setup, "connect"},
                                                      {TableOperation::identify, "connect"},
                                                      {TableOperation::enable, "enable"},
                                                      {TableOperation::home, "home"},
                                                      {TableOperation::move, "move"},
                                                      {TableOperation::stop, "stop"},
                                                      {TableOperation::abort, "abort"},
                                                      {TableOperation::status, "status"},
                                                      {TableOperation::clear_fault, "fault reset"}};

// "line 12 [manual]"; empty: the file has no such line.
std::string source_of(const DeviceDescription& device, const std::string& key);
// In columns, a line each, under one line of headings.
std::string format_rows(const std::vector<TableRow>& rows);

// Control characters made visible, for messages, of which `most` characters are enough.
std::string visible(std::string_view text, std::size_t most = 80);

}  // namespace turncal
