// Rotations: the few formulas the estimator needs, by the definitions below.
//
// Frames: n = north, up, east; b = x front, y up, z right. C_nb takes body components to navigation components.
// Heading H clockwise from north seen from above, pitch P about body z (nose up), roll R about body x:
//   C_nb = Ry(-H) Rz(P) Rx(R)
#pragma once

#include <vector>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "calib/model/parameters.h"
#include "calib/types/axis.h"

namespace turncal {

// skew(a) * b = a x b
inline Eigen::Matrix3d skew(const Eigen::Vector3d& a) {
  Eigen::Matrix3d m;
  m << 0.0, -a.z(), a.y(), a.z(), 0.0, -a.x(), -a.y(), a.x(), 0.0;
  return m;
}

// Returns v = sum over pairs of x_i x y_i from m = sum of x_i y_i'.
inline Eigen::Vector3d cross_of_outer(const Eigen::Matrix3d& m) {
  return {m(1, 2) - m(2, 1), m(2, 0) - m(0, 2), m(0, 1) - m(1, 0)};
}

// Rotation matrix of the rotation vector s (rad). Below 0.1 rad by series, exact to rounding (next term 1e-18).
Eigen::Matrix3d rotation_exp(const Eigen::Vector3d& s);

// Left Jacobian: Exp(s + ds) = Exp(Jl(s) ds) Exp(s) to first order in ds. Series to fourth order in s (s below 0.2 rad:
// error below 2e-6 of ds).
Eigen::Matrix3d left_jacobian(const Eigen::Vector3d& s);

Eigen::Matrix3d attitude_from_angles(double heading_rad, double pitch_rad, double roll_rad);
Eigen::Matrix3d attitude_at(const AxisTriple& deg);
// Returns the axis of a turn in the body, in the sense of growing angle. It is fixed there while the table turns about it alone.
Eigen::Vector3d axis_b(Axis axis, const AxisTriple& at_deg);
inline AxisTriple angles_of(const Segment& s) { return {{s.heading_deg, s.pitch_deg, s.roll_deg}}; }

// Returns the 48 ways in which three axes stand for three others, forwards or reversed: row i has one entry, 1 or -1.
std::vector<Eigen::Matrix3d> signed_axes();

// Levelled attitude: the specific force f_b points up (U), and the heading is taken from `reference`, the nearest attitude
// whose up axis is f_b: the smallest rotation about a horizontal axis brings C f_b to U.
Eigen::Matrix3d level(const Eigen::Matrix3d& reference_C_nb, const Eigen::Vector3d& f_b);

// Earth rate in n (north, up, east).
Eigen::Vector3d earth_rate_n(double latitude_deg);

}  // namespace turncal
