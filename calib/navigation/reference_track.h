// Where a moving unit truly was: rows of another instrument, between which it goes straight on.
//
// Between rows of 1 s a turn with 1 g is off the straight line by 1.2 m (a T^2 / 8). Height 0 where there is none; velocity, where
// there is none, is the slope between two rows. Not modelled: the arm between that instrument and the unit.
#pragma once

#include <vector>

#include <Eigen/Core>

namespace turncal {

struct ReferencePoint {
  double time_s = 0.0;  // from the first sample of the recording
  double latitude_rad = 0.0, longitude_rad = 0.0, height_m = 0.0;
  Eigen::Vector2d velocity_mps = Eigen::Vector2d::Zero();  // north, east
};

class ReferenceTrack {
 public:
  // REQUIRES: two points and more, times that rise. `with_velocity`: they have one.
  ReferenceTrack(std::vector<ReferencePoint> points, bool with_velocity);
  ReferencePoint at(double time_s) const;  // outside: as the nearest end
  double begins_s() const { return points_.front().time_s; }
  double ends_s() const { return points_.back().time_s; }
  // Slower than what the positions of a satellite receiver at rest seem to move.
  bool stands_at(double time_s) const { return at(time_s).velocity_mps.norm() <= standing_mps; }
  static constexpr double standing_mps = 0.5;
  // The longest time between two rows over which it moves; 0: it stands throughout.
  double longest_in_motion_s() const;

 private:
  std::vector<ReferencePoint> points_;  // longitudes without a step of 360 deg
  bool with_velocity_;
};

}  // namespace turncal
