#include "calib/statistics/block_motion.h"

#include "calib/model/attitude.h"

namespace turncal {
namespace {

// (G x) x (G y) = cofactor(G) (x x y)
Eigen::Matrix3d cofactor(const Eigen::Matrix3d& g) {
  Eigen::Matrix3d c;
  c.row(0) = g.row(1).cross(g.row(2));
  c.row(1) = g.row(2).cross(g.row(0));
  c.row(2) = g.row(0).cross(g.row(1));
  return c;
}

// Returns u of the third-order term u x (r x v). Half the mean square of the angle is 1/6 r r in even rotation, 1/10 or 4/15 where it begins or ends;
// by the mean angle m, (m/2 - r/12) r is 1/6, 1/12 or 1/4. r^2 / 360 removes what even rotation leaves of a force that does not turn with the unit.
Eigen::Vector3d third_order_angle(const Eigen::Vector3d& mean_angle, const Eigen::Vector3d& r) {
  return 0.5 * mean_angle - (1.0 / 12.0 - r.squaredNorm() / 360.0) * r;
}

}  // namespace

BlockMotion evaluate(const Block& block, const SensorModel& m, double period_s) {
  const double t = block.duration_s;
  const Eigen::Vector3d& b = m.gyro_bias_radps;
  const Eigen::Vector3d& f0 = m.accel_bias_mps2;
  const Eigen::Vector3d angle = m.gyro_scale * block.gyro;
  const Eigen::Vector3d speed = m.accel_scale * block.accel;
  const Eigen::Vector3d angle_time = m.gyro_scale * block.gyro_time;
  const Eigen::Vector3d speed_time = m.accel_scale * block.accel_time;

  // sum over i < j of (x_i - b dt) x (x_j - b dt): the bias meets first moments only.
  const Eigen::Vector3d prefix = angle * (t - 0.5 * period_s) - angle_time;  // sum theta_j dt
  const Eigen::Vector3d before = angle_time - 0.5 * period_s * angle;        // sum t_j alpha_j
  const Eigen::Vector3d coning = cofactor(m.gyro_scale) * block.coning - prefix.cross(b) - b.cross(before);

  const Eigen::Vector3d middle = angle * t - angle_time;  // sum x_i dt, x_i the angle at the middle of sample i
  const Eigen::Vector3d sculling = cross_of_outer(m.gyro_scale * block.sculling * m.accel_scale.transpose()) -
                                   middle.cross(f0) - b.cross(speed_time) + 0.5 * t * t * b.cross(f0);

  BlockMotion motion;
  motion.rotation = angle - b * t + 0.5 * coning;
  const Eigen::Vector3d dv = speed - f0 * t;
  const Eigen::Vector3d mean_angle = middle / t - 0.5 * t * b;
  const Eigen::Vector3d& r = motion.rotation;
  motion.velocity = dv + sculling + third_order_angle(mean_angle, r).cross(r.cross(dv));
  // sum beta_i (T - s_i) / T, rotated by a third of the rotation: the mean over the block
  const Eigen::Vector3d mean = speed - speed_time / t - 0.5 * f0 * t;
  motion.mean_velocity = mean + motion.rotation.cross(mean) / 3.0;
  return motion;
}

void differentiate(const Block& block, const BlockMotion& motion, const SensorModel& m, const ParameterVector& unit,
                   bool mean_velocity, BlockDerivatives& by_parameters) {
  using Eigen::Matrix3d, Eigen::Vector3d;
  const double t = block.duration_s;
  const Vector3d& r = motion.rotation;
  const Vector3d dv = m.accel_scale * block.accel - m.accel_bias_mps2 * t;
  const Matrix3d accel_sum = m.accel_scale * block.sculling.transpose();  // A S'
  const Matrix3d gyro_sum = m.gyro_scale * block.sculling;                // G S
  // First moments, through which a bias meets the increments of the other triad (see evaluate).
  const Vector3d& b = m.gyro_bias_radps;
  const Vector3d& f0 = m.accel_bias_mps2;
  const Vector3d gyro_middle = block.gyro * t - block.gyro_time;
  const Vector3d middle = m.gyro_scale * gyro_middle;
  const Vector3d speed_time = m.accel_scale * block.accel_time - 0.5 * t * t * f0;
  const Vector3d lag = m.gyro_scale * (2.0 * block.gyro_time - t * block.gyro);  // before - prefix of evaluate

  // Derivatives of the velocity by rotation, mean angle and dv, and of its mean by rotation: those of (m/2 - r/12) x (r x dv) by r, m, dv.
  const Vector3d u = third_order_angle(middle / t - 0.5 * t * b, r);
  const Matrix3d by_turn = skew(r.cross(dv)) / 12.0 - skew(u) * skew(dv), by_mean_angle = -0.5 * skew(r.cross(dv)),
                 by_push = Matrix3d::Identity() + skew(u) * skew(r), mean_by_turn = skew(dv) / -6.0;
  // Sets the rows of a parameter with one value per axis: `every` rows apart, from `first` on.
  const auto set = [&](ParameterRows& of, int first, int every, const Matrix3d& by_axis) {
    for (int axis = 0; axis < 3; ++axis) {
      const int row = first + every * axis;
      of.row(row) = unit[row] * by_axis.col(axis).transpose();
    }
  };
  auto& [rotation, velocity, mean] = by_parameters;
  // A bias of a gyro turns by -t about its axis, evenly over the block.
  set(rotation, 0, 1, -t * Matrix3d::Identity() + 0.5 * skew(lag));
  set(velocity, 0, 1, -t * (by_turn + 0.5 * by_mean_angle) + skew(speed_time));
  set(velocity, 3, 1, -t * by_push + skew(0.5 * t * t * b - middle));
  if (mean_velocity) {
    set(mean, 0, 1, -t * mean_by_turn);
    set(mean, 3, 1, -0.5 * t * Matrix3d::Identity() - t / 6.0 * skew(r));
  }
  for (int j = 0; j < 3; ++j) {
    const Matrix3d turn =
        block.gyro[j] * Matrix3d::Identity() + skew(m.gyro_scale * (0.5 * Vector3d::Unit(j).cross(block.coning)));
    set(rotation, 6 + j, 3, turn);
    set(velocity, 6 + j, 3,
        by_turn * turn + gyro_middle[j] / t * by_mean_angle - skew(accel_sum.col(j) - gyro_middle[j] * f0));
    set(velocity, 15 + j, 3, block.accel[j] * by_push + skew(gyro_sum.col(j) - block.accel_time[j] * b));
    if (!mean_velocity) continue;
    set(mean, 6 + j, 3, mean_by_turn * turn);
    set(mean, 15 + j, 3, (block.accel[j] - block.accel_time[j] / t) * (Matrix3d::Identity() + skew(r) / 3.0));
  }
}

}  // namespace turncal
