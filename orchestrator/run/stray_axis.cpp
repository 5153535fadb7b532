#include "orchestrator/run/stray_axis.h"

#include <cmath>
#include <cstdio>

namespace turncal {

std::optional<std::string> stray_axis(const TableStatus& axes, const AxisTriple& held_deg,
                                      const std::optional<Move>& move, double standing_deg,
                                      double position_tolerance_deg) {
  const double beyond_deg = least_runaway_deg(position_tolerance_deg);
  for (const Axis axis : all_axes) {
    const double at_deg = axes[static_cast<std::size_t>(axis)].position_deg;
    char text[160];
    if (move && move->axis == axis) {
      const double low = std::min(held_deg[axis], move->target_deg), high = std::max(held_deg[axis], move->target_deg);
      if (at_deg >= low - beyond_deg && at_deg <= high + beyond_deg) continue;
      std::snprintf(text, sizeof text, "%s runs away: at %.4f deg on the way from %.4f to %.4f deg", to_string(axis),
                    at_deg, held_deg[axis], move->target_deg);
    } else {
      if (std::abs(at_deg - held_deg[axis]) <= standing_deg) continue;
      std::snprintf(text, sizeof text, "%s moves although nothing sent it: from %.4f to %.4f deg", to_string(axis),
                    held_deg[axis], at_deg);
    }
    return text;
  }
  return std::nullopt;
}

}  // namespace turncal
