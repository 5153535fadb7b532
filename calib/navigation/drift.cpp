#include "calib/navigation/drift.h"

#include <cmath>

#include <Eigen/LU>

#include "calib/model/attitude.h"

namespace turncal {
namespace {

enum { phi = 0, dv = 3, dr = 5, gyro_bias = 7, moved = gyro_bias, accel_bias = 10 };
constexpr double step_s = 1.0;

// North and east of a vector in n.
Eigen::Matrix<double, 2, 3> horizontal(const Eigen::Matrix3d& m) {
  Eigen::Matrix<double, 2, 3> rows;
  rows << m.row(0), m.row(2);
  return rows;
}

// lazyProduct: for matrices of this size the call of the general product costs more than the product.
template <class Square, class Matrix>
Matrix propagated(const Square& F, double t, const Matrix& x) {
  const Matrix first = t * F.lazyProduct(x);
  return x + first + (0.5 * t) * F.lazyProduct(first);
}

}  // namespace

CountsModel counts_model(const Parameters& parameters, const RecordingInfo& info) {
  const SensorModel model = sensor_model(parameters, info);
  CountsModel counts;
  counts.counts_of_gyro = model.gyro_scale.inverse();
  counts.counts_of_accel = model.accel_scale.inverse();
  counts.gyro_bias_radps = model.gyro_bias_radps;
  counts.accel_bias_mps2 = model.accel_bias_mps2;
  counts.rad_per_unit = info.gyro_increment == IncrementKind::pulses ? rad_per_arcsec : 1.0;
  counts.mps_per_unit = info.accel_increment == IncrementKind::pulses ? info.accel_pulse_mps : 1.0;
  return counts;
}

DriftCovariance::DriftCovariance(const Site& site, const NoiseModel& noise, const std::optional<CountsModel>& counts)
    : noise_(noise), counts_(counts) {
  const RadiiOfCurvature radii = radii_of_curvature(site.latitude_rad);
  const double c = std::cos(site.latitude_rad), s = std::sin(site.latitude_rad);
  F_.setZero();
  F_.block<3, 3>(phi, phi) = -skew(earth_rate_n(site.latitude_rad / rad_per_deg));
  F_(phi + 0, dv + 1) = 1.0 / radii.east_m;
  F_(phi + 1, dv + 1) = s / c / radii.east_m;
  F_(phi + 2, dv + 0) = -1.0 / radii.north_m;
  F_(phi + 0, dr + 0) = -earth_rate_radps * s / radii.north_m;
  F_(phi + 1, dr + 0) = earth_rate_radps * c / radii.north_m;
  F_(dv + 0, phi + 2) = site.gravity_mps2;
  F_(dv + 1, phi + 0) = -site.gravity_mps2;
  // Coriolis: (-2 w_ie x v), horizontal parts.
  F_(dv + 0, dv + 1) = -2.0 * earth_rate_radps * s;
  F_(dv + 1, dv + 0) = 2.0 * earth_rate_radps * s;
  F_(dr + 0, dv + 0) = 1.0;
  F_(dr + 1, dv + 1) = 1.0;
  for (int k = gyro_bias; k < drift_states; ++k) F_(k, k) = -1.0 / noise.bias_correlation_s;
}

void DriftCovariance::begin(double level_rad, double heading_rad) {
  P_.setZero();
  S_.setZero();
  P_.diagonal().segment<3>(phi) << level_rad * level_rad, heading_rad * heading_rad, level_rad * level_rad;
  P_.diagonal().segment<2>(dv).setConstant(noise_.accel_pulse_mps * noise_.accel_pulse_mps / 12.0);
  P_.diagonal().segment<3>(gyro_bias).setConstant(std::pow(noise_.gyro_bias_instability_radps, 2));
  P_.diagonal().segment<3>(accel_bias).setConstant(std::pow(noise_.accel_bias_instability_mps2, 2));
}

void DriftCovariance::advance(const Eigen::Matrix3d& C_nb, const MotionInterval& interval) {
  const double T = interval.duration_s;
  if (counts_) {
    const Eigen::Vector3d gyro = counts_->counts_of_gyro * (interval.gyro_rad + T * counts_->gyro_bias_radps);
    const Eigen::Vector3d accel = counts_->counts_of_accel * (interval.accel_mps + T * counts_->accel_bias_mps2);
    for (int i = 0; i < 3; ++i) {
      pending_turns_.middleCols<3>(3 * i) -= C_nb.col(i) * (counts_->rad_per_unit * gyro).transpose();
      pending_pushes_.middleCols<3>(3 * i) += C_nb.col(i) * (counts_->mps_per_unit * accel).transpose();
    }
  }
  pending_s_ += T;
  pending_C_ += T * C_nb;
  pending_gyro_ += T * C_nb * noise_.angle_random_walk.cwiseAbs2().asDiagonal() * C_nb.transpose();
  pending_accel_ += T * C_nb * noise_.velocity_random_walk.cwiseAbs2().asDiagonal() * C_nb.transpose();
  if (interval.missing > 0) {  // filled in: the remainder of their counts is unknown
    const double squares = double(interval.missing) * interval.missing / 12.0;
    pending_gyro_.diagonal().array() += squares * noise_.gyro_pulse_rad * noise_.gyro_pulse_rad;
    pending_accel_.diagonal().array() += squares * noise_.accel_pulse_mps * noise_.accel_pulse_mps;
  }
  if (pending_s_ >= step_s - 1e-9) settle();
}

void DriftCovariance::settle() {
  if (pending_s_ <= 0.0) return;
  DriftMatrix F = F_;
  F.block<3, 3>(phi, gyro_bias) = -pending_C_ / pending_s_;
  F.block<2, 3>(dv, accel_bias) = horizontal(pending_C_) / pending_s_;
  if (counts_) {
    // No parameter moves the states of the bias instability. Order of parameter_keys: N0, A0, n by rows, a by rows.
    using Moved = Eigen::Matrix<double, moved, parameter_count>;
    Moved input = Moved::Zero();
    input.block<3, 3>(phi, 0) = radps_per_degph * pending_C_;
    input.block<2, 3>(dv, 3) = -standard_gravity_mps2 * horizontal(pending_C_);
    input.block<3, 9>(phi, 6) = pending_turns_;
    input.block<1, 9>(dv, 15) = pending_pushes_.row(0);
    input.block<1, 9>(dv + 1, 15) = pending_pushes_.row(2);
    const Eigen::Matrix<double, moved, moved> F_moved = F_.topLeftCorner<moved, moved>();
    const Moved S = S_.topRows<moved>();
    S_.topRows<moved>() = propagated(F_moved, pending_s_, S) + input + (0.5 * pending_s_) * F_moved.lazyProduct(input);
    pending_turns_.setZero();
    pending_pushes_.setZero();
  }
  P_ = propagated(F, pending_s_, P_);
  P_.transposeInPlace();
  P_ = propagated(F, pending_s_, P_);
  P_.block<3, 3>(phi, phi) += pending_gyro_;
  const Eigen::Matrix<double, 2, 3> rows = horizontal(pending_accel_);
  P_.block<2, 2>(dv, dv) += (Eigen::Matrix2d() << rows.col(0), rows.col(2)).finished();
  // The noise that keeps a Gauss-Markov process stationary.
  const double gained = 2.0 * pending_s_ / noise_.bias_correlation_s;
  P_.diagonal().segment<3>(gyro_bias).array() += gained * std::pow(noise_.gyro_bias_instability_radps, 2);
  P_.diagonal().segment<3>(accel_bias).array() += gained * std::pow(noise_.accel_bias_instability_mps2, 2);
  pending_s_ = 0.0;
  pending_C_.setZero();
  pending_gyro_.setZero();
  pending_accel_.setZero();
}

DriftVector DriftCovariance::observe_rest(const Eigen::Vector2d& velocity_mps) {
  settle();
  // One pulse of quantisation; without counts, rounding.
  constexpr double least_mps = 1e-6;
  const double r = std::max(least_mps * least_mps, noise_.accel_pulse_mps * noise_.accel_pulse_mps / 12.0);
  const Eigen::Matrix<double, drift_states, 2> PH = P_.middleCols<2>(dv);
  const Eigen::Matrix2d innovation = PH.middleRows<2>(dv) + r * Eigen::Matrix2d::Identity();
  const Eigen::Matrix<double, drift_states, 2> gain = PH * innovation.inverse();
  P_ -= gain * PH.transpose();
  P_ = (0.5 * (P_ + P_.transpose())).eval();
  S_ -= gain * S_.middleRows<2>(dv).eval();
  return gain * velocity_mps;
}

void DriftCovariance::begin_navigation() {
  settle();
  P_.middleRows<2>(dr).setZero();
  P_.middleCols<2>(dr).setZero();
  S_.middleRows<2>(dr).setZero();
}

}  // namespace turncal
