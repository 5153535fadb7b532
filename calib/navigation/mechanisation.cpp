#include "calib/navigation/mechanisation.h"

#include <cmath>

#include "calib/model/parameters.h"

namespace turncal {

Navigator::Navigator(const NavigationState& start, double gravity_mps2, bool hold_height)
    : state_(start),
      gravity_offset_mps2_(gravity_mps2 - normal_gravity_mps2(start.latitude_rad, start.height_m)),
      hold_height_(hold_height),
      rates_(frame_rates(start.latitude_rad, start.height_m, start.velocity_n_mps)) {}

void Navigator::advance(const MotionInterval& interval) {
  NavigationState& s = state_;
  const double T = interval.duration_s;
  const Eigen::Vector3d push_n = s.q_nb * interval.push_mps;

  // The middle of the interval, to second order in T, with the rates of the interval before.
  const RadiiOfCurvature radii = radii_of_curvature(s.latitude_rad);
  const double latitude = s.latitude_rad + 0.5 * T * s.velocity_n_mps[0] / (radii.north_m + s.height_m);
  const double height = s.height_m + 0.5 * T * s.velocity_n_mps[1];
  const double gravity = normal_gravity_mps2(latitude, height) + gravity_offset_mps2_;
  const Eigen::Vector3d gravity_n(0.0, -gravity, 0.0);
  Eigen::Vector3d velocity =
      s.velocity_n_mps + 0.5 * (push_n - 0.5 * T * (rates_.earth + rates_.transport).cross(push_n) +
                                T * (gravity_n - (2.0 * rates_.earth + rates_.transport).cross(s.velocity_n_mps)));
  if (hold_height_) velocity[1] = climb_mps_;
  rates_ = frame_rates(latitude, height, velocity);
  const Eigen::Vector3d turn_of_n = T * (rates_.earth + rates_.transport);

  const Eigen::Vector3d before = s.velocity_n_mps;
  s.velocity_n_mps += push_n - 0.5 * turn_of_n.cross(push_n) +
                      T * (gravity_n - (2.0 * rates_.earth + rates_.transport).cross(velocity));
  if (hold_height_) s.velocity_n_mps[1] = climb_mps_;
  s.q_nb = quaternion_of(-turn_of_n) * s.q_nb * interval.turn;
  s.q_nb.normalize();
  const Eigen::Vector3d mean = 0.5 * (before + s.velocity_n_mps);
  s.latitude_rad += T * mean[0] / (radii.north_m + height);
  s.longitude_rad += T * mean[2] / ((radii.east_m + height) * std::cos(latitude));
  s.height_m += T * mean[1];
}

void Navigator::correct(const Eigen::Vector3d& phi_rad, const Eigen::Vector3d& dv_mps) {
  state_.q_nb = quaternion_of(phi_rad) * state_.q_nb;
  state_.q_nb.normalize();
  state_.velocity_n_mps -= dv_mps;
}

void Navigator::set_position(double latitude_rad, double longitude_rad, double height_m) {
  state_.latitude_rad = latitude_rad;
  state_.longitude_rad = longitude_rad;
  state_.height_m = height_m;
}

AttitudeAngles angles_of(const Eigen::Quaterniond& q_nb) {
  const Eigen::Matrix3d C = q_nb.toRotationMatrix();
  // First column: the front axis in n; the up row: how the unit is rolled about it.
  AttitudeAngles angles;
  angles.heading_rad = std::atan2(C(2, 0), C(0, 0));
  if (angles.heading_rad < 0.0) angles.heading_rad += 2.0 * pi;
  angles.pitch_rad = std::asin(std::min(1.0, std::max(-1.0, C(1, 0))));
  angles.roll_rad = std::atan2(-C(1, 2), C(1, 1));
  return angles;
}

Eigen::Vector2d displacement_m(const NavigationState& state, double latitude_rad, double longitude_rad) {
  const RadiiOfCurvature radii = radii_of_curvature(latitude_rad);
  return {(state.latitude_rad - latitude_rad) * radii.north_m,
          std::remainder(state.longitude_rad - longitude_rad, 2.0 * pi) * radii.east_m * std::cos(latitude_rad)};
}

}  // namespace turncal
