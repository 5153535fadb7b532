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

// u of u x (r x v). Half the mean square of the angle: 1/6 r r in even rotation, 1/10 or 4/15 where it begins or ends; by the mean angle m,
// (m/2 - r/12) r is 1/6, 1/12 or 1/4. What even rotation then leaves of a force that does not turn with the unit is r^4 / 360 of it.
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
  // sum beta_i (T - s_i) / T, turned by the mean third of the rotation that it sees
  const Eigen::Vector3d mean = speed - speed_time / t - 0.5 * f0 * t;
  motion.mean_velocity = mean + motion.rotation.cross(mean) / 3.0;
  return motion;
}

void parameter_columns(const Block& block, const BlockMotion& motion, const SensorModel& m, const ParameterVector& unit,
                       BlockColumns& columns) {
  const double t = block.duration_s;
  const Eigen::Vector3d& r = motion.rotation;
  const Eigen::Vector3d dv = m.accel_scale * block.accel - m.accel_bias_mps2 * t;
  const Eigen::Vector3d r_cross_dv = r.cross(dv);
  const Eigen::Matrix3d r_skew = skew(r);
  const Eigen::Matrix3d accel_sum = m.accel_scale * block.sculling.transpose();  // A S'
  const Eigen::Matrix3d gyro_sum = m.gyro_scale * block.sculling;                // G S
  // First moments, through which a bias meets the increments of the other triad (see evaluate).
  const Eigen::Vector3d& b = m.gyro_bias_radps;
  const Eigen::Vector3d& f0 = m.accel_bias_mps2;
  const Eigen::Vector3d gyro_middle = block.gyro * t - block.gyro_time;
  const Eigen::Vector3d middle = m.gyro_scale * gyro_middle;
  const Eigen::Vector3d speed_time = m.accel_scale * block.accel_time - 0.5 * t * t * f0;
  const Eigen::Vector3d lag = m.gyro_scale * (2.0 * block.gyro_time - t * block.gyro);  // before - prefix of evaluate
  columns.rotation.setZero();
  columns.velocity.setZero();
  columns.mean_velocity.setZero();

  // Of (m/2 - r/12) x (r x dv): by a change of m, of r, of dv.
  const Eigen::Vector3d u = third_order_angle(middle / t - 0.5 * t * b, r);
  const Eigen::Matrix3d third_order_mean = -0.5 * skew(r_cross_dv);
  const Eigen::Matrix3d third_order = skew(r_cross_dv) / 12.0 - skew(u) * skew(dv);
  const Eigen::Matrix3d third_order_push = skew(u) * r_skew;
  const Eigen::Matrix3d turned_mean = skew(dv) / -6.0;  // dr x dv / 6
  for (int axis = 0; axis < 3; ++axis) {
    const Eigen::Vector3d e = Eigen::Vector3d::Unit(axis);
    // gyro bias: turns by -t about the axis, evenly over the block
    const Eigen::Vector3d turn = -t * e;
    columns.rotation.col(axis) = unit[axis] * (turn + 0.5 * lag.cross(e));
    columns.velocity.col(axis) =
        unit[axis] * (third_order * turn + third_order_mean * (0.5 * turn) - e.cross(speed_time));
    columns.mean_velocity.col(axis) = unit[axis] * (turned_mean * turn);
    // accelerometer bias
    const Eigen::Vector3d push = -t * e;
    columns.velocity.col(3 + axis) =
        unit[3 + axis] * (push + (0.5 * t * t * b - middle).cross(e) + third_order_push * push);
    columns.mean_velocity.col(3 + axis) = unit[3 + axis] * (0.5 * push + r.cross(push) / 6.0);
  }
  for (int i = 0; i < 3; ++i) {
    const Eigen::Vector3d e_i = Eigen::Vector3d::Unit(i);
    const int k = (i + 1) % 3;
    const int l = (i + 2) % 3;
    for (int j = 0; j < 3; ++j) {
      const double mean_turn = gyro_middle[j] / t;  // about axis i
      const Eigen::Vector3d e_j = Eigen::Vector3d::Unit(j);
      // gyro scale and misalignment
      const int g = 6 + 3 * i + j;
      Eigen::Vector3d turn = e_i * block.gyro[j];
      const Eigen::Vector3d row_l = m.gyro_scale.row(l);
      const Eigen::Vector3d row_k = m.gyro_scale.row(k);
      turn[k] += 0.5 * row_l.cross(e_j).dot(block.coning);
      turn[l] += 0.5 * e_j.cross(row_k).dot(block.coning);
      columns.rotation.col(g) = unit[g] * turn;
      columns.velocity.col(g) = unit[g] * (e_i.cross(accel_sum.col(j) - gyro_middle[j] * f0) + third_order * turn +
                                           third_order_mean.col(i) * mean_turn);
      columns.mean_velocity.col(g) = unit[g] * (turned_mean * turn);
      // accelerometer scale and misalignment
      const int a = 15 + 3 * i + j;
      const Eigen::Vector3d push = e_i * block.accel[j];
      columns.velocity.col(a) =
          unit[a] * (push + (gyro_sum.col(j) - block.accel_time[j] * b).cross(e_i) + third_order_push * push);
      const Eigen::Vector3d mean_push = e_i * (block.accel[j] - block.accel_time[j] / t);
      columns.mean_velocity.col(a) = unit[a] * (mean_push + r.cross(mean_push) / 3.0);
    }
  }
}

}  // namespace turncal
