// Noise measured, not assumed: maximum likelihood of the random walks and bias instability from the velocities at rest.
//
// The likelihood is that of the joint filter itself (joint_filter.h), on the recording as navigated in closed loop and made
// linear once (linear_motion.h): any noise model is then one pass over some 1500 intervals. The parameters were fitted to
// the same velocities, which makes those look quieter than they are; the restricted likelihood counts that, integrating
// over parameters (and every chain's attitude, which is diffuse) instead of fixing them:
//   -2 log L_R = sum (nu' S^-1 nu + log det S) - c' A^-1 c + log det(A + R^-2)
// with A, c information and gradient of the parameters and R their plausible ranges. It is maximised over
//   variances of the angle and of the velocity random walk (one a triad, or one an axis where the axes demonstrably
//   differ), of the gyro and of the accelerometer bias instability
// by Fisher scoring (variances are linear in the covariance; projected to non-negative values):
//   information_ij = sum 1/2 tr(S^-1 S_i S^-1 S_j) + nu_i' S^-1 nu_j
// The walks come first, without instability: six states, not twelve. At their optimum one run for each variance gives gradient and
// information of all, and where the quadratic promises too little for an instability, or for a value an axis, it is not looked for.
// A bias instability is kept only when the likelihood ratio justifies it. The variance stands on its bound when there is
// none, so twice the gain is half zero and half chi-square of one degree (Self and Liang, J. Am. Stat. Ass. 82 (1987) 605).
// One that is not kept may be there all the same: in two hours of 8 ug/sqrt(Hz) a flicker of 0.3 ug hardly shows, and yet
// makes the sigma of an accelerometer bias a fifth larger. So the covariance is averaged over what it may be,
//   C + dC,  dC = sum w_k (C_k - C + (x_k - x)(x_k - x)'),  w_k ~ L_R(s_k) / (1 + (s_k / s_0)^2),  s_k up to 6 s_0
// s in units of ARW / sqrt(tau_b), the instability that matters in tau_b as much as the walk. The prior is half-Cauchy (Gelman, Bayesian
// Analysis 1 (2006) 515, on a variance component) with s_0 = 0.2 for gyros and 0.5 for accelerometers: data sheets say 0.1 to 0.4
// for ring lasers, 0.6 to 4 for quartz, and what is large shows. The rest is the law of total variance.
// Sources: Harvey, Forecasting, Structural Time Series Models and the Kalman Filter (1989), 3.4 and 4.3; Patterson and
// Thompson, Biometrika 58 (1971) 545 for the restricted likelihood.
// Quantisation is not fitted: the pulse is known. What is slower than the recording is not noise here but drift.
#pragma once

#include <string>
#include <vector>

#include "calib/joint/joint_filter.h"
#include "calib/model/noise_model.h"
#include "calib/model/parameters.h"
#include "calib/statistics/allan.h"
#include "calib/statistics/compression.h"

namespace turncal {

struct NoiseFitOptions {
  bool random_walks = true;  // false: keep those of the start model (configured)
  bool bias_instability = true;
  bool near_start = false;  // the start model was fitted beside this: axes that agree in it are not looked at apart
  int max_iterations = 6;
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
  Eigen::MatrixXd unseen_instability;  // dC of `free`, to be added to their covariance; file units; not near_start
  int evaluations = 0;
};

// `free`: the columns that are estimated, of [24 parameters, effects]; `ranges`: of all columns, in their units.
NoiseFit fit_noise(const CompressedRecording& recording, const Parameters& parameters, const EffectModel& effects,
                   const FilterSetup& setup, const std::vector<int>& free, const Eigen::VectorXd& ranges,
                   const NoiseFitOptions& options = {});

// What the noise of the counts does to the gradient.
// The noise of the counts goes into the derivatives, too: those by a scale factor n hold nu_i / n, nu_i what sensor i's noise makes of
// the innovations, and E sum N' S^-1 nu = sum tr(S^-1 cov nu_i) / n = (d log det S / d log s_i) / n with s_i its variance, not 0:
// scale factors come out too small, by a sigma at 3 deg/sqrt(h) (errors in variables). This is what is to be taken off the gradient.
// `free`: the columns that are estimated, with their covariance; file units. Of the 24 parameters.
Eigen::VectorXd pull_of_noise(const CompressedRecording& recording, const Parameters& parameters,
                              const EffectModel& effects, const FilterSetup& at, const std::vector<int>& free,
                              const Eigen::MatrixXd& covariance);

// The noise that a joint estimate begins with.
// The noise to begin with: read off the static dwells, never below what a tenth of a pulse in a second would make.
NoiseModel start_noise(const CompressedRecording& recording, const AllanResult& allan, const Parameters& from);

}  // namespace turncal
