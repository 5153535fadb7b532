// The motion of the rig's three axes: commanded motion, motion by faults, creep, and the encoder between angle and reading.
//
//   reading e   = command + slip seen by the encoder
//   true angle  = e (1 + scale) + offset + harmonic sin(order e + phase) + slip not seen by the encoder + creep
//   creep       = sum over past motions of +-c (1 - exp(-t/tau)), t from the end of a motion, in its direction
//
// Time is counted in samples of one period; every command takes effect at a sample boundary.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <span>

#include "turntable_drivers/rig/rig_geometry.h"
#include "turntable_drivers/rig/rig_truth.h"

namespace turncal::rig_model {

// The motion of one axis: a trapezoidal rate profile from any state to a target, and the rest after it.
//
// Positions are encoder degrees; time is local, in seconds from the start of the profile. There are up to four phases of constant
// acceleration: (brake), speed up, cruise, slow down. Outside the phases the axis stands.
struct AxisPoint {
  double position_deg = 0.0;
  double rate_degps = 0.0;
  double acceleration_degps2 = 0.0;
};

class AxisProfile {
 public:
  AxisProfile() = default;
  // Returns the profile of an axis that stands at `position_deg`.
  static AxisProfile stand(double position_deg);
  // Returns the profile from a position and rate to rest at the target. An axis in motion brakes first, then turns to the target.
  // REQUIRES: rate > 0, acceleration > 0
  static AxisProfile move(double position_deg, double rate_degps, double target_deg, double max_rate_degps,
                          double acceleration_degps2);
  // Returns the profile of braking to rest.
  static AxisProfile brake(double position_deg, double rate_degps, double acceleration_degps2);

  AxisPoint at(double time_s) const;
  double duration_s() const { return duration_s_; }
  // +1 or -1: the direction of the last motion; 0 if it never moves.
  double last_direction() const;
  // The times at which the acceleration changes, including 0 and the end.
  std::span<const double> corners_s() const { return {corners_.data(), corner_count_}; }

 private:
  struct Phase {
    double start_s = 0.0, position_deg = 0.0, rate_degps = 0.0, acceleration_degps2 = 0.0;
  };
  void append(double length_s, double acceleration_degps2);

  std::array<Phase, 4> phases_{};
  std::array<double, 5> corners_{};
  std::size_t phase_count_ = 0;
  std::size_t corner_count_ = 0;
  double duration_s_ = 0.0;
  double end_deg_ = 0.0;
  double end_rate_degps_ = 0.0;
};

class RigAxis {
 public:
  RigAxis() = default;
  RigAxis(double position_deg, const TableErrorsInForce::Encoder& encoder, double creep_deg, double creep_tau_s,
          double period_s);

  // All commands take effect at sample boundary k.
  void move(std::int64_t k, double target_deg, double rate_degps, double acceleration_degps2);
  void brake(std::int64_t k, double acceleration_degps2);
  void halt(std::int64_t k);  // within one sample
  void slip(std::int64_t k, double angle_deg, double rate_degps, bool hidden);

  AxisPoint reading(std::int64_t k, double offset_s) const;
  // The true angle and its derivatives at offset_s into sample k.
  TrueAxis truth(std::int64_t k, double offset_s) const;
  bool turning(std::int64_t k) const;   // in a motion that the encoder sees
  bool standing(std::int64_t k) const;  // no more motion or creep until the next command
  // Rig time at which the last motion (slip included, creep excluded) ends or ended; -infinity if there was none.
  double motion_end_s() const { return motion_end_s_; }
  double command_end_s() const { return command_end_s_; }
  // Writes the times within sample k at which the acceleration changes (offsets in (0, period)) to `out`; returns their number.
  std::size_t corners(std::int64_t k, std::span<double> out) const;
  static constexpr std::size_t max_corners = 15;

 private:
  struct Leg {
    AxisProfile profile;
    std::int64_t start = 0;
  };
  double elapsed_s(const Leg& leg, std::int64_t k) const { return double(k - leg.start) * period_s_; }
  bool running(const Leg& leg, std::int64_t k) const { return elapsed_s(leg, k) < leg.profile.duration_s(); }
  void replace_command(std::int64_t k, const AxisProfile& profile);
  void note_end(const Leg& leg);
  double creep_at(double since_s) const;

  TableErrorsInForce::Encoder encoder_;
  double creep_deg_ = 0.0, creep_tau_s_ = 1.0, period_s_ = 0.005;
  Leg command_, seen_slip_, hidden_slip_;
  double motion_end_s_ = -std::numeric_limits<double>::infinity();
  double command_end_s_ = 0.0;
  double creep_base_deg_ = 0.0;   // left by earlier motions
  double creep_direction_ = 0.0;  // direction of the creep after the current command; 0: none
};

}  // namespace turncal::rig_model
