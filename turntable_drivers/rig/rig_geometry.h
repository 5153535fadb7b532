// The geometry of the table: from the true axis angles and their derivatives to what the unit on the inner axis feels.
//
//   C_nb = R(base) Ry(-H) Rx(heading_pitch) Rz(P) Ry(pitch_roll) Rx(R) R(mounting),   v_n = C_nb v_b
//
// Rx, Ry, Rz: rotation by a positive (right-handed) angle about that axis, as matrices that transform coordinates of the
// rotated frame to the frame before. R(v): Rodrigues' rotation by the vector v. n = north, up, east; H is clockwise from
// above. Rates add up along the chain; the heading axis turns with -H' about y:
//   u1 = -H' y                                 u2 = P' z + Rz(P)' Rx(heading_pitch)' u1
//   u3 = R' x + Rx(R)' Ry(pitch_roll)' u2      w_nb_b = R(mounting)' u3
// (a prime on a matrix: transpose), and their time derivatives follow from d/dt (Rz(P)' v) = Rz' v' - P' z x (Rz' v).
// w_ib_b = w_nb_b + C_bn w_ie_n, and since w_ie_n is constant w_ib_b' = w_nb_b' - w_nb_b x C_bn w_ie_n.
#pragma once

#include <array>

#include <Eigen/Core>
#include <Eigen/Geometry>  // for cross(); rotations are our own

#include "turntable_drivers/rig/rig_math.h"

namespace turncal::rig_model {

using RowMajor3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;  // nine numbers, row-major

// The true angle of one axis and its derivatives, in rad.
struct TrueAxis {
  SinCos angle;
  double rate_radps = 0.0;
  double acceleration_radps2 = 0.0;
};

struct BodyMotion {
  Eigen::Vector3d rate_ib_b;       // rad/s
  Eigen::Vector3d acceleration_b;  // d/dt rate_ib_b, rad/s^2
  Eigen::Vector3d force_b;         // specific force, m/s^2
  Eigen::Vector3d field_b;         // magnetic field, gauss
  Eigen::Vector3d earth_error_b;   // SiteVectors::earth_error, in body axes
};

struct GeometryAngles {                            // rad
  Eigen::Vector3d base = Eigen::Vector3d::Zero();  // rotation vector: north, up, east
  double heading_pitch = 0.0;
  double pitch_roll = 0.0;
  Eigen::Vector3d mounting = Eigen::Vector3d::Zero();  // rotation vector: x, y, z
};

struct SiteVectors {               // in n
  Eigen::Vector3d earth_rate;      // rad/s
  Eigen::Vector3d specific_force;  // m/s^2, at rest
  Eigen::Vector3d field;           // gauss
  Eigen::Vector3d earth_error;     // rad/s
};

Eigen::Matrix3d rotation_by_vector(const Eigen::Vector3d& rotation_rad);

class TableGeometry {
 public:
  TableGeometry(const GeometryAngles& angles, const SiteVectors& site);
  // axes: heading, pitch, roll
  BodyMotion at(const std::array<TrueAxis, 3>& axes) const;
  Eigen::Matrix3d attitude_nb(const std::array<TrueAxis, 3>& axes) const;

 private:
  Eigen::Vector3d to_body(const Eigen::Vector3d& v_table, const std::array<TrueAxis, 3>& axes) const;

  Eigen::Matrix3d base_, heading_pitch_, pitch_roll_, mounting_;
  SiteVectors in_base_;  // the site's vectors in the axes of the table's base
  bool has_field_ = false;
  bool has_earth_error_ = false;
};

}  // namespace turncal::rig_model
