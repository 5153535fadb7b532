#include "calib/navigation/mechanisation.h"

#include <algorithm>
#include <cmath>

#include "calib/model/limits.h"
#include "calib/model/parameters.h"

namespace turncal {
namespace {

constexpr double eccentricity2 = wgs84_flattening * (2.0 - wgs84_flattening);
constexpr double equator_gravity_mps2 = 9.7803253359;
constexpr double somigliana_k = 0.00193185265241;
constexpr double m_ratio = 0.00344978650684;  // W^2 a^2 b / GM

}  // namespace

double normal_gravity_mps2(double latitude_rad, double height_m) {
  const double s2 = std::sin(latitude_rad) * std::sin(latitude_rad);
  const double surface = equator_gravity_mps2 * (1.0 + somigliana_k * s2) / std::sqrt(1.0 - eccentricity2 * s2);
  const double x = height_m / wgs84_semi_major_m;
  return surface * (1.0 - 2.0 * x * (1.0 + wgs84_flattening + m_ratio - 2.0 * wgs84_flattening * s2) + 3.0 * x * x);
}

RadiiOfCurvature radii_of_curvature(double latitude_rad) {
  const double s = std::sin(latitude_rad);
  const double w2 = 1.0 - eccentricity2 * s * s;
  const double east = wgs84_semi_major_m / std::sqrt(w2);
  return {east * (1.0 - eccentricity2) / w2, east};
}

FrameRates frame_rates(double latitude_rad, double height_m, const Eigen::Vector3d& velocity_n_mps) {
  const double s = std::sin(latitude_rad);
  const double c = std::cos(latitude_rad);
  const RadiiOfCurvature radii = radii_of_curvature(latitude_rad);
  const double eastward = velocity_n_mps[2] / (radii.east_m + height_m);
  return {{earth_rate_radps * c, earth_rate_radps * s, 0.0},
          {eastward, eastward * s / c, -velocity_n_mps[0] / (radii.north_m + height_m)}};
}

bool FeltLatitude::speaks_against(double of_record_rad, double least_deg) const {
  return std::abs(latitude_rad - of_record_rad) > std::max(least_deg * rad_per_deg, latitude_limits.sigmas * sigma_rad);
}

// A nominal rest that turns faster is none: half a degree a second, far above the Earth's rate and any bias that a calibration leaves.
constexpr double most_at_rest_radps = 0.0087;

Eigen::Quaterniond quaternion_of(const Eigen::Vector3d& rotation_rad) {
  const double x = 0.25 * rotation_rad.squaredNorm();  // of half the angle
  double c, s;                                         // cos(half), sin(half) / angle
  if (x < 0.0025) {
    c = 1.0 - x / 2.0 * (1.0 - x / 12.0 * (1.0 - x / 30.0 * (1.0 - x / 56.0)));
    s = 0.5 * (1.0 - x / 6.0 * (1.0 - x / 20.0 * (1.0 - x / 42.0)));
  } else {
    const double half = std::sqrt(x);
    c = std::cos(half);
    s = 0.5 * std::sin(half) / half;
  }
  return {c, s * rotation_rad[0], s * rotation_rad[1], s * rotation_rad[2]};
}

void IncrementIntegrator::reserve(std::int64_t samples) { intervals_.reserve(std::size_t(samples / samples_ + 1)); }

void IncrementIntegrator::add(std::int64_t counter, const Eigen::Vector3d& gyro_rad, const Eigen::Vector3d& accel_mps,
                              bool at_rest, bool gap_at_rest) {
  if (started_ && counter <= last_counter_) return;
  if (started_ && counter > last_counter_ + 1) {
    const Eigen::Vector3d gyro = 0.5 * (gyro_before_ + gyro_rad);
    const Eigen::Vector3d accel = 0.5 * (accel_before_ + accel_mps);
    for (std::int64_t k = last_counter_ + 1; k < counter; ++k) add_one(gyro, accel, at_rest && gap_at_rest, true);
  }
  started_ = true;
  last_counter_ = counter;
  add_one(gyro_rad, accel_mps, at_rest, false);
}

void IncrementIntegrator::add_one(const Eigen::Vector3d& a, const Eigen::Vector3d& d, bool at_rest, bool filled) {
  const Eigen::Vector3d cross = a.cross(d);
  const Eigen::Vector3d phi = a + (1.0 / 12.0) * gyro_before_.cross(a);
  const Eigen::Vector3d u =
      d + 0.5 * cross + (1.0 / 6.0) * a.cross(cross) + (1.0 / 12.0) * (gyro_before_.cross(d) + accel_before_.cross(a));
  if (count_ == 0) {
    open_ = MotionInterval{};
    open_.at_rest = true;
  }
  open_.push_mps += open_.turn * u;
  open_.turn = open_.turn * quaternion_of(phi);
  open_.gyro_rad += a;
  open_.accel_mps += d;
  open_.at_rest = open_.at_rest && at_rest;
  open_.missing += filled ? 1 : 0;
  gyro_before_ = a;
  accel_before_ = d;
  if (++count_ < samples_) return;
  open_.duration_s = period_s_ * samples_;
  open_.turn.normalize();
  open_.at_rest = open_.at_rest && open_.gyro_rad.norm() <= most_at_rest_radps * open_.duration_s;
  intervals_.push_back(open_);
  count_ = 0;
}

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
  // First column: the front axis in n. Up row: the roll about it.
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
