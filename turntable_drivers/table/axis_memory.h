// What a driver remembers of an axis from reading to reading, and what it makes of a new one. Plain arithmetic.
//
// - A position is believable when it is finite, within plausible_deg, and, once homed, no further from the last than
//   plausible_rate_degps allows (and 1 deg).
// - A device that tells no rate: it comes from two positions at least 50 ms apart, since one count in 1 ms would be a motion; NaN
//   (unknown, which is "not arrived") until there are two.
// - After a command to home, homed counts when the homing was seen to begin, or from the fourth reading on: the flag may be the
//   old one.
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
  void homing_began() {
    home_called = true;
    homed = false;
    homing_polls = 3;
    homing_seen = false;
  }
  bool judge_homed(bool device_says, bool moving) {
    if (homing_polls > 0) {
      --homing_polls;
      homing_seen = homing_seen || moving || !device_says;
      if (homing_seen) homing_polls = 0;
      homed = device_says && homing_polls == 0 && !(moving && homing_seen);
      return homed;
    }
    homed = device_says;
    return homed;
  }
};

}  // namespace turncal
