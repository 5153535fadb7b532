#include "calib/model/attitude.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace turncal {

Eigen::Matrix3d rotation_exp(const Eigen::Vector3d& s) {
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

Eigen::Matrix3d left_jacobian(const Eigen::Vector3d& s) {
  const double angle2 = s.squaredNorm();
  const Eigen::Matrix3d k = skew(s);
  return Eigen::Matrix3d::Identity() + (0.5 - angle2 / 24.0) * k + (1.0 / 6.0 - angle2 / 120.0) * (k * k);
}

Eigen::Matrix3d attitude_from_angles(double heading_rad, double pitch_rad, double roll_rad) {
  const Eigen::Matrix3d heading = Eigen::AngleAxisd(-heading_rad, Eigen::Vector3d::UnitY()).toRotationMatrix();
  const Eigen::Matrix3d pitch = Eigen::AngleAxisd(pitch_rad, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  const Eigen::Matrix3d roll = Eigen::AngleAxisd(roll_rad, Eigen::Vector3d::UnitX()).toRotationMatrix();
  return heading * pitch * roll;
}

Eigen::Matrix3d attitude_at(const AxisTriple& deg) {
  return attitude_from_angles(deg[Axis::heading] * rad_per_deg, deg[Axis::pitch] * rad_per_deg,
                              deg[Axis::roll] * rad_per_deg);
}

Eigen::Vector3d axis_b(Axis axis, const AxisTriple& at_deg) {
  if (axis == Axis::heading) return -attitude_at(at_deg).transpose() * Eigen::Vector3d::UnitY();
  if (axis == Axis::roll) return Eigen::Vector3d::UnitX();
  return Eigen::AngleAxisd(-at_deg[Axis::roll] * rad_per_deg, Eigen::Vector3d::UnitX()) * Eigen::Vector3d::UnitZ();
}

std::vector<Eigen::Matrix3d> signed_axes() {
  std::vector<Eigen::Matrix3d> all;
  std::array<int, 3> axis = {0, 1, 2};
  do {
    for (int signs = 0; signs < 8; ++signs) {
      Eigen::Matrix3d& m = all.emplace_back(Eigen::Matrix3d::Zero());
      for (int i = 0; i < 3; ++i) m(i, axis[i]) = (signs >> i & 1) != 0 ? -1.0 : 1.0;
    }
  } while (std::next_permutation(axis.begin(), axis.end()));
  return all;
}

// Not Quaterniond::FromTwoVectors: for two opposite vectors it has a singular value decomposition, 15 s of compile time.
Eigen::Matrix3d level(const Eigen::Matrix3d& reference_C_nb, const Eigen::Vector3d& f_b) {
  const Eigen::Vector3d f_n = (reference_C_nb * f_b).normalized().normalized();  // the second time removes rounding
  const Eigen::Vector3d up = Eigen::Vector3d::UnitY();
  const double c = up.dot(f_n);
  Eigen::Quaterniond turn(0.0, 1.0, 0.0, 0.0);  // upside down: half a turn about any horizontal axis
  if (c >= -1.0 + 1e-12) {
    const double s = std::sqrt((1.0 + c) * 2.0);
    turn.vec() = f_n.cross(up) * (1.0 / s);
    turn.w() = s * 0.5;
  }
  return turn.toRotationMatrix() * reference_C_nb;
}

Eigen::Vector3d earth_rate_n(double latitude_deg) {
  const double latitude = latitude_deg * rad_per_deg;
  return {earth_rate_radps * std::cos(latitude), earth_rate_radps * std::sin(latitude), 0.0};
}

}  // namespace turncal
