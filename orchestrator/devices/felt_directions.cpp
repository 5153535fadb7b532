#include "orchestrator/devices/felt_directions.h"

#include <fmt/format.h>
#include <Eigen/Geometry>
#include <Eigen/LU>

#include <algorithm>
#include <cmath>

#include "calib/model/attitude.h"
#include "calib/model/parameters.h"
#include "calib/statistics/unit_slip.h"
#include "imu_io/base/format_number.h"

namespace turncal {

namespace {

bool points_along(const Eigen::Vector3d& v, const Eigen::Vector3d& direction, double within_deg) {
  return v.norm() > 0.0 && v.dot(direction) >= v.norm() * direction.norm() * std::cos(within_deg * rad_per_deg);
}

double angle_between_deg(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b)) / rad_per_deg;
}

// "-z": the axis that a direction is nearest to.
std::string nearest_axis(const Eigen::Vector3d& v) {
  Eigen::Index axis = 0;
  v.cwiseAbs().maxCoeff(&axis);
  return std::string(v[axis] < 0.0 ? "-" : "+") + "xyz"[axis];
}

std::string angles_text(const AxisTriple& deg) {
  return "heading " + format_number(deg[Axis::heading]) + ", pitch " + format_number(deg[Axis::pitch]) + ", roll " +
         format_number(deg[Axis::roll]) + " deg";
}

std::string triple_text(const Eigen::Vector3d& v) {
  // What is nothing beside the largest is shown as 0, not as what rounding left of it.
  const double least = 1e-5 * v.cwiseAbs().maxCoeff();
  const auto shown = [least](double x) { return std::abs(x) < least ? 0.0 : x; };
  return fmt::format("{:+.4g}, {:+.4g}, {:+.4g}", shown(v.x()), shown(v.y()), shown(v.z()));
}

// Of the body, for a turn by + about an axis of the table (planned_motion.h).
Eigen::Vector3d body_axis_of(Axis axis, const AxisTriple& at_deg) {
  switch (axis) {
    case Axis::heading: return -attitude_of(at_deg).transpose() * Eigen::Vector3d::UnitY();
    case Axis::pitch:
      return Eigen::AngleAxisd(-at_deg[Axis::roll] * rad_per_deg, Eigen::Vector3d::UnitX()) * Eigen::Vector3d::UnitZ();
    case Axis::roll: break;
  }
  return Eigen::Vector3d::UnitX();
}

}  // namespace

Eigen::Matrix3d attitude_of(const AxisTriple& angles_deg) {
  return attitude_from_angles(angles_deg[Axis::heading] * rad_per_deg, angles_deg[Axis::pitch] * rad_per_deg,
                              angles_deg[Axis::roll] * rad_per_deg);
}

std::optional<std::pair<Axis, double>> turn_between(const AxisTriple& from_deg, const AxisTriple& to_deg) {
  std::optional<std::pair<Axis, double>> turn;
  for (const Axis axis : all_axes) {
    if (to_deg[axis] == from_deg[axis]) continue;
    if (turn) return {};
    turn = {axis, to_deg[axis] - from_deg[axis]};
  }
  return turn;
}

Status judge_force(const Eigen::Vector3d& force_mps2, const AxisTriple& angles_deg, double gravity_mps2,
                   const DirectionLimits& limits) {
  const Eigen::Vector3d up = attitude_of(angles_deg).transpose() * Eigen::Vector3d::UnitY();
  const bool size_fits = std::abs(force_mps2.norm() - gravity_mps2) <= limits.force_tolerance * gravity_mps2;
  const bool points_up = points_along(force_mps2, up, limits.direction_deg);
  if (size_fits && points_up) return {};
  const std::string sensed = "at " + angles_text(angles_deg) + " the accelerometers sense " + triple_text(force_mps2) +
                             " m/s^2 along x, y, z: expected " + triple_text(gravity_mps2 * up);
  const UnitSlip* const slip = slip_near(accel_slips(), force_mps2.norm() / gravity_mps2);
  if (points_up && slip != nullptr) {
    return device_error(sensed + "; the accelerometers look " + slip->words +
                        " (accel.unit, accel.scale of the frame)");
  }
  Eigen::Index most = 0;
  up.cwiseAbs().maxCoeff(&most);
  if (!size_fits && std::abs(force_mps2[most]) < 0.1 * gravity_mps2 && std::abs(up[most]) > 0.5)
    return device_error(sensed + "; accelerometer " + "xyz"[most] + " does not answer to gravity");
  if (!points_up && nearest_axis(force_mps2) != nearest_axis(up)) {
    return device_error(sensed + "; the unit's " + nearest_axis(force_mps2) + " is up instead of its " +
                        nearest_axis(up) + ": mounted another way, or axes and signs of its frame (accel.axes)");
  }
  if (size_fits) {
    return device_error(sensed + "; up is " + format_number(std::round(angle_between_deg(force_mps2, up))) +
                        " deg away from there: zero of the table's pitch and roll, or the fixture");
  }
  return device_error(sensed +
                      "; scale of the accelerometers (accel.pulse_mps, accel.scale of the frame) or a dead one");
}

