// How likely the velocities at rest are under a noise model: what noise_fit.h maximises.
//
// At given parameters the recording is navigated once, open loop, and cut into intervals of a few static seconds and one
// interval for everything between two dwells. Over these the error state (psi, v, b_g, b_a of joint_filter.h) is linear, so
// any noise model is one pass of a small Kalman filter over some 1500 intervals:
//   -2 log L = sum log det S + nu' S^-1 nu
// The parameters were fitted to the same velocities, which makes those look quieter than they are. The restricted
// likelihood counts that: it integrates over the parameters instead of fixing them,
//   -2 log L_R = -2 log L + log det(A + R^-2),   A = sum N' S^-1 N
// with N the derivatives of the innovations by the 21 free parameters and R the ranges they are believed in.
// Sources: Harvey, Forecasting, Structural Time Series Models and the Kalman Filter (1989), 3.4 and 4.3; Patterson and
// Thompson, Biometrika 58 (1971) 545 for the restricted likelihood.
#pragma once

#include <array>
#include <vector>

#include <Eigen/Core>

#include "calib/joint/joint_filter.h"
#include "calib/statistics/compression.h"

namespace turncal {

inline constexpr int noise_sources = 8;  // variances of ARW x y z, VRW x y z, gyro and accelerometer bias instability
using NoiseVariances = Eigen::Matrix<double, noise_sources, 1>;  // rad^2/s, m^2/s^3, rad^2/s^2, m^2/s^4

inline constexpr int free_parameter_count = 21;

class VelocityLikelihood {
 public:
  // `ranges`: of the 24 parameters in file units (plausible_ranges()).
  VelocityLikelihood(const CompressedRecording& recording, const Parameters& parameters, const EffectModel& effects,
                     const FilterSetup& setup, const ParameterVector& ranges, int seconds_together);

  struct Run {
    double value = 0.0;                // -2 log L, or -2 log L_R
    double log_det_information = 0.0;  // restricted only
    std::vector<Eigen::Vector3d> nu;   // innovations and their covariance
    std::vector<Eigen::Matrix3d> S;
  };
  Run run(const NoiseVariances& variances, double tau_b, bool restricted) const;

 private:
  using Matrix6 = Eigen::Matrix<double, 6, 6>;
  using Columns3 = Eigen::Matrix<double, 3, free_parameter_count>;
  using Columns6 = Eigen::Matrix<double, 6, free_parameter_count>;

  struct Interval {
    bool observed = false;
    double t = 0.0;
    double cut_tilt = 0.0, cut_heading = 0.0, cut_velocity = 0.0;  // variances added before the interval (a break)
    // observed: evaluated from these
    Eigen::Matrix3d C, F, turn;
    Eigen::Vector3d y = Eigen::Vector3d::Zero();  // open-loop mean velocity: should be zero
    Columns3 dy;                                  // its derivatives by the free parameters, in units of their ranges
    Eigen::Vector3d quantisation = Eigen::Vector3d::Zero();
    // not observed: transition of (psi, v), of the biases into it, and the noise of each unit walk
    Matrix6 phi = Matrix6::Identity();
    Matrix6 gamma = Matrix6::Zero();
    std::array<Matrix6, 6> q{};
  };

  void derivatives(const Block& block, const BlockMotion& motion, const SensorModel& model);
  void move_on(const BlockMotion& motion, const Eigen::Matrix3d& F, const Eigen::Matrix3d& turn_n, double t);
  void add_motion(const Block& block, const BlockMotion& motion, const SensorModel& model, Interval& interval);

  std::vector<Interval> intervals_;
  FilterSetup setup_;
  Eigen::Matrix3d C_nb_;
  Eigen::Vector3d v_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d earth_;
  double gravity_;
  ParameterVector unit_;           // SI value of a range
  Columns6 X_ = Columns6::Zero();  // d(psi, v)/d(parameters), open loop
  Columns3 dr_, dv_, dm_;          // of the block at hand, body frame
  BlockColumns columns_;
};

}  // namespace turncal
