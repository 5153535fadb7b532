// LimitedTurntable: what the station allows, around any driver. A move beyond the soft travel, the rate, the acceleration or the
// cable's winding is refused before the driver hears of it; everything else is passed on.
//
// The cable's winding of an axis is the largest minus the smallest cumulative angle it has stood at, or was sent to, since it was
// homed. The plan is checked against the same limits before a run (sequences/plan.h); this is the second lock, for moves that
// no plan knows. An axis found outside its soft travel may only be moved back into it.
// A table that finds its zero at every turn forgets a turn of its cable when it is homed: start with the cable unwound.
// Not modelled: the room between axes (a unit that hits the frame at some combination of angles).
#pragma once

#include <array>
#include <optional>

#include "turntable_drivers/table/turntable.h"

namespace turncal {

// The same numbers as AxisLimits of sequences/plan.h, which is not below this folder.
struct MotionLimits {
  double soft_min_deg = -540.0;
  double soft_max_deg = 540.0;
  double max_rate_degps = 100.0;
  double max_acceleration_degps2 = 100.0;
  double wrap_deg = 720.0;  // 0: slip rings, no limit
};

class LimitedTurntable : public Turntable {
 public:
  LimitedTurntable(Turntable& table, const std::array<MotionLimits, 3>& limits)  // the table must outlive this
      : table_(table), limits_(limits) {}

  Status connect() override { return table_.connect(); }
  Result<TableIdentity> identify() override { return table_.identify(); }
  Status enable() override;
  Status home() override;
  Status move_absolute(Axis axis, double position_deg, double rate_degps, double acceleration_degps2) override;
  Status stop_all() override { return table_.stop_all(); }
  Status abort_all() override;
  Status clear_fault() override { return table_.clear_fault(); }
  Result<AxisStatus> status(Axis axis) override;
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
  std::array<MotionLimits, 3> limits_;
  std::array<std::optional<Travel>, 3> travel_;  // since homing
  bool switched_on_ = false;
};

}  // namespace turncal
