#include "turntable_drivers/rig/rig_geometry.h"

#include <cmath>

namespace turncal::rig_model {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// Returns the coordinates of v after a rotation of the frame about one axis: the transposed rotation matrix times v.
Vector3d into_x(const SinCos& a, const Vector3d& v) {
  return {v[0], a.cos * v[1] + a.sin * v[2], -a.sin * v[1] + a.cos * v[2]};
}
Vector3d into_y(const SinCos& a, const Vector3d& v) {
  return {a.cos * v[0] - a.sin * v[2], v[1], a.sin * v[0] + a.cos * v[2]};
}
Vector3d into_z(const SinCos& a, const Vector3d& v) {
  return {a.cos * v[0] + a.sin * v[1], -a.sin * v[0] + a.cos * v[1], v[2]};
}

}  // namespace

Matrix3d rotation_by_vector(const Vector3d& rotation_rad) {
  const double angle = std::sqrt(rotation_rad.dot(rotation_rad));
  if (angle == 0.0) return Matrix3d::Identity();
  const Vector3d u = rotation_rad / angle;
  const SinCos a = sin_cos(angle);
  const SinCos half = sin_cos(0.5 * angle);
  const double versine = 2.0 * half.sin * half.sin;
  Matrix3d cross;
  cross << 0.0, -u[2], u[1], u[2], 0.0, -u[0], -u[1], u[0], 0.0;
  return Matrix3d::Identity() + a.sin * cross + versine * (cross * cross);
}

TableGeometry::TableGeometry(const GeometryAngles& angles, const SiteVectors& site)
    : base_(rotation_by_vector(angles.base)),
      heading_pitch_(rotation_by_vector({angles.heading_pitch, 0.0, 0.0})),
      pitch_roll_(rotation_by_vector({0.0, angles.pitch_roll, 0.0})),
      mounting_(rotation_by_vector(angles.mounting)) {
  const Matrix3d to_base = base_.transpose();
  in_base_ = {to_base * site.earth_rate, to_base * site.specific_force, to_base * site.field,
              to_base * site.earth_error};
  has_field_ = !site.field.isZero(0.0);
  has_earth_error_ = !site.earth_error.isZero(0.0);
}

Vector3d TableGeometry::to_body(const Vector3d& v_table, const std::array<TrueAxis, 3>& axes) const {
  const Vector3d v_heading = into_y({-axes[0].angle.sin, axes[0].angle.cos}, v_table);
  const Vector3d v_pitch = into_z(axes[1].angle, heading_pitch_.transpose() * v_heading);
  const Vector3d v_roll = into_x(axes[2].angle, pitch_roll_.transpose() * v_pitch);
  return mounting_.transpose() * v_roll;
}

BodyMotion TableGeometry::at(const std::array<TrueAxis, 3>& axes) const {
  const Vector3d x = Vector3d::UnitX(), z = Vector3d::UnitZ();
  const double heading_rate = axes[0].rate_radps, pitch_rate = axes[1].rate_radps, roll_rate = axes[2].rate_radps;

  const Vector3d u1(0.0, -heading_rate, 0.0);
  const Vector3d du1(0.0, -axes[0].acceleration_radps2, 0.0);
  const Vector3d u1_in_pitch = into_z(axes[1].angle, heading_pitch_.transpose() * u1);
  const Vector3d u2 = pitch_rate * z + u1_in_pitch;
  const Vector3d du2 = axes[1].acceleration_radps2 * z + into_z(axes[1].angle, heading_pitch_.transpose() * du1) -
                       pitch_rate * z.cross(u1_in_pitch);
  const Vector3d u2_in_roll = into_x(axes[2].angle, pitch_roll_.transpose() * u2);
  const Vector3d u3 = roll_rate * x + u2_in_roll;
  const Vector3d du3 = axes[2].acceleration_radps2 * x + into_x(axes[2].angle, pitch_roll_.transpose() * du2) -
                       roll_rate * x.cross(u2_in_roll);

  const Vector3d rate_nb_b = mounting_.transpose() * u3;
  const Vector3d earth_b = to_body(in_base_.earth_rate, axes);
  BodyMotion motion;
  motion.rate_ib_b = rate_nb_b + earth_b;
  motion.acceleration_b = mounting_.transpose() * du3 - rate_nb_b.cross(earth_b);
  motion.force_b = to_body(in_base_.specific_force, axes);
  motion.field_b = has_field_ ? to_body(in_base_.field, axes) : Vector3d::Zero();
  motion.earth_error_b = has_earth_error_ ? to_body(in_base_.earth_error, axes) : Vector3d::Zero();
  return motion;
}

Matrix3d TableGeometry::attitude_nb(const std::array<TrueAxis, 3>& axes) const {
  Matrix3d c_tb;
  for (int i = 0; i < 3; ++i) c_tb.row(i) = to_body(Vector3d::Unit(i), axes).transpose();
  return base_ * c_tb;
}

}  // namespace turncal::rig_model
