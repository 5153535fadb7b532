// The rig: a physical model of a table and the unit on it, which owns its time. It shares no model code with calib/.
//
// Frames and signs are those of docs/rig.md: n = north, up, east; b = x front, y up, z right; C_nb: rig_geometry.h. The unit feels
// f_b = C_bn (0, g, 0) and w_ib_b = C_bn w_ie_n + (rate of the table), with w_ie_n = W (cos L, sin L, 0).
// Increments are integrals over the sample: in closed form while every axis stands, by Gauss-Legendre quadrature in motion, split where
// an axis changes its acceleration. Time is counted in samples, and only advance() and advance_time() make it pass.
//
// Not modelled: the lever arm from the table's centre to the unit (unobservable), Schuler motion, deflection of the
// vertical, structural flexibility, vibration, and the unit's bandwidth (except accel_delay).
//
// Not thread-safe: one thread uses Rig, RigTable and RigImu of one rig.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "calib/types/axis.h"
#include "calib/types/recording_types.h"
#include "turntable_drivers/rig/rig_config.h"

namespace turncal {

namespace rig_model {
struct RigState;
}

class Rig {
 public:
  // REQUIRES: check(config).ok()
  explicit Rig(const RigConfig& config);
  ~Rig();
  Rig(const Rig&) = delete;
  Rig& operator=(const Rig&) = delete;

  const RigConfig& config() const;

  // --- Table: raw axes. Limits, enabling and homing belong to RigTable.
  // Moves to `target_deg` (encoder angle, cumulative) with a trapezoidal rate profile, from any state of the axis: an axis
  // in motion brakes first. It takes effect at the current sample boundary. A stuck axis accepts the command and does not move.
  // REQUIRES: rate and acceleration > 0
  void command_move(Axis axis, double target_deg, double rate_degps, double acceleration_degps2);
  void stop();   // every axis brakes with its last commanded acceleration
  void abort();  // every axis stops within one sample

  struct AxisState {
    double position_deg = 0.0;  // encoder, not rounded
    double rate_degps = 0.0;
    double target_deg = 0.0;  // of the last command
    bool moving = false;      // by a command (or by a table_moved fault that the encoder sees)
    bool fault = false;       // latched axis_fault
    bool stuck = false;
    bool never_in_position = false;
    double started_s = 0.0;  // rig time of the last command
    double stopped_s = 0.0;  // rig time at the end of the last motion
  };
  AxisState axis(Axis axis) const;
  bool emergency_stop() const;    // latched
  void release_emergency_stop();  // the operator releases the button; clear_faults() ends the latch
  bool clear_faults();            // false: the emergency stop button is not released
  bool link_lost() const;
  bool imu_unplugged() const;  // until plug_imu()
  void plug_imu();

  // --- Chamber around the unit (RigClimate in rig.cpp).
  void command_chamber(double set_point_c, double ramp_c_per_min, bool on);
  struct ChamberState {
    double actual_c = 0.0, set_point_c = 0.0;
    bool on = false, door_open = false, alarm = false, link_lost = false;
  };
  ChamberState chamber() const;

  // --- Time and unit.
  // Writes the next out.size() delivered samples. Time passes by one period for each, plus one for every sample that
  // a fault loses; duplicates take no time. An unplugged unit is plugged in again.
  // It does not return before all are delivered: not for a unit that a fault has silenced for good.
  void advance(std::span<ImuSample> out);
  // Lets `samples` periods pass, or fewer when `out` is full or the unit is unplugged. Returns the number of
  // delivered samples, which is smaller than the number of periods when faults lose some.
  std::size_t advance_time(std::int64_t samples, std::span<ImuSample> out);
  std::int64_t samples_passed() const;  // since start, delivered or not
  double time_s() const;                // samples_passed * period

  // --- True values.
  // The 24 parameters in the order of Table 1, in the units of the parameter file. Temperature effects refer to
  // config().temperature.reference_c (start_c if that is not set).
  const std::array<double, 24>& truth() const;
  // The same with temperature effects referred to another temperature: N0, A0 and the rows of n and a absorb the difference
  // exactly.
  std::array<double, 24> truth_at_reference(double reference_c) const;
  // The active effects of the catalogue: "accel_second_order.x" and its value, in the units of docs/diagnosis.md.
  std::vector<std::pair<std::string, double>> truth_effects() const;
  // The true attitude now, row-major: v_n = C_nb v_b.
  std::array<double, 9> attitude_nb() const;
  double temperature_c() const;
  // The table errors in force, drawn or set: "tilt_north_arcmin" and its value.
  std::vector<std::pair<std::string, double>> table_errors() const;

 private:
  std::unique_ptr<rig_model::RigState> state_;
};

}  // namespace turncal
