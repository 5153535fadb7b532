// Calibrated increments into intervals of motion: coning and sculling, sample by sample, before anybody knows the attitude.
//
// Source: Savage, "Strapdown Inertial Navigation Integration Algorithm Design", J. Guidance 21 (1998), part 1 eq. 33-39 and
// part 2 eq. 33-41, the two-sample form with the increment before; Titterton and Weston (2004), 11.2.3 and 11.3.3. With
// increments a (rad) and d (m/s) of a sample and a', d' of the one before:
//
//   rotation vector  phi = a + a' x a / 12
//   velocity, in the axes at the sample's start  u = d + a x d / 2 + a x (a x d) / 6 + (a' x d + d' x a) / 12
//
// An interval holds the product of the rotations and the sum of the velocities, in the axes at the interval's start. It does
// not depend on where navigation began: every branch uses the same intervals.
//
// Samples that were lost, or marked as bad, count as the mean of their neighbours. That is good for one or two at rest; more lose what
// the unit did meanwhile, and MotionInterval::missing says so.
// Errors: of a coning motion of frequency w the share (w dt)^4 / 30 of its rate is left.
#pragma once

#include <cstdint>
#include <vector>

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace turncal {

struct MotionInterval {
  Eigen::Quaterniond turn = Eigen::Quaterniond::Identity();  // from body axes at the end to those at the start
  Eigen::Vector3d push_mps = Eigen::Vector3d::Zero();        // integral of specific force, body axes at the start
  Eigen::Vector3d gyro_rad = Eigen::Vector3d::Zero();        // plain sums of the increments, for sensitivities
  Eigen::Vector3d accel_mps = Eigen::Vector3d::Zero();
  double duration_s = 0.0;
  bool at_rest = false;  // all of it, and it turns by less than 0.5 deg/s
  int missing = 0;       // samples that were filled in
};

// Rotation vector into quaternion, by series below 0.1 rad (next term 1e-13 of the angle).
Eigen::Quaterniond quaternion_of(const Eigen::Vector3d& rotation_rad);

class IncrementIntegrator {
 public:
  IncrementIntegrator(double sample_period_s, int samples_per_interval)
      : period_s_(sample_period_s), samples_(samples_per_interval) {}

  // Room for so many samples, so that add() does not allocate.
  void reserve(std::int64_t samples);

  // Calibrated increments, rad and m/s, of the sample that ends at `counter`. Counters not above the last one are dropped; a
  // bad sample is not handed over, and shows as a gap. `gap_at_rest`: whether what is filled in before it counts as rest, too.
  void add(std::int64_t counter, const Eigen::Vector3d& gyro_rad, const Eigen::Vector3d& accel_mps, bool at_rest,
           bool gap_at_rest = true);

  int samples_per_interval() const { return samples_; }
  // What is whole so far. The rest, shorter than an interval, is never given.
  const std::vector<MotionInterval>& intervals() const { return intervals_; }

 private:
  void add_one(const Eigen::Vector3d& gyro_rad, const Eigen::Vector3d& accel_mps, bool at_rest, bool filled);

  double period_s_;
  int samples_;
  std::vector<MotionInterval> intervals_;
  MotionInterval open_;
  int count_ = 0;
  bool started_ = false;
  std::int64_t last_counter_ = 0;
  Eigen::Vector3d gyro_before_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d accel_before_ = Eigen::Vector3d::Zero();
};

}  // namespace turncal
