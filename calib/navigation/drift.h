// How the error of a free inertial navigation grows: from sensor noise, and from the parameter errors that the calibration left.
//
// Error state (phi: C_computed = (I - [phi x]) C_true, as in docs/estimator.md; north, up, east):
//   x = [phi (3, rad), dv_N, dv_E (m/s), dr_N, dr_E (m), bias instability of gyros (3, rad/s) and accelerometers (3, m/s^2)]
//   phi'  = -w_ie x phi + dw_in - C dw_b      dw_in = (dv_E / R, dv_E tan L / R, -dv_N / R) + dw_ie/dL dr_N / R
//   dv_N' = g phi_E + (C df_b)_N,  dv_E' = -g phi_N + (C df_b)_E,  dr' = dv
// (Titterton and Weston (2004), 12.3, at low speed; the vertical channel is shut.) dw_b = dn counts - dN0, df_b = da counts - dA0.
//
// Each of the 24 parameters has a sensitivity column dx/dp that goes through the same equations and, while aligning, through the
// same gains (Schmidt's consider form): of a gyro bias that alignment absorbs as heading error only the remainder shows.
//   covariance = P(noise) + S cov(parameters) S'
//
// n samples filled in within an interval add n q / sqrt(12) to attitude and velocity, q the pulse, so that many single gaps show.
//
// Units: parameters in file units (parameters.h), the rest SI. Not modelled: effects beyond the 24, rate random walk, gravity,
// lever arms.
#pragma once

#include <optional>

#include <Eigen/Core>

#include "calib/model/parameters.h"
#include "calib/navigation/mechanisation.h"

namespace turncal {

inline constexpr int drift_states = 13;
using DriftVector = Eigen::Matrix<double, drift_states, 1>;
using DriftMatrix = Eigen::Matrix<double, drift_states, drift_states>;
using DriftSensitivity = Eigen::Matrix<double, drift_states, parameter_count>;

// Recovers counts from calibrated increments: counts = n^-1 (dtheta + N0 T), with everything in SI and file units.
struct CountsModel {
  Eigen::Matrix3d counts_of_gyro;   // counts a rad
  Eigen::Matrix3d counts_of_accel;  // counts a m/s
  Eigen::Vector3d gyro_bias_radps;
  Eigen::Vector3d accel_bias_mps2;
  double rad_per_unit = 1.0;  // of n: rad a count for one file unit
  double mps_per_unit = 1.0;  // of a
};
CountsModel counts_model(const Parameters& parameters, const RecordingInfo& info);

class DriftCovariance {
 public:
  struct Site {
    double latitude_rad = 0.0;
    double gravity_mps2 = 0.0;
  };
  // Without `counts` there are no sensitivities.
  DriftCovariance(const Site& site, const NoiseModel& noise, const std::optional<CountsModel>& counts);

  // Before alignment: attitude known to these sigmas (level, heading, rad), velocity to a pulse, position exactly.
  void begin(double level_rad, double heading_rad);
  // Propagates over one interval; `C_nb` in its middle.
  void advance(const Eigen::Matrix3d& C_nb, const MotionInterval& interval);

  // Observes a horizontal velocity of zero; `velocity`: the computed one, north and east. Returns the estimated error
  // of the state, to be subtracted, and updates covariance and sensitivities.
  DriftVector observe_rest(const Eigen::Vector2d& velocity_mps);

  // Sets the position as known; attitude and velocity keep their covariance.
  void begin_navigation();

  const DriftMatrix& noise_covariance() const { return P_; }
  const DriftSensitivity& sensitivity() const { return S_; }
  DriftMatrix covariance(const ParameterCovariance& of_parameters) const {
    return P_ + S_ * of_parameters * S_.transpose();
  }

 private:
  void settle();  // propagates up to now

  NoiseModel noise_;
  std::optional<CountsModel> counts_;
  DriftMatrix F_;
  DriftMatrix P_ = DriftMatrix::Zero();
  DriftSensitivity S_ = DriftSensitivity::Zero();
  // P and S are propagated a second at a time.
  double pending_s_ = 0.0;
  Eigen::Matrix3d pending_C_ = Eigen::Matrix3d::Zero();  // time integral of C_nb
  // Sums of C counts': rotation by one unit of n (by rows), change of velocity by one unit of a, n frame.
  Eigen::Matrix<double, 3, 9> pending_turns_ = Eigen::Matrix<double, 3, 9>::Zero(), pending_pushes_ = pending_turns_;
  Eigen::Matrix3d pending_gyro_ = Eigen::Matrix3d::Zero();  // of C diag(noise^2) C'
  Eigen::Matrix3d pending_accel_ = Eigen::Matrix3d::Zero();
};

}  // namespace turncal
