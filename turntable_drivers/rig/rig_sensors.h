// From what the unit feels to what its calibrated sensors read: the effects of rig_effects.h in SI units, and the pulse
// counter after them.
//
// SensorEffects splits the effects in two: those that depend on motion and attitude alone (constant while the table
// stands) and those that run with time and temperature.
#pragma once

#include <array>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "turntable_drivers/rig/rig_config.h"
#include "turntable_drivers/rig/rig_geometry.h"

namespace turncal::rig_model {

inline constexpr double standard_gravity_mps2 = 9.80665;
inline constexpr double radps_per_degph = pi / 180.0 / 3600.0;
inline constexpr double mps2_per_ug = 1e-6 * standard_gravity_mps2;

struct Reading {          // rates that the calibrated sensors read
  Eigen::Vector3d gyro;   // rad/s
  Eigen::Vector3d accel;  // m/s^2
};

struct RigMoment {  // what the running effects depend on
  double time_s = 0.0;
  double temperature_c = 0.0;
  double since_motion_s = -1.0;  // since the end of the last table motion; negative: none yet, or moving
};

class SensorEffects {
 public:
  explicit SensorEffects(const RigConfig& config);
  // True motion plus the effects that depend on it alone. axes: true sine and cosine by Axis; hysteresis_state:
  // of RigOutsideEffects::Hysteresis.
  Reading standing(const BodyMotion& motion, const std::array<TrueAxis, 3>& axes, double hysteresis_state) const;
  // Adds the effects that run with time.
  void add_running(const BodyMotion& motion, const RigMoment& moment, Reading& reading) const;
  bool has_running() const { return has_running_; }
  bool has_hysteresis() const { return outside_.accel_hysteresis.size_ug != 0.0; }
  double next_hysteresis_state(const BodyMotion& motion, double state) const;

 private:
  RigEffects effects_;
  RigOutsideEffects outside_;
  double reference_c_;
  bool has_standing_accel_ = false, has_motion_accel_ = false, has_standing_gyro_ = false, has_matrix_gyro_ = false;
  bool has_running_ = false;
  Eigen::Matrix3d cross_, arms_m_, g_sensitivity_, magnetic_, flexure_;
  double delay_s_ = 0.0;
};

// Increments of one triad -> pulses: p = inverse(scale) * (increment + bias * period), counted.
class PulseCounter {
 public:
  PulseCounter() = default;
  // scale: SI per pulse (rad or m/s), bias: SI rate. REQUIRES: scale invertible
  PulseCounter(const Eigen::Matrix3d& scale, const Eigen::Vector3d& bias, double period_s,
               RigQuantisation quantisation);
  // The pulses of this sample. With quantisation the running sum of pulses never differs from that of the real-valued
  // ones by one pulse or more (floor) or more than half a pulse (round).
  std::array<double, 3> count(const std::array<double, 3>& increment);

 private:
  std::array<std::array<double, 3>, 3> inverse_{};
  std::array<double, 3> offset_{};
  std::array<double, 3> rest_{};  // part of a pulse not yet counted
  RigQuantisation quantisation_ = RigQuantisation::off;
};

}  // namespace turncal::rig_model
