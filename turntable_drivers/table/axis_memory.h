// What a driver remembers of an axis from reading to reading, and what it makes of a new one. Plain arithmetic.
//
// - A position is believable when it is finite, within plausible_deg, and, once homed, no further from the last than
//   plausible_rate_degps allows (and 1 deg).
// - A device that tells no rate: it comes from two positions at least 50 ms apart, since one count in 1 ms would be a motion; NaN
//   (unknown, which is "not arrived") until there are two.
// - After a command to home the flag may be the old one: homed counts when the homing was seen to begin (the flag gone, the axis turning or
//   elsewhere), or from the third reading on of an axis that stands at its zero.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

namespace turncal {

struct AxisMemory {
  std::optional<double> position_deg;  // last believed, cumulative
  double read_s = 0.0;
  double rate_degps = std::numeric_limits<double>::quiet_NaN();  // from two positions
  double rate_base_deg = 0.0, rate_base_s = -std::numeric_limits<double>::infinity();
  bool homed = false;        // as last reported
  bool home_called = false;  // since the link was opened
  int homing_polls = 0;
  bool homing_seen = false;
  std::optional<double> homing_from_deg;
  bool arrived_seen = false;  // of a flag that shows for a moment only
  double heartbeat_s = -1e9;
  std::optional<bool> drive_on;  // as last read; empty: not read since it was connected or switched on

  bool believable(double angle_deg, double now_s, double plausible_deg, double plausible_rate_degps) const {
    if (!(std::abs(angle_deg) <= plausible_deg)) return false;
    if (!position_deg || !homed) return true;
    const double reach_deg = 1.0 + plausible_rate_degps * std::max(0.0, now_s - read_s);
    return std::abs(angle_deg - *position_deg) <= reach_deg;
  }
  void note(double angle_deg, double now_s) {
    constexpr double shortest_interval_s = 0.05;
    if (now_s - rate_base_s >= shortest_interval_s) {
      if (std::isfinite(rate_base_s)) rate_degps = (angle_deg - rate_base_deg) / (now_s - rate_base_s);
      rate_base_deg = angle_deg;
      rate_base_s = now_s;
    }
    position_deg = angle_deg;
    read_s = now_s;
  }
  // searches: the axis has to turn to find its zero.
  void homing_began(bool searches) {
    home_called = true;
    homed = false;
    homing_polls = 3;
    homing_seen = !searches;
    homing_from_deg = position_deg;
  }
  // REQUIRES: note() has the position of this reading.
  bool judge_homed(bool device_says, bool moving) {
    constexpr double stands_deg = 1.0;
    const auto is_at = [&](double angle_deg) {
      return position_deg && std::abs(*position_deg - angle_deg) <= stands_deg;
    };
    if (home_called && !homing_seen) {
      homing_polls = std::max(0, homing_polls - 1);
      homing_seen = moving || !device_says || (homing_from_deg && !is_at(*homing_from_deg));
      homed = device_says && !moving && (homing_seen || (homing_polls == 0 && is_at(0.0)));
      homing_seen = homing_seen || homed;
      return homed;
    }
    homed = device_says;
    return homed;
  }
};

}  // namespace turncal
