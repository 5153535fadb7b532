// The common part of the twins of described tables: any Turntable behind the words of a map or a dialect (modbus_twin.h, dialect_twin.h).
//
// Enabling, homing, stopping or aborting one axis does so for the whole table, since a Turntable knows nothing else.
#pragma once

#include <array>
#include <functional>
#include <optional>

#include "turntable_drivers/table/table_description.h"
#include "turntable_drivers/table/turntable.h"

namespace turncal {

using DriveFlags = std::array<bool, drive_bit_count>;
DriveFlags flags_of(const AxisStatus& now);
// Scores how well a status code says these flags: faults count most, then what the station waits for. says: empty if it does not report one.
int likeness(const DriveFlags& flags, const std::function<std::optional<bool>(std::size_t bit)>& says);

// The commanded quantities of a move of one axis.
struct Told {
  std::optional<double> position_deg = {}, distance_deg = {};
  double rate_degps = 10.0, acceleration_degps2 = 20.0;  // defaults for a device without them
  void take(MoveQuantity quantity, double units, const AxisScale& scale);
};

class ToldTable {
 public:
  explicit ToldTable(Turntable& table) : table_(table) {}  // the table must outlive this

  Status power_on(bool enabled);  // connects; enabled: enables the table, because the device has no command for it
  // Reads the status; reopens a lost link to the table as soon as possible.
  Result<AxisStatus> status(Axis axis);
  Status carry_out(TableOperation operation, Axis axis, bool of_table);
  // of_all: the command has all axes. An axis already at, or moving to, its target within same_deg is then left alone.
  Status move(Axis axis, const AxisScale& scale, const Told& told, bool of_all, double same_deg);

 private:
  Turntable& table_;
  bool comes_up_enabled_ = false;
  std::array<std::optional<double>, 3> target_deg_;  // for commands with all three axes at once
  std::array<bool, 3> homed_round_{};
};

}  // namespace turncal
