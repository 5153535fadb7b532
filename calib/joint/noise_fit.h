// Noise measured, not assumed: maximum likelihood of the random walks and bias instability from the velocities at rest.
//
// The likelihood is that of the joint filter on the recording linearised once (linear_motion.h): each noise model costs one pass
// over some 1500 intervals. The parameters were fitted to the same velocities, which makes these look too quiet; the restricted
// likelihood (Patterson and Thompson, Biometrika 58 (1971) 545) integrates over the parameters and over every chain's attitude:
//   -2 log L_R = sum (nu' S^-1 nu + log det S) - c' A^-1 c + log det(A + R^-2)
// with A, c information and gradient of the parameters and R their plausible ranges. It is maximised over the variances of both walks (one
// a triad, or one an axis where the axes demonstrably differ) and of both bias instabilities by Fisher scoring (Harvey, Forecasting,
// Structural Time Series Models and the Kalman Filter (1989), 3.4 and 4.3), projected to non-negative values:
//   information_ij = sum 1/2 tr(S^-1 S_i S^-1 S_j) + nu_i' S^-1 nu_j
// The walks come first: six states, not twelve. At their optimum one run for each variance says whether an instability, or a value an
// axis, promises enough to be looked for. An instability is kept when the likelihood ratio justifies it: its variance stands on its bound,
// so twice the gain is half zero and half chi-square of one degree (Self and Liang, J. Am. Stat. Ass. 82 (1987) 605).
// One that is not kept may exist all the same (a flicker of 0.3 ug makes the sigma of an accelerometer bias a fifth
// larger), so the covariance is averaged over its possible sizes (law of total variance):
//   C + dC,  dC = sum w_k (C_k - C + (x_k - x)(x_k - x)'),  w_k ~ L_R(s_k) / (1 + (s_k / s_0)^2),  s_k up to 6 s_0
// s in units of ARW / sqrt(tau_b). The prior is half-Cauchy (Gelman, Bayesian Analysis 1 (2006) 515) with s_0 = 0.2 for gyros and 0.5 for
// accelerometers: data sheets say 0.1 to 0.4 for ring lasers, 0.6 to 4 for quartz.
// Quantisation is not fitted: the pulse is known. What is slower than the recording is not noise here but drift.
#pragma once

#include <array>
#include <vector>

#include "calib/joint/joint_filter.h"
#include "calib/statistics/allan.h"

namespace turncal {

struct NoiseFitOptions {
  bool bias_instability = true;
  bool near_start = false;  // the start model comes from a similar fit: axes equal in it are not tested apart
};

struct NoiseFit {
  bool converged = false;
  NoiseModel noise;
  bool axes_differ = false;  // the axes of a triad got values of their own
  // one sigma of the fitted values, in the same order and units as in NoiseModel
  Eigen::Vector3d sigma_angle_random_walk = Eigen::Vector3d::Zero();
  Eigen::Vector3d sigma_velocity_random_walk = Eigen::Vector3d::Zero();
  Eigen::MatrixXd unseen_instability;  // dC of `free`, to be added to their covariance; file units; 0 if near_start
  int evaluations = 0;
};

// Fits the noise. `free`: the estimated columns, of [24 parameters, effects]; `ranges`: of all columns, in their units.
NoiseFit fit_noise(const CompressedRecording& recording, const Parameters& parameters, const EffectModel& effects,
                   const FilterSetup& setup, const std::vector<int>& free, const Eigen::VectorXd& ranges,
                   const NoiseFitOptions& options = {});

// The scale factors n11 n22 n33 a11 a22 a33, as indices into the 24.
inline constexpr std::array<int, 6> scale_factor_parameters = {6, 10, 14, 15, 19, 23};

// Returns the bias of the gradient due to the noise of the counts (errors in variables), to be subtracted; of the 24
// parameters. The derivative by a scale factor n contains nu_i / n, nu_i the part of the innovations from sensor i's
// noise. So E sum N' S^-1 nu = (d log det S / d log s_i) / n, not 0, with s_i its variance: scale factors come out too
// small, by a sigma at 3 deg/sqrt(h). `free`: the estimated columns, with their covariance; file units.
Eigen::VectorXd pull_of_noise(const CompressedRecording& recording, const Parameters& parameters,
                              const EffectModel& effects, const FilterSetup& at, const std::vector<int>& free,
                              const Eigen::MatrixXd& covariance);

// Returns the noise to begin with: read off the static dwells, and at least 0.02 pulses / sqrt(s).
NoiseModel start_noise(const CompressedRecording& recording, const AllanResult& allan, const Parameters& from);

}  // namespace turncal
