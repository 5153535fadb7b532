// Motion of one axis: a trapezoid of rate from any state to a target, and what follows it.
//
// Positions are encoder degrees; time is local, in seconds from the profile's start. Up to four phases of constant
// acceleration: (brake), speed up, cruise, slow down. Outside the phases the axis stands.
#pragma once

#include <array>
#include <span>

namespace turncal::rig_model {

struct AxisPoint {
  double position_deg = 0.0;
  double rate_degps = 0.0;
  double acceleration_degps2 = 0.0;
};

class AxisProfile {
 public:
  AxisProfile() = default;
  // Stands at `position_deg` for ever.
  static AxisProfile stand(double position_deg);
  // From position and rate to the target at rest; an axis in motion brakes first, then turns to the target.
  // REQUIRES: rate > 0, acceleration > 0
  static AxisProfile move(double position_deg, double rate_degps, double target_deg, double max_rate_degps,
                          double acceleration_degps2);
  // Brakes to rest.
  static AxisProfile brake(double position_deg, double rate_degps, double acceleration_degps2);

  AxisPoint at(double time_s) const;
  double duration_s() const { return duration_s_; }
  // +1 or -1: the way it turned last; 0 if it never moves.
  double last_direction() const;
  // Times at which the acceleration changes, 0 and the end included.
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

}  // namespace turncal::rig_model
