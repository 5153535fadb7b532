// For studies: what the 24 parameters would take up of something added to the readings, and errors of an estimate that count it.
//
// The truth of a parameter is what it is over the whole recording. A disturbance is laid on a recording without what a bias and a row of
// the matrix take up of it (least squares), so that the truth stands; what they take up of a named effect is counted with the estimate.
#pragma once

#include <cmath>

#include <Eigen/Dense>

#include "calib/joint/joint_estimate.h"
#include "tests/disturbance.h"

namespace turncal {

// What of a disturbance a bias and the sensor's row would take up: the bias at rest, the row of a gyro in the turns, that of an
// accelerometer at rest.
struct TakenUp {
  Eigen::Matrix<double, 4, 3> gyro,
      accel;  // a column a sensor: bias, then what goes with the rate (rad/s) or the force (g)
};

template <class Added>  // AddedReading of (block, moment)
TakenUp taken_up(const Added& whole, const CompressedRecording& recording, const Parameters& truth) {
  Eigen::Matrix4d normal_accel = Eigen::Matrix4d::Zero(), normal_gyro = Eigen::Matrix4d::Zero();
  Eigen::Matrix<double, 4, 3> right_accel = Eigen::Matrix<double, 4, 3>::Zero(),
                              right_gyro = Eigen::Matrix<double, 4, 3>::Zero();
  each_moment(recording, truth, [&](std::size_t k, const DisturbedMoment& m) {
    const AddedReading added = whole(k, m);
    const double t = recording.blocks[k].duration_s;
    if (m.at_rest) {
      const Eigen::Vector4d x(1.0, m.force_g.x(), m.force_g.y(), m.force_g.z());
      normal_accel += t * x * x.transpose();
      right_accel += t * x * added.accel_mps2.transpose();
    }
    // A turn is worth more than a rest: a ppm of it stands against the rest of a minute.
    Eigen::Vector4d x(1.0, 0.0, 0.0, 0.0);
    if (!m.at_rest) x.tail<3>() = m.rate_radps;
    normal_gyro += t * x * x.transpose();
    right_gyro += t * x * added.gyro_radps.transpose();
  });
  return {normal_gyro.completeOrthogonalDecomposition().solve(right_gyro),
          normal_accel.completeOrthogonalDecomposition().solve(right_accel)};
}

inline Disturbance without_parameters(const Disturbance& whole, const CompressedRecording& recording,
                                      const Parameters& truth) {
  const auto at = [&whole](std::size_t, const DisturbedMoment& m) { return whole(m); };
  return [whole, t = taken_up(at, recording, truth)](const DisturbedMoment& m) {
    AddedReading added = whole(m);
    added.accel_mps2 -= t.accel.row(0).transpose() + t.accel.bottomRows<3>().transpose() * m.force_g;
    added.gyro_radps -= t.gyro.row(0).transpose() + t.gyro.bottomRows<3>().transpose() * m.rate_radps;
    return added;
  };
}

// The same as a change of the 24 parameters, with the body frame kept on the accelerometers (a21 = a31 = a32 = 0).
inline ParameterVector as_parameters(const TakenUp& t, const Parameters& p) {
  Parameters change;
  change.N0_degph = t.gyro.row(0).transpose() / radps_per_degph;
  change.A0_g = t.accel.row(0).transpose() / standard_gravity_mps2;
  change.n = -t.gyro.bottomRows<3>().transpose() * p.n;
  change.a = -t.accel.bottomRows<3>().transpose() / standard_gravity_mps2 * p.a;
  const Eigen::Vector3d turn(-change.a(2, 1), change.a(2, 0), -change.a(1, 0));
  Eigen::Matrix3d cross;
  cross << 0.0, -turn.z(), turn.y(), turn.z(), 0.0, -turn.x(), -turn.y(), turn.x(), 0.0;
  change.n += cross * p.n;
  change.a += cross * p.a;
  return to_vector(change);
}

// What one unit of an effect of the catalogue reads in every block.
inline std::vector<AddedReading> readings_of(const EffectColumn& column, const JointResult& fit,
                                             const CompressedRecording& recording) {
  EffectModel one = make_effect_model({column}, {recording.info.latitude_deg}, fit.reference_temperature_c);
  one.values = Eigen::VectorXd::Ones(1);
  FilterSetup setup = fit.setup;
  setup.with_columns = false;
  setup.keep_taken_off = true;
  const FilterResult pass = run_filter(recording, fit.parameters, one, setup);
  std::vector<AddedReading> readings;
  for (std::size_t k = 0; k < recording.blocks.size(); ++k) {
    const double t = recording.blocks[k].duration_s;
    readings.push_back({pass.taken_off[k].turn_rad / t, pass.taken_off[k].push_mps / t});
  }
  return readings;
}

// How far the estimate is off. The truth of a parameter is what it is over the whole recording, while a named effect makes a bias that of
// the first sample (drift) or of no force (g squared): what a bias and a row would take up of it is counted with them.
struct ErrorsOverRecording {
  ParameterVector error = ParameterVector::Zero(),
                  sigma = ParameterVector::Zero();  // file units; sigma 0: not determined
};
inline ErrorsOverRecording errors_over_recording(const JointResult& r, const CompressedRecording& recording,
                                                 const Parameters& truth) {
  const Eigen::Index columns = r.covariance.cols();
  Eigen::MatrixXd map = Eigen::MatrixXd::Zero(parameter_count, columns);
  ErrorsOverRecording result;
  result.error = to_vector(r.parameters) - to_vector(truth);
  for (Eigen::Index i = 0; i < columns; ++i) {
    const int column = r.free[std::size_t(i)];
    if (column < parameter_count) {
      map(column, i) = 1.0;
      continue;
    }
    const EstimatedEffect& effect = r.effects[std::size_t(column - parameter_count)];
    const std::vector<AddedReading> readings = readings_of(effect.column, r, recording);
    const auto added = [&](std::size_t k, const DisturbedMoment&) { return readings[k]; };
    map.col(i) = as_parameters(taken_up(added, recording, truth), r.parameters);
    result.error += effect.value * map.col(i);
  }
  const Eigen::MatrixXd covariance = map * r.covariance * map.transpose();
  for (int k = 0; k < parameter_count; ++k)
    if (r.sigma[k] > 0.0) result.sigma[k] = std::sqrt(covariance(k, k));
  return result;
}

}  // namespace turncal
