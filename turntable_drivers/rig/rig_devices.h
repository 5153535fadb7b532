// RigTable: the mock table. It gives the rig's axes the interface of every table driver.
//
// It behaves like a real table: it must be connected, enabled and homed before a move; angle, rate and acceleration are limited; an axis
// makes one move at a time; faults are latched until clear_fault(); an emergency stop is latched until the operator has released
// it (Rig::release_emergency_stop) and clear_fault() is called. clear_fault() leaves the axes disabled. status()
// reads the encoder (rounded to its resolution); time does not pass. raw: bit 0 enabled, 1 homed, 2 moving,
// 3 in position, 4 limit, 5 fault, 6 emergency stop, 7 homing.
#pragma once

#include <array>
#include <functional>
#include <utility>
#include <vector>

#include "imu_io/recordings/imu_source.h"
#include "turntable_drivers/rig/rig.h"
#include "turntable_drivers/table/turntable.h"

namespace turncal {

class RigTable : public Turntable {
 public:
  explicit RigTable(Rig& rig) : RigTable({&rig}, [] {}) {}  // the rig must outlive the table
  // Commands several rigs alike, so that they stay alike. `before` is called at the start of every call.
  RigTable(std::vector<Rig*> rigs, std::function<void()> before)
      : rigs_(std::move(rigs)), rig_(*rigs_.front()), before_(std::move(before)) {}

  Status connect() override;
  Result<TableIdentity> identify() override;
  Status enable() override;
  Status home() override;
  Status move_absolute(Axis axis, double position_deg, double rate_degps, double acceleration_degps2) override;
  Status stop_all() override;
  Status abort_all() override;
  Status clear_fault() override;
  Result<AxisStatus> status(Axis axis) override;

 private:
  Status reachable();       // connected, and the link is up
  Status ready(Axis axis);  // reachable, enabled, no emergency stop, no fault
  void update();            // takes over what happened in the rig since the last call
  bool in_position(Axis axis, const Rig::AxisState& state) const;

  std::vector<Rig*> rigs_;
  Rig& rig_;  // the first one, which is read
  std::function<void()> before_;
  bool connected_ = false;
  std::array<bool, 3> enabled_{};
  std::array<bool, 3> homed_{};
  std::array<bool, 3> homing_{};
  double homing_ends_s_ = 0.0;
};

// RigImu: the unit on the rig as an ImuSource. Only read() makes the rig's time pass.
//
// read(out, timeout_s) advances the rig by at most min(out.size(), floor(timeout_s / period)) samples and returns
// them. When a fault loses samples, fewer are returned than periods have passed, and none
// while the unit is silent.
class RigImu : public ImuSource {
 public:
  explicit RigImu(Rig& rig) : rig_(rig) {}  // the rig must outlive the source

  Status open() override;
  Result<ImuIdentity> identify() override;
  // Pulses, period and pulse weight of the rig's configuration, with temperature, simulated = true.
  void describe(RecordingInfo& info) const override;
  Result<std::size_t> read(std::span<ImuSample> out, double timeout_s) override;
  ImuLinkCounters counters() const override { return counters_; }
  void close() override { open_ = false; }

 private:
  Rig& rig_;
  bool open_ = false;
  bool have_counter_ = false;
  std::int64_t last_counter_ = 0;
  ImuLinkCounters counters_;
};

}  // namespace turncal
