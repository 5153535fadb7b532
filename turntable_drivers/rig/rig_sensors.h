// From what the unit feels to what its sensors output: the effects of rig_effects.h in SI units, noise, and the pulse
// counter.
//
// SensorEffects has two parts: effects that depend only on motion and attitude (constant while the table
// stands), and running effects, which depend on time and temperature.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "turntable_drivers/rig/rig_config.h"
#include "turntable_drivers/rig/rig_geometry.h"

namespace turncal::rig_model {

inline constexpr double standard_gravity_mps2 = 9.80665;
inline constexpr double radps_per_degph = pi / 180.0 / 3600.0;
inline constexpr double mps2_per_ug = 1e-6 * standard_gravity_mps2;

struct Reading {          // rates read by the calibrated sensors
  Eigen::Vector3d gyro;   // rad/s
  Eigen::Vector3d accel;  // m/s^2
};

struct RigMoment {  // what the running effects depend on
  double time_s = 0.0;
  double temperature_c = 0.0, c_per_h = 0.0;
  double since_motion_s = -1.0;  // since the end of the last table motion; negative: none yet, or moving
};

class SensorEffects {
 public:
  explicit SensorEffects(const RigConfig& config);
  // Returns the true motion plus the effects that depend only on it. axes: true sine and cosine by Axis. hysteresis_state: s of
  // RigOutsideEffects::Hysteresis.
  Reading standing(const BodyMotion& motion, const std::array<TrueAxis, 3>& axes, double hysteresis_state) const;
  // Adds the running effects.
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

// Converts the increments of a triad to pulses: p = inverse(scale) * (increment + bias * period), counted.
class PulseCounter {
 public:
  // scale: SI units per pulse (rad or m/s); bias: a rate in SI units. REQUIRES: scale is invertible
  PulseCounter(const Eigen::Matrix3d& scale, const Eigen::Vector3d& bias, double period_s,
               RigQuantisation quantisation);
  // Returns the pulses of this sample. The running sum of quantised pulses always differs from that of the real-valued
  // ones by less than one pulse (floor) or by at most half a pulse (round).
  std::array<double, 3> count(const std::array<double, 3>& increment);

 private:
  Eigen::Matrix3d inverse_;
  Eigen::Vector3d offset_;
  std::array<double, 3> rest_{};  // fraction of a pulse not counted yet
  RigQuantisation quantisation_;
};

// The noise of one triad, added to the three true increments of a sample.
//
//   white       N sqrt(dt) * normal                                        random walk of angle or velocity
//   flicker     sum over j of Markov processes, tau_j = longest / 4^j down to about a quarter second, each with
//               variance B^2 ln 4 / pi: their spectra add up to B^2 / (2 pi f), whose Allan deviation is
//               B sqrt(2 ln 2 / pi) = 0.664 B (IEEE 952 annex C). Stationary from the first sample.
//   rate walk   K sqrt(t): random walk of the bias, from 0
//
// Flicker and rate walk are updated every tau/16 and 0.1 s: their steps are far below the white noise, and a
// sample costs only three normal numbers. SI units: N in rad/sqrt(s) or m/s/sqrt(s), B in rad/s or m/s^2, K in the unit of B
// per sqrt(s).
struct NoiseSize {
  double white = 0.0;
  double flicker = 0.0;
  double flicker_longest_s = 1000.0;
  double rate_walk = 0.0;
};

class TriadNoise {
 public:
  // Uses streams 3 * triad + 1 .. + 3 of the seed.
  TriadNoise(const NoiseSize& size, double period_s, std::uint64_t seed, std::uint64_t triad);
  // Adds the noise increments of the next sample to `increment`.
  void add(std::array<double, 3>& increment);
  // The current sum of flicker and rate walk, as a rate.
  const std::array<double, 3>& bias() const { return bias_; }

 private:
  struct Markov {
    double decay = 0.0;
    double kick = 0.0;
    std::int64_t every = 1;
    std::array<double, 3> value{};
  };
  void update_bias();

  double period_s_;
  double white_sigma_;
  double walk_kick_;
  std::int64_t walk_every_;
  std::int64_t grid_ = 1;  // samples between updates of the fastest process
  std::int64_t sample_ = 0;
  std::int64_t until_update_ = 0;
  bool drifts_;
  std::vector<Markov> processes_;
  std::array<double, 3> walk_{};
  std::array<double, 3> bias_{};
  RandomStream white_, flicker_, walk_stream_;
};

}  // namespace turncal::rig_model
