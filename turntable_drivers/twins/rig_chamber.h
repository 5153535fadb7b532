// Other parts of the rig for a dry run: the chamber around its units, and the table that a rehearsal turns instead of a person.
#pragma once

#include <algorithm>

#include "turntable_drivers/chamber/chamber.h"
#include "turntable_drivers/manual/manual_turntable.h"
#include "turntable_drivers/rig/rig_group.h"

namespace turncal {

// The chamber shared by all rigs of a group; its time is theirs.
class RigChamber : public Chamber {
 public:
  RigChamber(RigGroup& group, ChamberLimits limits) : group_(group), limits_(limits) {}  // the group must outlive this

  Status connect() override { return reachable(); }
  std::string identity() const override { return "simulated chamber"; }
  const ChamberLimits& limits() const override { return limits_; }
  Result<ChamberStatus> status() override {
    TRY(reachable());
    const Rig::ChamberState now = group_.rig(0).chamber();
    return ChamberStatus{now.actual_c, now.set_point_c, now.on, now.door_open, now.alarm};
  }
  Status set(double temperature_c, double ramp_c_per_min) override {
    TRY(check_set_point(limits_, temperature_c, ramp_c_per_min));
    TRY(reachable());
    ramp_c_per_min_ = ramp_c_per_min;
    return command(temperature_c, group_.rig(0).chamber().on);
  }
  Status on() override { return switched(true); }
  Status off() override { return switched(false); }
  void disconnect() override {}

 private:
  Status reachable() {
    group_.bring_up_all();
    return group_.rig(0).chamber().link_lost ? Status(device_error("simulated chamber: the link is lost")) : Status{};
  }
  Status switched(bool on) {
    TRY(reachable());
    return command(group_.rig(0).chamber().set_point_c, on);
  }
  Status command(double set_point_c, bool on) {
    for (std::size_t i = 0; i < group_.size(); ++i) group_.rig(i).command_chamber(set_point_c, ramp_c_per_min_, on);
    return {};
  }
  RigGroup& group_;
  const ChamberLimits limits_;
  double ramp_c_per_min_ = 1.0;
};

// The rig must outlive the table.
inline RehearsedTable rehearsed_table(Rig& rig) {
  return {[&rig](Axis axis, double angle_deg, double rate_degps, double acceleration_degps2) {
            rig.command_move(axis, angle_deg, rate_degps, acceleration_degps2);
          },
          [&rig] { return std::ranges::any_of(all_axes, [&rig](Axis axis) { return rig.axis(axis).moving; }); },
          [&rig] { rig.stop(); }};
}

}  // namespace turncal
