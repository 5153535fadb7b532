// One branch: aligned on the first minutes of a stretch of a recording, then free, at a point that does not move or beside a reference.
//
// Whatever the unit does about that point, position and velocity should not change: what they become is error. The distance of
// the unit from the centre of rotation is neglected. With a reference the unit may go where it likes after the alignment: error
// is what is off from there, and the height is the reference's.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "calib/navigation/alignment.h"
#include "calib/navigation/drift.h"
#include "calib/navigation/mechanisation.h"
#include "calib/navigation/reference_track.h"
#include "calib/types/status.h"

namespace turncal {

struct TrackPoint {
  double time_s = 0.0;  // since the navigation began
  NavigationState state;
  Eigen::Vector2d moved_m = Eigen::Vector2d::Zero();  // north, east: off from where it should be
  Eigen::Vector2d velocity_error_mps = Eigen::Vector2d::Zero();
};

struct FreeNavigation {
  double align_rest_s = 0.0;
  NavigationState aligned;
  Eigen::Vector3d align_sigma_rad = Eigen::Vector3d::Zero();  // north, up, east: noise and parameters
  double heading_sigma_rad = 0.0;                             // of where x points (angle_sigmas)
  double free_s = 0.0;
  std::vector<TrackPoint> track;  // at the start, then each second, and at the end
  double nm_per_h = 0.0;          // radial error rate (navigation_error.h), over the track
  double velocity_rms_mps = 0.0;  // of the horizontal velocity error's size, over the track
  // Expected at the end: covariance of north and east, m^2.
  Eigen::Matrix2d end_covariance_m2 = Eigen::Matrix2d::Zero();
};

struct FreeNavigationSetup {
  DriftCovariance::Site site;
  NoiseModel noise;
  std::optional<CountsModel> counts;  // with parameter_covariance: how the expected error is found
  ParameterCovariance parameter_covariance = ParameterCovariance::Zero();
  double align_s = 300.0;
  bool expected = true;                       // false: the expected error is not followed after the alignment
  const ReferenceTrack* reference = nullptr;  // the site is where it begins, and not where the branch does
  double start_s = 0.0;                       // of the stretch, in the time of the reference
};

// Errors: those of align(), and a stretch that is not longer than the alignment.
Result<FreeNavigation> navigate_freely(std::span<const MotionInterval> stretch, const FreeNavigationSetup& setup);

// The expected error of a unit at rest, level, at `heading_rad`, without any data: what `parameters` read there.
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

// Root mean square of the radial error over time, nautical miles per hour.
double expected_nm_per_h(const Eigen::Matrix2d& covariance_m2, double time_s);

}  // namespace turncal
