// One branch: aligned on the first minutes of a stretch of a recording, then free, at a point that does not move or beside a reference.
//
// Whatever the unit does about that point, position and velocity should not change: any change is error. The unit's
// distance from the centre of rotation is neglected. With a reference the unit may move after the alignment: the error
// is the distance from the reference, whose height is used.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "calib/navigation/alignment.h"
#include "calib/navigation/drift.h"
#include "calib/navigation/mechanisation.h"
#include "calib/types/status.h"

namespace turncal {

// The true path of a moving unit: rows of another instrument, joined by straight lines.
//
// Between rows of 1 s a turn with 1 g is off the straight line by 1.2 m (a T^2 / 8). Height is 0 if not given;
// velocity, if not given, is the slope between two rows. Not modelled: the arm between that instrument and the unit.
struct ReferencePoint {
  double time_s = 0.0;  // from the first sample of the recording
  double latitude_rad = 0.0, longitude_rad = 0.0, height_m = 0.0;
  Eigen::Vector2d velocity_mps = Eigen::Vector2d::Zero();  // north, east
};

class ReferenceTrack {
 public:
  // REQUIRES: two or more points, times that rise. `with_velocity`: they have one.
  ReferenceTrack(std::vector<ReferencePoint> points, bool with_velocity);
  ReferencePoint at(double time_s) const;  // outside: the nearest end
  double begins_s() const { return points_.front().time_s; }
  double ends_s() const { return points_.back().time_s; }
  // Is the speed below that which a satellite receiver at rest seems to have?
  bool stands_at(double time_s) const { return at(time_s).velocity_mps.norm() <= standing_mps; }
  static constexpr double standing_mps = 0.5;
  // Returns the longest time between two rows during which it moves; 0: it stands throughout.
  double longest_in_motion_s() const;

 private:
  std::vector<ReferencePoint> points_;  // longitudes unwrapped
  bool with_velocity_;
};

struct TrackPoint {
  double time_s = 0.0;  // since the navigation began
  NavigationState state;
  Eigen::Vector2d moved_m = Eigen::Vector2d::Zero();  // north, east: from the true position
  Eigen::Vector2d velocity_error_mps = Eigen::Vector2d::Zero();
};

struct FreeNavigation {
  double align_rest_s = 0.0;
  NavigationState aligned;
  Eigen::Vector3d align_sigma_rad = Eigen::Vector3d::Zero();  // north, up, east: noise and parameters
  double heading_sigma_rad = 0.0;                             // of where x points (angle_sigmas)
  double free_s = 0.0;
  std::vector<TrackPoint> track;  // at the start, then each second, and at the end
  double nm_per_h = 0.0;          // radial error rate, over the track
  double velocity_rms_mps = 0.0;  // of the horizontal velocity error's size, over the track
  // Expected at the end: covariance of north and east, m^2.
  Eigen::Matrix2d end_covariance_m2 = Eigen::Matrix2d::Zero();
};

struct FreeNavigationSetup {
  DriftCovariance::Site site;
  NoiseModel noise;
  std::optional<CountsModel> counts;  // with parameter_covariance: for the expected error
  ParameterCovariance parameter_covariance = ParameterCovariance::Zero();
  double align_s = 300.0;
  bool expected = true;                       // false: the expected error ends with the alignment
  const ReferenceTrack* reference = nullptr;  // `site` is its first point, not that of the branch
  double start_s = 0.0;                       // of the stretch, in the time of the reference
};

// Errors: those of align(), and a stretch that is not longer than the alignment.
Result<FreeNavigation> navigate_freely(std::span<const MotionInterval> stretch, const FreeNavigationSetup& setup);

// Returns the expected error of a unit at rest, level, at `heading_rad`, without any data.
struct ExpectedDrift {
  Eigen::Vector3d align_sigma_rad = Eigen::Vector3d::Zero();
  struct Point {
    double time_s = 0.0;
    Eigen::Matrix2d covariance_m2 = Eigen::Matrix2d::Zero();  // of north and east, together
    Eigen::Matrix2d noise_m2 = Eigen::Matrix2d::Zero();       // the part of the noise
  };
  std::vector<Point> points;  // each `every_s`, and the end
};
ExpectedDrift expected_drift(const FreeNavigationSetup& setup, double heading_rad, double free_s, double every_s);

// Returns the root mean square of the radial error over time, nautical miles per hour.
double expected_nm_per_h(const Eigen::Matrix2d& covariance_m2, double time_s);

// The error of a free navigation in the numbers that navigators use.
//
// Radial error rate of one run: the slope of the straight line through the origin that fits the radial position error d(t) best,
//   r = sum d t / sum t^2   (nautical miles per hour).
// Over runs (branches): the root mean square of the rates, and the values below which half and 95 % of them lie when north and east errors
// are normal with one variance: CEP = sqrt(ln 2) rms = 0.8326 rms, R95 = sqrt(ln 20) rms = 1.7308 rms (STANAG 4278). From a few runs these
// are better than counted quantiles; with one axis much worse than the other the true CEP is up to 19 % lower.
class RadialErrorRate {
 public:
  void add(double time_s, double radial_m) {
    dt_ += radial_m * time_s;
    tt_ += time_s * time_s;
  }
  double nm_per_h() const;  // 0 before anything was added

 private:
  double dt_ = 0.0, tt_ = 0.0;
};

struct DriftOverRuns {
  double rms_nm_per_h = 0.0;
  double cep_nm_per_h = 0.0;
  double r95_nm_per_h = 0.0;
};
DriftOverRuns drift_over_runs(std::span<const double> rates_nm_per_h);

}  // namespace turncal
