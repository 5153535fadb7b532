// The common part of a register map and a dialect: the line of a table, the scales of its axes, what its drives can report.
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

// The operations of a table, in the order of its file. A map has no identify; a dialect has no heartbeat, and its setup is called
// `prepare`.
enum class TableOperation { setup, identify, enable, home, move, status, stop, abort, clear_fault, heartbeat };
inline constexpr int table_operation_count = 9;  // without heartbeat, which has no list of steps
constexpr std::size_t index(TableOperation operation) { return std::size_t(operation); }
inline constexpr TableOperation all_operations[] = {
    TableOperation::setup, TableOperation::identify, TableOperation::enable,
    TableOperation::home,  TableOperation::move,     TableOperation::status,
    TableOperation::stop,  TableOperation::abort,    TableOperation::clear_fault};
template <>
inline constexpr auto enum_words<TableOperation> = std::to_array({"setup", "identify", "enable", "home", "move",
                                                                  "status", "stop", "abort", "clear_fault",
                                                                  "heartbeat"});
// The operations that start something, what they start, and those that must not.
inline constexpr TableOperation starting_operations[] = {TableOperation::enable, TableOperation::home,
                                                         TableOperation::move};
const char* harm_of(TableOperation starts);
// The axes to which an operation is sent: one stands for all if it is for the whole table.
constexpr std::span<const Axis> axes_for(bool of_table) { return std::span(all_axes).first(of_table ? 1 : 3); }

struct TableLinkSettings {
  bool tcp = true;
  std::string address;  // host:port, or a device name in /dev/serial/by-id
  SerialSettings serial;
  double reply_timeout_s = 1.0;
  double byte_timeout_s = 0.0;  // longest silence within a reply; 0: not checked
  double quiet_s = 0.5;         // after trouble the line is drained until it has been quiet for this long
  double gap_s = 0.0;           // silence before a request, required by some devices
  int read_retries = 2;         // repetitions of a failed reading; then the link is lost
};

// The quantities of a move, from which a register map or a dialect makes registers or a sentence.
struct MoveNumbers {
  double position_deg = 0.0, distance_deg = 0.0, rate_degps = 1.0, acceleration_degps2 = 1.0;
};
using Moves = std::array<MoveNumbers, 3>;  // by Axis

// A quantity in a map or dialect: "position", or for a given axis "rate.pitch".
enum class MoveQuantity { position, distance, rate, acceleration };
template <>
inline constexpr auto enum_words<MoveQuantity> = std::to_array({"position", "distance", "rate", "acceleration"});
// Removes the axis from the end of such a name; empty if it has none.
std::optional<Axis> take_axis(std::string_view& name);

// The scale of an axis: units = sign * units_per_degree * (angle_deg - zero_deg), modulo modulo_deg (in units) unless that is 0.
struct AxisScale {
  int sign = 1;
  double zero_deg = 0.0;  // the angle at which the device reads 0
  double units_per_degree = 1.0;
  double modulo_deg = 0.0;          // 0: the device counts turns; 360: its scale is circular
  bool shorter_way = false;         // circular: the device takes positions and goes the shorter way; else distances
  bool arrives_in_a_pulse = false;  // in_position is set only briefly: seen once after a command, it counts
  double rate_scale = 1.0;          // units of a commanded rate per 1 deg/s
  double measured_rate_scale = 1.0;
  double acceleration_scale = 1.0;
  bool ramp_time = false;  // an acceleration a is sent as acceleration_scale / a
  double signed_units() const { return sign * units_per_degree; }  // per degree
  double units_of(double angle_deg) const { return signed_units() * (angle_deg - zero_deg); }
  double angle_of(double units) const { return units / signed_units() + zero_deg; }
  double units_of(MoveQuantity quantity, const MoveNumbers& move) const;
};
// Returns "2500 per deg, 0 at 0 deg" for the commanded (told) or the measured quantity.
std::string scale_text(const AxisScale& scale, MoveQuantity quantity, bool told);

// True if a rate or acceleration is rounded by more than 5 %: an obedient drive would seem to have a wrong rate.
inline bool is_told_coarsely(double told, double units) { return !(std::abs(told - units) <= 0.05 * std::abs(units)); }

// Returns the angle_deg + n turns nearest to near_deg, which keeps the position of a circular device cumulative.
inline double unwrapped_deg(double angle_deg, double near_deg, double turn_deg) {
  return angle_deg + turn_deg * std::round((near_deg - angle_deg) / turn_deg);
}

// The first keys in the file of any device.
struct DeviceDescription {
  std::string file, name;
  bool verified_on_hardware = false;
  bool commissioned = false;      // tried as in docs/tables.md and docs/thermal.md; false: nothing is switched on
  std::vector<LineSource> lines;  // the source of each line of the file
};

struct TableDescription : DeviceDescription {
  bool simulated = false;               // a twin answers; set by the station, not by the file
  bool can_switch_off = true;           // by abort
  double moving_rate_degps = 0.01;      // if the axis does not report motion: faster than this is moving
  double plausible_deg = 7200.0;        // a position beyond this is not believed
  double plausible_rate_degps = 400.0;  // nor is one out of reach of the last at this rate
};

// True for a line that commands or stops a motion, or reports enabled, arrived or a fault.
bool decides_motion(std::string_view key);

void read_device_description(KeyValueFile& file, DeviceDescription& description);
void read_table_description(KeyValueFile& file, TableDescription& description);
// Reads the link keys common to both; `timeout`: the name of the first.
void read_link_times(KeyTable& keys, TableLinkSettings& link, const std::string& timeout);
inline constexpr NumberRange link_wait_range{0.001, 60.0};  // in s; a number outside is a mistake
// Reads the keys axis.NAME.* common to both; `units`: the name of units_per_degree, optional if it has a default.
void read_axis_scale(KeyValueFile& file, Axis axis, AxisScale& scale, const std::string& units, bool has_default);

// The flags that an axis can report: every register map and dialect is mapped to these. Also the states that it must
// be able to report: without one of them no axis would count as arrived, homed or off.
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
  const char* expected;  // in the words of an error message
  std::array<std::optional<bool>, drive_bit_count> flags{};
  std::optional<bool> operator[](DriveBit which) const { return flags[index(which)]; }
};
// searches: the zero must be searched for, so that an axis can be not homed.
std::array<DriveState, 4> drive_states(bool searches);

// A line of a description with an unintended effect.
struct Clash {
  std::string key;
  std::string expected;
};

// What is sent to a described table and what it answers, as rows to compare with its manual. explain() of a register map or a dialect
// lists what the driver sends, in the order of sending.
struct TableRow {
  std::string operation;  // connect, enable, home, move, stop, abort, status, fault reset, heartbeat
  std::string axis;       // or table
  std::string sent;       // registers or a sentence; for status, what is read
  std::string says;       // quantities with their scale, bits with mask and polarity
  std::string answer;     // what is expected
  std::string source;     // line and mark
};

// The move shown in the rows: an axis from 0 to 90 deg at 10 deg/s and 20 deg/s^2.
inline constexpr MoveNumbers shown_move{90.0, 90.0, 10.0, 20.0};

// The operations in that order, and their names in the rows.
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

// Returns "line 12 [manual]"; empty if the file has no such line.
std::string source_of(const DeviceDescription& device, const std::string& key);
// Returns the rows as columns under a line of headings, one line each.
std::string format_rows(const std::vector<TableRow>& rows);

// Makes control characters visible for messages; `most` limits the number of characters.
std::string visible(std::string_view text, std::size_t most = 80);

}  // namespace turncal
