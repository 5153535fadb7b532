// The prior of a unit from earlier calibrations: the distribution of its part in the fleet, and the unit's own history.
//
// Units u of one part scatter, p_u ~ N(mu, S), and a unit changes from one calibration to the next by N(0, W), W diagonal:
//   mu, S   mean and covariance of the newest estimates of U other units. A new unit has mean mu and covariance Sigma = S (1 + 1/U) (U-1)/(U-d-2),
//           whose inverse is unbiased (d = 21; Anderson, Multivariate Statistical Analysis, Wiley 2003, 7.7). With U < 3 d the variances alone are
//           used, d = 1. S includes the errors of the estimates, which makes it too wide.
//   W       W_kk = mean of (p_b - p_a)_k^2 - sigma_a^2 - sigma_b^2 over successive calibrations, at least 0; needs `least_prior_pairs` of them.
// The prior of the unit begins as mu, Sigma and takes in its earlier estimates in time order: information added, then W. It is
// combined with the recording, which has information A and gradient c at p_0:
//   Lambda = A + P^-1,  p = p_0 - Lambda^-1 (c + P^-1 (p_0 - m)),  share of the prior in k = 1 - (Lambda^-1)_kk / C_kk,  C = A^-1
// The unit has changed (without a history: differs from its fleet) if |d_k| > z sqrt((C + P)_kk), d = p_data - m, `false_alarm`
// of all 21 together (Bonferroni). Then the prior is not used.
//
// Not modelled: changes that grow with time; parameters that change together; a fleet of two kinds.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "calib/joint/joint_estimate.h"

namespace turncal {

// The noise class of a part: the noise measured in calibrations of its units, combined with that of a recording.
//
// For each random walk r_u is the logarithm of its rms over the axes. Units scatter, r_u ~ N(r, t^2): mean and variance of U units, the
// variance times (1 + 1/U)(U-1)/(U-3) as above; it includes the errors of the r_u. A recording has measured r_0 with sigma_0 (noise_fit.h):
//   r = (r_0 / sigma_0^2 + r_class / t^2) / (1 / sigma_0^2 + 1 / t^2),   share of the class = sigma_0^2 / (sigma_0^2 + t^2)
// and all axes of the triad are scaled alike. A recording whose noise differs by more than chance keeps its own, and is reported. If most
// units of the part have a bias instability that the recording does not show, it gets their median.
//
// Not modelled: axes of a triad that differ in all units of the part; noise that grows with age.
struct NoiseClass {
  // Of the logarithm, for a new unit: angle, velocity random walk.
  double mean[2] = {0.0, 0.0}, sigma[2] = {0.0, 0.0};
  double gyro_bias_instability_radps = 0.0, accel_bias_instability_mps2 = 0.0;  // 0: most units show none
  std::size_t units = 0;
};

// `units`: one noise model per unit. None with fewer than least_prior_units (limits.h).
std::optional<NoiseClass> noise_class(const std::vector<NoiseModel>& units);

struct NoiseOfClass {
  NoiseModel noise;
  double share[2] = {0.0, 0.0};  // of the class: angle, velocity random walk
  double z[2] = {0.0, 0.0};      // distance of the recording's own from the class
  std::vector<int> changed;      // 0, 1: those with z beyond chance, `false_alarm` of both together
};
NoiseOfClass noise_of_class(const NoiseClass& of_part, const NoiseFit& own, double false_alarm = 0.01);

// Returns `estimate` fitted again with that noise. Its covariance keeps the part of an unseen instability, unless both
// triads have one now. REQUIRES: an estimate of this recording that leaves no direction open.
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
  std::size_t units = 0;       // number of other units
  std::size_t own = 0;         // number of earlier calibrations of the unit itself
  std::size_t pairs = 0;       // successive calibrations, from which W is estimated
  std::optional<NoiseClass> noise;
};

// None with fewer units than least_prior_units. With fewer pairs than least_prior_pairs (limits.h) the unit's own history is left out.
std::optional<FleetPrior> fleet_prior(std::vector<EarlierCalibration> history, const std::string& unit);

struct PriorEffect {
  ParameterVector share = ParameterVector::Zero();       // part of the information on each that is the prior's
  ParameterVector from_prior = ParameterVector::Zero();  // z of the data's value; 0 if not determined
  std::vector<int> changed;                              // parameters
};

// Combines an estimate without effects with the prior, unless something has changed. REQUIRES: converged.
PriorEffect use_prior(const FleetPrior& prior, JointResult& estimate, double false_alarm = 0.01);

}  // namespace turncal
