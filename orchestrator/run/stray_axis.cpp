#include "orchestrator/run/stray_axis.h"

#include <cmath>
#include <cstdio>
#include <utility>

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

std::optional<std::string> HomingWatch::add(const TableStatus& axes) {
  const std::optional<TableStatus> before = std::exchange(before_, axes);
  if (!before) return std::nullopt;
  for (const Axis axis : all_axes) {
    const auto i = static_cast<std::size_t>(axis);
    const double seconds = axes[i].time_s - (*before)[i].time_s;
    const double moved_deg = std::abs(axes[i].position_deg - (*before)[i].position_deg);
    const bool set_anew = moved_deg > 2.0 * limits_[i].max_rate_degps * seconds;
    turned_deg_[axis] += std::max(std::abs(axes[i].rate_degps) * seconds, set_anew ? 0.0 : moved_deg);
    const double travel_deg = limits_[i].soft_max_deg - limits_[i].soft_min_deg;
    const double most_deg = std::min(2.0 * travel_deg, travel_deg + 360.0);
    if (turned_deg_[axis] <= most_deg) continue;
    char text[160];
    std::snprintf(text, sizeof text, "%s does not find its zero: it has turned %.0f deg, its travel is %.0f deg",
                  to_string(axis), turned_deg_[axis], travel_deg);
    return text;
  }
  return std::nullopt;
}

}  // namespace turncal
