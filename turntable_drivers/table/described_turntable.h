// What the drivers of tables that a file describes (a register map, a dialect) do alike: when an axis may be enabled, homed or moved,
// and what they remember from command to command.
//
// - Nothing is switched on or moves before the description is commissioned, enable() was called since connect(), and the drive's own
//   state says enabled, homed, at rest, without fault, in remote.
// - A position is believed by the rule of AxisMemory.
// - A drive that was told to go off, or last read off, is sent abort in place of stop: a stop must not switch it on.
// One thread.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <utility>

#include "imu_io/base/clock.h"
#include "turntable_drivers/table/stop_signal.h"
#include "turntable_drivers/table/table_description.h"
#include "turntable_drivers/table/turntable.h"

namespace turncal {

// What a driver remembers of an axis from reading to reading, and what it makes of a new one. Plain arithmetic.
//
// - A position is believable when it is finite, within plausible_deg, and, once homed, no further from the last than
//   plausible_rate_degps allows (and 1 deg).
// - A device that tells no rate: it comes from two positions at least 50 ms apart, since one count in 1 ms would be a motion; NaN
//   (unknown, which is "not arrived") until there are two.
// - After a command to home the flag may be the old one: homed counts when the homing was seen to begin (the flag gone, the axis turning or
//   elsewhere), or from the third reading on of an axis that stands at its zero.
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

class DescribedTurntable : public Turntable {
 public:
  Status stop_all() override { return halt(false); }
  Status abort_all() override;
  void set_meanwhile(std::function<void()> meanwhile) override { stop_.set_meanwhile(std::move(meanwhile)); }
  bool was_connected() const override { return was_connected_; }
  bool answers() const override { return connected_ && !lost(); }
  bool can_switch_off() const override { return table_.can_switch_off; }

 protected:
  // The clock and the count must outlive the table.
  DescribedTurntable(TableDescription description, const Clock& clock, const std::atomic<int>* stop_requests)
      : clock_(clock), stop_(stop_requests), table_(std::move(description)) {}

  virtual bool lost() const = 0;  // the link, since it was opened
  virtual std::string lost_reason() const = 0;
  virtual Status halt(bool off) = 0;  // to every axis at once

  Error table_error(const std::string& what) const;
  Error axis_error(Axis axis, const std::string& what) const;
  Error not_believed(Axis axis, double position_deg) const;
  bool believable(Axis axis, double position_deg) const;
  Status connected() const;
  Status commissioned() const;
  Status may_enable(Axis axis);
  // The axis's reading; or why it must not be homed or moved now.
  Result<AxisStatus> ready(Axis axis);
  Result<AxisStatus> ready_to_move(Axis axis, double position_deg, double rate_degps, double acceleration_degps2);
  // Of a stop to one axis, or to the whole table.
  bool is_off(Axis axis, bool one) const;

  const Clock& clock_;
  StopSignal stop_;
  bool connected_ = false;
  bool was_connected_ = false;
  bool enable_called_ = false;
  bool commanded_off_ = false;  // since enable()
  bool targets_void_ = true;    // after a stop or a homing the axes stand elsewhere
  std::array<AxisMemory, 3> memory_;

 private:
  const TableDescription table_;
};

}  // namespace turncal
