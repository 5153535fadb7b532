#include "orchestrator/run/stray_axis.h"

#include <cmath>
#include <cstdio>
#include <utility>

namespace turncal {

namespace {

constexpr double homing_begins_s = 20.0;  // after the command, or after another axis has found its zero
constexpr double turns_degps = 0.01;

}  // namespace

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
  char text[160];
  double passed_s = 0.0;
  bool any_turns = false;
  for (const Axis axis : all_axes) {
    const auto i = static_cast<std::size_t>(axis);
    const double seconds = axes[i].time_s - (*before)[i].time_s;
    const double moved_deg = std::abs(axes[i].position_deg - (*before)[i].position_deg);
    const bool set_anew = moved_deg > 2.0 * limits_[i].max_rate_degps * seconds;
    const double by_rate_deg = std::isfinite(axes[i].rate_degps) ? std::abs(axes[i].rate_degps) * seconds : 0.0;
    turned_deg_[axis] += std::max(by_rate_deg, set_anew ? 0.0 : moved_deg);
    passed_s = std::max(passed_s, seconds);
    any_turns = any_turns || axes[i].moving || std::max(by_rate_deg, moved_deg) > turns_degps * seconds;
    const double travel_deg = limits_[i].soft_max_deg - limits_[i].soft_min_deg;
    const double most_deg = std::min(2.0 * travel_deg, travel_deg + 360.0);
    if (turned_deg_[axis] <= most_deg) continue;
    std::snprintf(text, sizeof text, "%s does not find its zero: it has turned %.0f deg, its travel is %.0f deg",
                  to_string(axis), turned_deg_[axis], travel_deg);
    return text;
  }
  idle_s_ = any_turns ? 0.0 : idle_s_ + passed_s;
  for (const Axis axis : all_axes) {
    const AxisStatus& now = axes[static_cast<std::size_t>(axis)];
    if (idle_s_ < homing_begins_s || now.homed) continue;
    std::snprintf(text, sizeof text,
                  "%s does not look for its zero: it stands at %.4f deg, and nothing has turned for %.0f s",
                  to_string(axis), now.position_deg, idle_s_);
    return text;
  }
  return std::nullopt;
}

}  // namespace turncal
