// Noise measured, not assumed: maximum likelihood of the random walks and bias instability from the velocities at rest.
//
// The restricted likelihood of velocity_likelihood.h is maximised over
//   variances of the angle and of the velocity random walk (one a triad, or one an axis where the axes demonstrably
//   differ), of the gyro and of the accelerometer bias instability
// by Fisher scoring (variances are linear in the covariance; projected to non-negative values):
//   information_ij = sum 1/2 tr(S^-1 S_i S^-1 S_j) + nu_i' S^-1 nu_j
// Source: Harvey, Forecasting, Structural Time Series Models and the Kalman Filter (1989), 3.4 and 4.3.
// Quantisation is not fitted: the pulse is known. What is slower than the recording is not noise here but drift.
#pragma once

#include <string>
#include <vector>

#include "calib/joint/joint_filter.h"
#include "calib/model/noise_model.h"
#include "calib/statistics/compression.h"

namespace turncal {

struct NoiseFitOptions {
  bool random_walks = true;  // false: keep those of the start model (configured)
  bool bias_instability = true;
  bool near_start = false;  // the start model was fitted beside this: axes that agree in it are not looked at apart
  int max_iterations = 6;
  int seconds_together = 4;
};

struct NoiseFit {
  bool converged = false;
  NoiseModel noise;
  bool axes_differ = false;  // the axes of a triad got values of their own
  // one sigma of the fitted values, in the same order and units as in NoiseModel
  Eigen::Vector3d sigma_angle_random_walk = Eigen::Vector3d::Zero();
  Eigen::Vector3d sigma_velocity_random_walk = Eigen::Vector3d::Zero();
  double gyro_bias_instability_gain = 0.0;  // 2 (log L - log L without it)
  double accel_bias_instability_gain = 0.0;
  int evaluations = 0;
};

NoiseFit fit_noise(const CompressedRecording& recording, const Parameters& parameters, const EffectModel& effects,
                   const FilterSetup& setup, const NoiseFitOptions& options = {});

}  // namespace turncal
