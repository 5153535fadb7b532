// What earlier calibrations say of a unit before its recording is read: the fleet's distribution of its part, and its own history.
//
// Units u of one part scatter, p_u ~ N(mu, S), and a unit changes from one calibration to the next by N(0, W), W diagonal:
//   mu, S   mean and covariance of the newest estimate of U other units. A unit to come is at mu with Sigma = S (1 + 1/U) (U-1)/(U-d-2), whose
//           inverse is in the mean that of the truth (d = 21; Anderson, Multivariate Statistical Analysis, Wiley 2003, 7.7). With U < 3 d the
//           variances alone, d = 1. Errors of the estimates are part of S, which makes it too wide.
//   W       W_kk = mean of (p_b - p_a)_k^2 - sigma_a^2 - sigma_b^2 over calibrations that follow each other, not below 0; of `least_prior_pairs` at least.
// The prior of the unit is mu, Sigma, then each of its earlier estimates in time: information added, then W. It is combined with the recording,
// which has information A and gradient c at p_0:
//   Lambda = A + P^-1,  p = p_0 - Lambda^-1 (c + P^-1 (p_0 - m)),  share of the prior in k = 1 - (Lambda^-1)_kk / C_kk,  C = A^-1
// The unit has changed (without a history: is unlike its fleet) where |d_k| > z sqrt((C + P)_kk), d = p_data - m, `false_alarm` of all 21 together
// (Bonferroni). Then the prior is not used.
//
// Not modelled: changes that grow with time; parameters that change together; a fleet of two kinds.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "calib/joint/joint_estimate.h"

namespace turncal {

// The noise of a part, as the calibrations of its units have measured it, and what it makes of a recording's own.
//
// Of each random walk the logarithm r_u of its rms over the axes, units u scatter: r_u ~ N(r, t^2), mean and variance of U units, the variance
// times (1 + 1/U)(U-1)/(U-3) as above; errors of the r_u are part of it. A recording has measured r_0 with sigma_0 (noise_fit.h):
//   r = (r_0 / sigma_0^2 + r_class / t^2) / (1 / sigma_0^2 + 1 / t^2),   share of the class = sigma_0^2 / (sigma_0^2 + t^2)
// and all axes of the triad go with it. A recording whose noise differs by more than chance allows keeps its own, and is named.
// A bias instability that the recording cannot see, and most units of the part have, is the median of theirs.
//
// Not modelled: axes of a triad that differ in all units of the part; noise that grows with age.
struct NoiseClass {
  // Of the logarithm, of a unit to come: angle, velocity random walk.
  double mean[2] = {0.0, 0.0}, sigma[2] = {0.0, 0.0};
  double gyro_bias_instability_radps = 0.0, accel_bias_instability_mps2 = 0.0;  // 0: most units show none
  std::size_t units = 0;
};

// One of each unit. Empty with fewer than least_prior_units (limits.h).
std::optional<NoiseClass> noise_class(const std::vector<NoiseModel>& units);

struct NoiseOfClass {
  NoiseModel noise;
  double share[2] = {0.0, 0.0};  // of the class: angle, velocity random walk
  double z[2] = {0.0, 0.0};      // of the recording's own from the class
  std::vector<int> changed;      // 0, 1: those whose z is beyond chance, `false_alarm` of both together
};
NoiseOfClass noise_of_class(const NoiseClass& of_part, const NoiseFit& own, double false_alarm = 0.01);

// `estimate` again with that noise: one step beside it. What an instability too small to be seen adds to its covariance stays.
// REQUIRES: an estimate of this recording that leaves no direction open.
JointResult estimate_with_noise(const CompressedRecording& recording, const JointResult& estimate,
                                const NoiseModel& noise);

struct EarlierCalibration {
  std::string unit;
  std::string time_utc;  // of the measurement; sorts
  ParameterVector value = ParameterVector::Zero();
  Eigen::MatrixXd covariance;       // 24 x 24
  std::optional<NoiseModel> noise;  // as it was measured
};

struct FleetPrior {
  ParameterVector mean = ParameterVector::Zero();
  Eigen::MatrixXd covariance;  // 24 x 24; fixed parameters: zero
  std::size_t units = 0;       // others
  std::size_t own = 0;         // earlier calibrations of the unit that are in it
  std::size_t pairs = 0;       // calibrations that follow each other: what W is from
  std::optional<NoiseClass> noise;
};

// Empty with fewer units than least_prior_units. With fewer pairs than least_prior_pairs (limits.h) the unit's own history is left out.
std::optional<FleetPrior> fleet_prior(std::vector<EarlierCalibration> history, const std::string& unit);

struct PriorEffect {
  ParameterVector share = ParameterVector::Zero();  // of the information on each, from the prior
  ParameterVector from_prior =
      ParameterVector::Zero();  // z of what the data alone say; 0 where they do not determine it
  std::vector<int> changed;     // parameters
};

// What the prior makes of an estimate without effects. `estimate` has both in it unless something has changed. REQUIRES: converged.
PriorEffect use_prior(const FleetPrior& prior, JointResult& estimate, double false_alarm = 0.01);

}  // namespace turncal
