// The rig as the table that a rehearsal by hand turns.
#pragma once

#include <algorithm>

#include "turntable_drivers/manual/manual_turntable.h"
#include "turntable_drivers/rig/rig.h"

namespace turncal {

// The rig must outlive the table.
inline RehearsedTable rehearsed_table(Rig& rig) {
  return {[&rig](Axis axis, double angle_deg, double rate_degps, double acceleration_degps2) {
            rig.command_move(axis, angle_deg, rate_degps, acceleration_degps2);
          },
          [&rig] {
            return std::any_of(all_axes.begin(), all_axes.end(), [&rig](Axis axis) { return rig.axis(axis).moving; });
          },
          [&rig] { rig.stop(); }};
}

}  // namespace turncal
