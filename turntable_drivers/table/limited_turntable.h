// LimitedTurntable: the limits of the station around any driver. A move beyond the soft travel, the rate, the acceleration or the
// cable winding is refused before it reaches the driver; everything else is passed on.
//
// The cable winding of an axis is the largest minus the smallest cumulative angle at which it stood, or to which it was sent, since it was
// homed. The plan is checked against the same limits before a run (sequences/plan.h); this is the second check, for moves that
// are in no plan. An axis found outside its soft travel may only be moved back into it.
// A table that finds its zero once per turn forgets a wound turn of the cable on homing: start with the cable unwound.
// Not modelled: collisions that depend on the combination of angles.
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <optional>

#include "calib/types/axis.h"
#include "imu_io/base/text.h"
#include "turntable_drivers/table/turntable.h"

namespace turncal {

class LimitedTurntable : public Turntable {
 public:
  LimitedTurntable(Turntable& table, const std::array<AxisLimits, 3>& limits)  // the table must outlive this
      : table_(table), limits_(limits) {}

  Status connect() override { return table_.connect(); }
  Result<TableIdentity> identify() override { return table_.identify(); }
  Status enable() override {
    switched_on_ = true;  // even if the answer was lost
    return table_.enable();
  }
  Status home() override {
    travel_ = {};  // homing may change the zero, and the winding is counted from there
    return table_.home();
  }
  Status move_absolute(Axis axis, double position_deg, double rate_degps, double acceleration_degps2) override {
    const AxisLimits& limit = limits_[index(axis)];
    const auto refused = [axis](const std::string& what, double value, const char* unit, double most) {
      return input_error("motion limits: {}: {} {} {}: expected at most {} {}", to_string(axis), what,
                         format_number(value), unit, format_number(most), unit);
    };
    if (!(position_deg >= limit.soft_min_deg && position_deg <= limit.soft_max_deg))
      return input_error("motion limits: {}: move to {} deg: expected {} to {} deg", to_string(axis),
                         format_number(position_deg), format_number(limit.soft_min_deg),
                         format_number(limit.soft_max_deg));
    if (!(rate_degps <= limit.max_rate_degps)) return refused("rate", rate_degps, "deg/s", limit.max_rate_degps);
    if (!(acceleration_degps2 <= limit.max_acceleration_degps2))
      return refused("acceleration", acceleration_degps2, "deg/s^2", limit.max_acceleration_degps2);
    // The present position is part of the travel.
    TRY(status(axis));
    const std::optional<Travel>& known = travel_[index(axis)];
    if (known && limit.wrap_deg > 0.0) {
      constexpr double rounding_deg = 1e-9;
      const double wound_deg = std::max(known->max_deg, position_deg) - std::min(known->min_deg, position_deg);
      const double before_deg = known->max_deg - known->min_deg;
      if (wound_deg > limit.wrap_deg + rounding_deg && wound_deg > before_deg + rounding_deg)
        return refused("the move to " + format_number(position_deg) + " deg winds the cable by", wound_deg, "deg",
                       limit.wrap_deg);
    }
    return table_.move_absolute(axis, position_deg, rate_degps, acceleration_degps2);
  }
  Status stop_all() override { return table_.stop_all(); }
  Status abort_all() override {
    const Status aborted = table_.abort_all();
    if (aborted) switched_on_ = false;
    return aborted;
  }
  Status clear_fault() override { return table_.clear_fault(); }
  Result<AxisStatus> status(Axis axis) override {
    Result<AxisStatus> now = table_.status(axis);
    std::optional<Travel>& travel = travel_[index(axis)];
    if (now && now->homed) {
      if (!travel) travel = Travel{now->position_deg, now->position_deg};
      travel->min_deg = std::min(travel->min_deg, now->position_deg);
      travel->max_deg = std::max(travel->max_deg, now->position_deg);
    }
    return now;
  }
  bool needs_operator() const override { return table_.needs_operator(); }
  void set_meanwhile(std::function<void()> meanwhile) override { table_.set_meanwhile(std::move(meanwhile)); }
  bool was_connected() const override { return table_.was_connected(); }
  bool was_switched_on() const override { return switched_on_; }
  bool answers() const override { return table_.answers(); }
  bool can_switch_off() const override { return table_.can_switch_off(); }
  bool tells_drives() const override { return table_.tells_drives(); }

 private:
  struct Travel {
    double min_deg = 0.0, max_deg = 0.0;
  };
  Turntable& table_;
  std::array<AxisLimits, 3> limits_;
  std::array<std::optional<Travel>, 3> travel_;  // since homing
  bool switched_on_ = false;
};

}  // namespace turncal
