// What the drivers of tables that a file describes (a register map, a dialect) do alike: when an axis may be enabled, homed or moved,
// and what they remember from command to command.
//
// - Nothing is switched on or moves before the description is commissioned, enable() was called since connect(), and the drive's own
//   state says enabled, homed, at rest, without fault, in remote.
// - A position is believed by axis_memory.h's rule.
// - A drive that was told to go off, or last read off, is sent abort in place of stop: a stop must not switch it on.
// One thread.
#pragma once

#include <array>
#include <atomic>
#include <functional>
#include <string>
#include <utility>

#include "imu_io/base/clock.h"
#include "turntable_drivers/table/axis_memory.h"
#include "turntable_drivers/table/stop_signal.h"
#include "turntable_drivers/table/table_description.h"
#include "turntable_drivers/table/turntable.h"

namespace turncal {

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
