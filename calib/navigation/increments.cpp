#include "calib/navigation/increments.h"

#include <cmath>

namespace turncal {

// What is called rest and turns faster is none: half a degree a second, far beyond the Earth and any bias that a calibration left.
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

void IncrementIntegrator::reserve(std::int64_t samples) {
  intervals_.reserve(static_cast<std::size_t>(samples / samples_ + 1));
}

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

}  // namespace turncal