Status judge_felt(const Eigen::Vector3d& sum_deg, const AxisTriple& from_deg, const AxisTriple& to_deg,
                  const DirectionLimits& limits) {
  const auto turn = turn_between(from_deg, to_deg);
  if (!turn || std::abs(turn->second) < limits.smallest_turn_deg) return {};
  const Eigen::Vector3d expected = body_axis_of(turn->first, from_deg) * turn->second;
  if (points_along(sum_deg, expected, limits.direction_deg)) return {};
  const std::string turned =
      std::string("the turn of ") + to_string(turn->first) + " by " + format_number(turn->second) + " deg ";
  if (sum_deg.norm() == 0.0) return device_error(turned + "was not felt by any gyro");
  if (sum_deg.norm() < 0.5 * std::abs(turn->second))
    return device_error(turned + "was hardly felt (" + triple_text(sum_deg) + " deg about x, y, z): expected " +
                        triple_text(expected) + ": a dead gyro, or a unit that does not ride on the table");
  return device_error(turned + "was felt about " + nearest_axis(sum_deg) + " (" + triple_text(sum_deg) +
                      "): expected about " + nearest_axis(expected) +
                      ": mounted another way, signs of the table's axis, or axes and signs of the unit's frame");
}

std::string EarthRateCheck::add_rest(const Eigen::Vector3d& rate_radps, double sigma_radps, const Eigen::Matrix3d& C_nb,
                                     const Eigen::Vector3d& up) {
  if (contradictory_) return {};
  if (rests_ == 0) {
    const double strange = limits_.strange_bias * std::abs(rate_radps.norm() - earth_rate_radps);
    const double bias = std::max(limits_.least_bias_degph * radps_per_degph, strange);
    P_.topLeftCorner<3, 3>().diagonal().setConstant(bias * bias);
    P_.bottomRightCorner<3, 3>().diagonal().setConstant(100.0 * earth_rate_radps * earth_rate_radps);
  }
  const Eigen::Matrix3d C_bn = level(C_nb, up).transpose();
  Eigen::Matrix<double, 3, 6> H;
  H << Eigen::Matrix3d::Identity(), C_bn;
  const double noise = std::hypot(sigma_radps, limits_.misalignment_rad * rate_radps.norm());
  const Eigen::Matrix3d S = H * P_ * H.transpose() + Eigen::Matrix3d::Identity() * (noise * noise);
  const Eigen::Matrix3d S_inverse = S.inverse();
  const Eigen::Vector3d innovation = rate_radps - H * x_;
  if (rests_ > 0 && innovation.dot(S_inverse * innovation) > limits_.contradiction) {
    contradictory_ = true;
    return {};
  }
  const Eigen::Matrix<double, 6, 3> K = P_ * H.transpose() * S_inverse;
  x_ += K * innovation;
  P_ = (P_ - K * H * P_).eval();
  P_ = (0.5 * (P_ + P_.transpose())).eval();
  ++rests_;

  const Eigen::Vector3d earth = x_.tail<3>();
  const double size = earth.norm();
  if (size < limits_.smallest * earth_rate_radps || size > limits_.largest * earth_rate_radps) return {};
  const double sine = earth.y() / size;
  const Eigen::Vector3d slope = (Eigen::Vector3d::UnitY() - sine * earth / size) / size;
  const double sigma = std::sqrt(slope.dot(P_.bottomRightCorner<3, 3>() * slope));
  const double difference = sine - std::sin(latitude_deg_ * rad_per_deg);
  if (std::abs(difference) <= std::max(limits_.sigmas * sigma, limits_.least_difference)) return {};
  const double latitude_deg = std::asin(sine) / rad_per_deg;
  // Of the latitude; near a pole its sine tells little.
  const double sigma_deg = sigma / std::max(std::sqrt(1.0 - sine * sine), std::sqrt(sigma)) / rad_per_deg;
  return fmt::format(
      "at rest the gyros feel the earth turn about the vertical at {:+.2f} deg/h of {:.2f}, as at a latitude of {:.1f} "
      "+- {:.1f} deg: site.latitude_deg is {:.10g} (north is positive), or axes and signs of the gyros",
      earth.y() / radps_per_degph, size / radps_per_degph, latitude_deg, sigma_deg, latitude_deg_);
}

}  // namespace turncal
