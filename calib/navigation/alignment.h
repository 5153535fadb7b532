// Initial attitude from the first minutes: coarse in the inertial frame, fine by a filter that observes a velocity of zero.
//
// Coarse: in axes that do not turn (the body's at the start, carried by the gyros) the specific force of a fixed point goes around the Earth's
// axis. Its integrals over the first and second half of the window, known in both frames, give the attitude (Titterton and Weston (2004),
// 10.4; Black's TRIAD, AIAA J. 2 (1964)). The unit may turn meanwhile.
// Fine: the mechanisation runs on from there, and every second at rest its horizontal velocity is the observation of the filter of drift.h.
// At rest during T the heading's sigma from angle random walk N alone is N / (W cos L sqrt(T)): 0.030 deg at 30 deg of latitude, 300 s and
// 0.002 deg/sqrt(h). Velocity noise and what the calibration left add to it.
//
// The unit's distance from the centre of rotation is neglected (10 deg/s at an arm of 10 cm are 17 mm/s): velocity is observed at rest only.
// Errors: fewer than align_min_rest_s seconds at rest in the window; above max_navigation_latitude_deg, where no gyro tells north.
#pragma once

#include <array>
#include <span>

#include "calib/model/limits.h"
#include "calib/navigation/drift.h"
#include "calib/navigation/mechanisation.h"
#include "calib/types/status.h"

namespace turncal {

inline constexpr double align_min_rest_s = 20.0;
inline constexpr double max_navigation_latitude_deg = 85.0;
Status check_navigation_latitude(double latitude_deg);

// C_nb at the start of `window`. REQUIRES: intervals that last at least a second together.
Eigen::Quaterniond coarse_alignment(std::span<const MotionInterval> window, const DriftCovariance::Site& site);

// The prior of a fine alignment, before its first observation.
inline constexpr double coarse_heading_rad = 0.2;
void begin_alignment(DriftCovariance& drift);
// Returns the heading's sigma from the observations alone. Where the gyros hardly observe north, `sigma_rad` is mostly the prior.
double heading_sigma_of_data(double sigma_rad);

struct Alignment {
  NavigationState state;  // at the end of the window; position: the site, longitude 0
  DriftCovariance drift;  // begun, with what alignment left
  double rest_s = 0.0;    // of the window
};
// `drift`: as constructed; the alignment begins it.
Result<Alignment> align(std::span<const MotionInterval> window, const DriftCovariance::Site& site,
                        DriftCovariance drift);

// Returns the standard deviations of heading, roll and pitch, rad, for the covariance of an attitude error phi in n. Heading is where x points: near
// the vertical phi's level parts enter it with tan(pitch), up to the sigma of any heading, 2 pi / sqrt(12), reached at the vertical.
std::array<double, 3> angle_sigmas(const Eigen::Matrix3d& of_phi, const Eigen::Quaterniond& q_nb);

// The latitude and the gravity that the unit's rests imply. Its rate about the vertical is W sin L, which tells nothing of east or west; a
// wrong latitude of the recording shows in it, or a wrong vertical gyro bias. Gravity is the mean size of the specific force.
//   sigma: angle random walk over the seconds at rest, and the gyro biases' covariance.
struct FeltSite : FeltLatitude {  // sigma is infinite without a rest
  double gravity_mps2 = 0.0;      // 0 without a rest
  // The wider limit: the calibration may be of another day.
  bool speaks_against(double of_record_rad) const {
    return FeltLatitude::speaks_against(of_record_rad, latitude_limits.least_of_another_day_deg);
  }
  // Is it further from `gravity_mps2` than 0.01 m/s^2, a milligee? A calibration takes its scale from the site's gravity.
  bool weighs_against(double gravity_mps2) const;
};
FeltSite felt_site(std::span<const MotionInterval> intervals, const NoiseModel& noise,
                   const ParameterCovariance& parameters);

}  // namespace turncal
