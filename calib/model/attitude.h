// Rotations: the few formulas the estimator needs, by the definitions below.
//
// Frames: n = north, up, east; b = x front, y up, z right. C_nb takes body components to navigation components.
// Heading H clockwise from north seen from above, pitch P about body z (nose up), roll R about body x:
//   C_nb = Ry(-H) Rz(P) Rx(R)
#pragma once

#include <cmath>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "calib/model/parameters.h"

namespace turncal {

// skew(a) * b = a x b
inline Eigen::Matrix3d skew(const Eigen::Vector3d& a) {
  Eigen::Matrix3d m;
  m << 0.0, -a.z(), a.y(), a.z(), 0.0, -a.x(), -a.y(), a.x(), 0.0;
  return m;
}

// The vector v with v = sum over pairs of x_i x y_i when m = sum of x_i y_i'.
inline Eigen::Vector3d cross_of_outer(const Eigen::Matrix3d& m) {
  return {m(1, 2) - m(2, 1), m(2, 0) - m(0, 2), m(0, 1) - m(1, 0)};
}

// Rotation matrix of the rotation vector s (rad). Below 0.1 rad by series, exact to rounding (next term 1e-18).
inline Eigen::Matrix3d rotation_exp(const Eigen::Vector3d& s) {
  const double x = s.squaredNorm();
  double a, b;  // sin(angle) / angle, (1 - cos(angle)) / angle^2
  if (x < 0.01) {
    a = 1.0 - x / 6.0 * (1.0 - x / 20.0 * (1.0 - x / 42.0 * (1.0 - x / 72.0)));
    b = 0.5 - x / 24.0 * (1.0 - x / 30.0 * (1.0 - x / 56.0 * (1.0 - x / 90.0)));
  } else {
    const double angle = std::sqrt(x);
    a = std::sin(angle) / angle;
    b = (1.0 - std::cos(angle)) / x;
  }
  const Eigen::Matrix3d k = skew(s);
  return Eigen::Matrix3d::Identity() + a * k + b * (k * k);
}

// Left Jacobian: Exp(s + ds) = Exp(Jl(s) ds) Exp(s) to first order in ds. Series to fourth order in s (s below 0.2 rad:
// error below 2e-6 of ds).
inline Eigen::Matrix3d left_jacobian(const Eigen::Vector3d& s) {
  const double angle2 = s.squaredNorm();
  const Eigen::Matrix3d k = skew(s);
  return Eigen::Matrix3d::Identity() + (0.5 - angle2 / 24.0) * k + (1.0 / 6.0 - angle2 / 120.0) * (k * k);
}

inline Eigen::Matrix3d attitude_from_angles(double heading_rad, double pitch_rad, double roll_rad) {
  const Eigen::Matrix3d heading = Eigen::AngleAxisd(-heading_rad, Eigen::Vector3d::UnitY()).toRotationMatrix();
  const Eigen::Matrix3d pitch = Eigen::AngleAxisd(pitch_rad, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  const Eigen::Matrix3d roll = Eigen::AngleAxisd(roll_rad, Eigen::Vector3d::UnitX()).toRotationMatrix();
  return heading * pitch * roll;
}

// Levelled attitude: the specific force f_b points up (U), and the heading is taken from `reference`, the nearest attitude
// whose up axis is f_b: the smallest rotation about a horizontal axis brings C f_b to U.
inline Eigen::Matrix3d level(const Eigen::Matrix3d& reference_C_nb, const Eigen::Vector3d& f_b) {
  const Eigen::Vector3d f_n = (reference_C_nb * f_b).normalized();
  return Eigen::Quaterniond::FromTwoVectors(f_n, Eigen::Vector3d::UnitY()).toRotationMatrix() * reference_C_nb;
}

// Earth rate in n (north, up, east).
inline Eigen::Vector3d earth_rate_n(double latitude_deg) {
  const double latitude = latitude_deg * rad_per_deg;
  return {earth_rate_radps * std::cos(latitude), earth_rate_radps * std::sin(latitude), 0.0};
}

}  // namespace turncal
