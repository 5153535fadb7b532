// The random errors of the sensors as the joint estimator weighs them (names of IEEE 952 and 1293).
//
// Angle random walk N_g: white noise of the rate, variance N_g^2 dt of the angle over dt. Velocity random walk N_a likewise.
// Bias instability: a first-order Gauss-Markov process on each axis with standard deviation sigma_b and correlation time
// tau_b, the usual state-space stand-in for flicker noise. With tau_b = 300 s a run of two hours that holds 1/f noise gets
// biases whose sigma is their spread (docs/accuracy.md: 100 s gives 0.6 of it, 600 s 1.4 times).
// Quantisation: the cumulative count is short of the true angle or velocity by an error of up to one pulse, variance q^2/12.
// Not modelled: rate ramps (they are effects: drift, warm-up), noise that depends on rate or specific force.
#pragma once

#include <Eigen/Core>

namespace turncal {

struct NoiseModel {
  Eigen::Vector3d angle_random_walk = Eigen::Vector3d::Constant(5.8e-7);     // rad/sqrt(s)
  Eigen::Vector3d velocity_random_walk = Eigen::Vector3d::Constant(7.8e-5);  // m/s/sqrt(s)
  double gyro_bias_instability_radps = 0.0;  // sigma_b of the Gauss-Markov process; 0 switches it off
  double accel_bias_instability_mps2 = 0.0;
  double bias_correlation_s = 300.0;  // tau_b
  bool has_bias_instability() const { return gyro_bias_instability_radps > 0.0 || accel_bias_instability_mps2 > 0.0; }
  double gyro_pulse_rad = 0.0;  // one-pulse quantisation; 0 for data that are not counted
  double accel_pulse_mps = 0.0;
};

// 1 deg/sqrt(h) in rad/sqrt(s); 1 ug/sqrt(Hz) in m/s/sqrt(s)
inline constexpr double radprs_per_degprh = 3.14159265358979323846 / 180.0 / 60.0;
inline constexpr double mpsprs_per_ugprHz = 9.80665e-6;

}  // namespace turncal
