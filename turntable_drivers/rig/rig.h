// The rig: a table and the unit on it, as one physical model that owns its time. It shares no model code with calib/.
//
// Frames and signs are those of docs/rig.md: n = north, up, east; b = x front, y up, z right; C_nb: rig_geometry.h. The unit feels
// f_b = C_bn (0, g, 0) and w_ib_b = C_bn w_ie_n + (rate of the table), w_ie_n = W (cos L, sin L, 0).
// Increments are integrals over the sample: closed form while every axis stands, Gauss-Legendre in motion, split where
// an axis changes its acceleration. Time is counted in samples; nothing but advance() makes it pass.
//
// Not modelled: the arm from the table's centre to the unit (never visible), Schuler motion, deflection of the
// vertical, flexible structure, vibration, and the unit's bandwidth (but for accel_delay).
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

  // --- Table: raw axes without manners. Limits, enabling and homing are RigTable's.
  // Goes to `target_deg` (encoder angle, cumulative) on a trapezoid of rate, from whatever the axis is doing: an axis
  // in motion brakes first. Takes effect now, at a sample boundary. A stuck axis takes the command and does nothing.
  // REQUIRES: rate and acceleration > 0
  void command_move(Axis axis, double target_deg, double rate_degps, double acceleration_degps2);
  void stop();   // every axis brakes at its last commanded acceleration
  void abort();  // every axis stops within one sample

  struct AxisState {
    double position_deg = 0.0;  // encoder, not rounded
    double rate_degps = 0.0;
    double target_deg = 0.0;  // of the last command
    bool moving = false;      // by a command (or a table_moved fault that the encoder sees)
    bool fault = false;       // latched axis_fault
    bool stuck = false;
    bool never_in_position = false;
    double started_s = 0.0;  // rig time at which the last command was given
    double stopped_s = 0.0;  // rig time at which the last motion ended
  };
  AxisState axis(Axis axis) const;
  bool emergency_stop() const;    // latched
  void release_emergency_stop();  // the operator pulls the button out; the latch stays until clear_faults()
  bool clear_faults();            // false: the emergency stop has not been released
  bool link_lost() const;
  bool imu_unplugged() const;  // until plug_imu()
  void plug_imu();

  // --- Chamber about the unit (RigClimate in rig.cpp).
  void command_chamber(double set_point_c, double ramp_c_per_min, bool on);
  struct ChamberState {
    double actual_c = 0.0, set_point_c = 0.0;
    bool on = false, door_open = false, alarm = false, link_lost = false;
  };
  ChamberState chamber() const;

  // --- Time and unit.
  // The next out.size() samples the unit delivers. Time passes by one period for each, plus one for every sample that
  // is lost by a fault and none for a duplicate.
  // Does not return before that many were delivered: not for a unit that a fault has silenced for good.
  void advance(std::span<ImuSample> out);
  // Time passes by `samples` periods, or fewer: it stops when `out` is full or the unit has been unplugged. Returns how
  // many samples were delivered, fewer than time has passed when faults lose some.
  std::size_t advance_time(std::int64_t samples, std::span<ImuSample> out);
  std::int64_t samples_passed() const;  // since start, delivered or not
  double time_s() const;                // samples_passed * period

  // --- What is true.
  // The 24 parameters in Table 1 order, units of the parameter file; temperature effects are referred to
  // config().temperature.reference_c (start_c if that is not set).
  const std::array<double, 24>& truth() const;
  // The same for effects referred to another temperature: N0, A0 and the rows of n and a take up the difference
  // (exact).
  std::array<double, 24> truth_at_reference(double reference_c) const;
  // Catalogue effects that are switched on: "accel_second_order.x" and value, units of docs/diagnosis.md.
  std::vector<std::pair<std::string, double>> truth_effects() const;
  // True attitude now, row by row: v_n = C_nb v_b.
  std::array<double, 9> attitude_nb() const;
  double temperature_c() const;
  // Table errors in force, drawn or set, as "tilt_north_arcmin" and value.
  std::vector<std::pair<std::string, double>> table_errors() const;

 private:
  std::unique_ptr<rig_model::RigState> state_;
};

}  // namespace turncal
