// What the twins of described tables have in common: any Turntable behind the words of a map or a dialect (modbus_twin.h, dialect_twin.h).
//
// home, enable, abort and stop of one axis are those of the whole table, since a Turntable knows no others.
#pragma once

#include <array>
#include <functional>
#include <optional>

#include "turntable_drivers/table/table_description.h"
#include "turntable_drivers/table/turntable.h"

namespace turncal {

using DriveFlags = std::array<bool, drive_bit_count>;
DriveFlags flags_of(const AxisStatus& now);
// How well a code of a device says these flags: faults count most, then what the station waits for. says: none where it does not tell.
int likeness(const DriveFlags& flags, const std::function<std::optional<bool>(std::size_t bit)>& says);

// What a move tells an axis.
struct Told {
  std::optional<double> position_deg = {}, distance_deg = {};
  double rate_degps = 10.0, acceleration_degps2 = 20.0;  // of a device that is not told
  void take(MoveQuantity quantity, double units, const AxisScale& scale);
};

class ToldTable {
 public:
  explicit ToldTable(Turntable& table) : table_(table) {}  // the table must outlive this

  Status power_on(bool enabled);  // connects to it; drives without a word for it come up enabled
  // A link to it that was lost is opened anew as soon as it can be.
  Result<AxisStatus> status(Axis axis);
  Status carry_out(TableOperation operation, Axis axis, bool of_table);
  // of_all: the others are told too. One that is there, or on its way, is then left alone, to so many degrees.
  Status move(Axis axis, const AxisScale& scale, const Told& told, bool of_all, double same_deg);

 private:
  Turntable& table_;
  bool comes_up_enabled_ = false;
  std::array<std::optional<double>, 3> target_deg_;  // of a table that is told of all three axes at once
  std::array<bool, 3> homed_round_{};
};

}  // namespace turncal
