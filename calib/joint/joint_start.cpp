#include "calib/joint/joint_estimate.h"

#include <array>
#include <cmath>
#include <vector>

#include <fmt/format.h>
#include <Eigen/LU>

#include "calib/model/attitude.h"
#include "calib/model/limits.h"
#include "calib/statistics/numerics.h"

namespace turncal {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

struct SegmentMean {
  Matrix3d C_table;  // commanded
  Vector3d rate = Vector3d::Zero();
  Vector3d force = Vector3d::Zero();
  double t = 0.0;
};

std::vector<SegmentMean> segment_means(const CompressedRecording& recording, const SensorModel& model) {
  std::vector<SegmentMean> rests;
  int segment = -1;
  for (const Block& block : recording.blocks) {
    if (!block.whole_second) continue;
    if (block.segment != segment) {
      segment = block.segment;
      const Segment& s = recording.segments[segment];
      rests.push_back({attitude_at(angles_of(s))});
    }
    rests.back().rate += model.gyro_scale * block.gyro;
    rests.back().force += model.accel_scale * block.accel;
    rests.back().t += block.duration_s;
  }
  for (SegmentMean& rest : rests) {
    rest.rate /= rest.t;
    rest.force = rest.force / rest.t - model.accel_bias_mps2;
  }
  return rests;
}

// Mean square of the sine of the angle between measured and expected up, in the unit's axes.
double misfit(const std::vector<SegmentMean>& rests, const Matrix3d& mounting, double sign) {
  double sum = 0.0;
  double t = 0.0;
  for (const SegmentMean& rest : rests) {
    const Vector3d up_b = (rest.C_table * mounting).transpose() * Vector3d::UnitY();
    sum += rest.t * (sign * rest.force.normalized() - up_b).squaredNorm();
    t += rest.t;
  }
  return sum / t;
}

std::string describe(const Matrix3d& mounting) {
  const Eigen::AngleAxisd turn(mounting);
  static constexpr std::array<const char*, 3> names = {"front", "up", "right"};
  Vector3d axis = turn.axis();
  double angle = turn.angle() / rad_per_deg;
  Eigen::Index main = 0;
  const bool plain = axis.cwiseAbs().maxCoeff(&main) > 0.99;
  if (plain && axis[main] < 0.0) angle = -angle;
  return fmt::format("turned by {} deg about {}", std::lround(angle),
                     plain ? names[main] : "an axis between the table's");
}

void find_mounting(const std::vector<SegmentMean>& rests, JointStart& start) {
  constexpr double good = start_limits.mounting_misfit;
  if (misfit(rests, start.mounting, 1.0) < good) return;
  Matrix3d best = start.mounting;
  Matrix3d best_reversed = start.mounting;
  for (const Matrix3d& axes : signed_axes()) {
    const Matrix3d m = axes.transpose();
    if (m.determinant() < 0.0) continue;  // the 24 orientations of a box are left
    if (misfit(rests, m, 1.0) < start_limits.better_mounting * misfit(rests, best, 1.0)) best = m;
    if (misfit(rests, m, -1.0) < start_limits.better_mounting * misfit(rests, best_reversed, -1.0)) best_reversed = m;
  }
  if (misfit(rests, start.mounting, -1.0) < good) {
    start.error = "gravity has the wrong sign: at rest the accelerometers read down where the table says up";
  } else if (misfit(rests, best, 1.0) < good) {
    start.mounting = best;
    start.mounting_text = describe(best);
  } else if (misfit(rests, best_reversed, -1.0) < good) {
    start.error = "gravity has the wrong sign, and the unit is " + describe(best_reversed);
  } else {
    start.error = "at rest gravity does not point where the table's angles say, in none of 24 mountings of the unit";
  }
}

}  // namespace

JointStart joint_start(const CompressedRecording& recording, const Parameters& parameters) {
  JointStart start;
  const SensorModel model = sensor_model(parameters, recording.info);
  const std::vector<SegmentMean> rests = segment_means(recording, model);
  if (rests.empty()) return start;
  find_mounting(rests, start);
  if (!start.error.empty()) return start;

  Eigen::Matrix<double, 5, 5> A = Eigen::Matrix<double, 5, 5>::Zero();
  Eigen::Matrix<double, 5, 1> b = Eigen::Matrix<double, 5, 1>::Zero();
  const Vector3d earth = earth_rate_n(recording.info.latitude_deg);
  std::vector<Matrix3d> attitudes;
  for (const SegmentMean& rest : rests) {
    const Matrix3d C = level(rest.C_table * start.mounting, rest.force);
    attitudes.push_back(C);
    Eigen::Matrix<double, 3, 5> row;
    row << Matrix3d::Identity(), C.row(0).transpose(), C.row(2).transpose();
    A += rest.t * row.transpose() * row;
    b += rest.t * row.transpose() * (rest.rate - C.row(1).transpose() * earth.y());
  }
  // Biases that the rests do not separate from the Earth's rate stay at zero. The eigenvalues are in seconds at rest.
  const SymmetricEigen eigen = symmetric_eigen(A);
  Eigen::Matrix<double, 5, 1> inverse = eigen.values.cwiseMax(1e-9).cwiseInverse();
  for (int k = 0; k < 5; ++k)
    if (eigen.values[k] < start_limits.open_direction * eigen.values[4]) inverse[k] = 0.0;
  const Eigen::Matrix<double, 5, 5> covariance = eigen.vectors * inverse.asDiagonal() * eigen.vectors.transpose();
  const Eigen::Matrix<double, 5, 1> x = covariance * b;
  start.N0_degph = x.head<3>() / radps_per_degph;
  const bool separated = (inverse.array() > 0.0).all();
  double residual = 0.0;
  for (std::size_t k = 0; k < rests.size(); ++k)
    residual +=
        rests[k].t *
        (rests[k].rate - x.head<3>() - attitudes[k].transpose() * Vector3d(x[3], earth.y(), x[4])).squaredNorm();
  const double freedom = 3.0 * double(rests.size()) - 5.0;
  if (!separated || freedom < 4.0 || !(earth.x() > 0.0)) return start;
  const double sigma = std::sqrt(residual / freedom * covariance.diagonal().tail<2>().maxCoeff());
  const double found = std::hypot(x[3], x[4]), part = start_limits.of_earth_rate * earth.x();
  if (sigma > part || std::abs(found - earth.x()) > part + start_limits.earth_rate_sigmas * sigma) return start;
  start.heading_rad = std::atan2(-x[4], x[3]);
  start.heading_sigma_rad = sigma / earth.x();
  return start;
}

}  // namespace turncal
