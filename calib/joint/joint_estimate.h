// The joint estimate: all free parameters (and any effects asked for) from every static second of a recording.
//
// Gauss-Newton on run_filter() (joint_filter.h) until no parameter moves by a hundredth of its sigma:
//   step = -A^-1 c,  A = sum N' S^-1 N,  covariance = A^-1 + what an instability too small to be seen may add
// with the noise measured on the way (allan.h for the start, noise_fit.h for the values) unless it is given. Directions of
// parameter space that the recording does not determine are named, not solved for: an eigenvector of A in units of
// plausible ranges whose sigma is more than a tenth of the range.
//
// Bad data never pass as good: gaps, invalid samples and glitches seen by the Compressor, and single static seconds whose
// innovation no noise explains, cut the chain there (Break): what came before no longer speaks for what comes after.
// Free: N0 (3), A0 (3), n (9), a (6); a21 = a31 = a32 = 0 by the choice of the body frame.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "calib/joint/joint_filter.h"
#include "calib/joint/joint_start.h"
#include "calib/joint/noise_fit.h"
#include "calib/model/effects.h"
#include "calib/statistics/allan.h"

namespace turncal {

struct JointResult;

struct JointOptions {
  std::optional<Parameters> start;        // default: start_parameters()
  std::optional<NoiseModel> noise;        // given: not fitted
  std::optional<NoiseModel> start_noise;  // where the fit begins; default: read off the Allan deviation
  bool fit_bias_instability = true;
  std::vector<EffectColumn> effects;              // estimated together with the 21
  Eigen::VectorXd start_effects;                  // of the effects; default: zero
  bool fixed_effects = false;                     // they stay at start_effects
  std::vector<EffectColumn> candidates;           // columns of the last pass only
  std::optional<double> reference_temperature_c;  // default: the mean of the recording
  std::vector<char> unobserved;                   // blocks left out (hold-out), see FilterSetup
  // Which of the 24 are estimated; default: the 21 free ones.
  std::optional<std::vector<int>> free_parameters;
  bool look_for_faults = true;
  const JointResult* faults_of = nullptr;  // given: its faults and breaks are taken over, none are looked for
  // With faults_of and noise: one Gauss-Newton step from that fit, parameters and effects' values alone (left-out dwells).
  bool one_step = false;
  int max_iterations = 15;
};

struct Fault {                                     // where the chain was cut, and why
  std::int64_t first_sample = 0, last_sample = 0;  // the fault lies in [first, last]
  std::size_t block = 0;
  std::string what;    // "gap of 1 sample", "velocity step of -0.049 m/s up ...", ...
  std::string action;  // "leg set aside", "velocity started anew"
};

struct Undetermined {  // one direction of parameter space
  std::vector<std::pair<std::string, double>>
      combination;  // key, weight (largest first, in file units, norm 1 in ranges)
};

struct Whiteness {
  bool white = false;
  double level = 0.0;               // mean square of the normalised innovations; 1 when the noise model is right
  Eigen::VectorXd autocorrelation;  // lags 1 .. 5 s, mean of the three components
  std::string message;
};

struct EstimatedEffect {
  EffectColumn column;
  double value = 0.0;
  double sigma = 0.0;
};

struct JointResult {
  bool converged = false;
  std::string message = "not run";
  int iterations = 0;
  Parameters parameters;
  ParameterVector sigma = ParameterVector::Zero();  // file units; 0 for the three fixed and for undetermined ones
  std::vector<bool> determined = std::vector<bool>(parameter_count, false);
  std::vector<EstimatedEffect> effects;
  std::vector<int> free;  // indices into [24 parameters, effects] of the covariance's rows
  Eigen::MatrixXd covariance;
  Eigen::MatrixXd unseen_instability;  // what of it a bias instability too small to be kept accounts for (noise_fit.h)
  double reference_temperature_c = 0.0;  // of temperature effects
  NoiseModel noise;
  std::optional<NoiseFit> noise_fit;
  AllanResult allan;
  Whiteness whiteness;
  std::vector<Fault> faults;
  std::vector<Undetermined> undetermined;
  Eigen::VectorXd ranges;  // plausible_ranges() and those of the effects
  JointStart start;
  FilterSetup setup;            // as used in the last pass
  FilterResult last;            // information with candidate columns after the effects
  double normalised_rms = 0.0;  // root of the mean square normalised innovation
};

JointResult joint_estimate(const CompressedRecording& recording, const JointOptions& options = {});

// Another recording of the same unit, switched on anew: its own heading and six biases; everything else as estimated from
// the first, at `noise`. What a hold-out is judged with: its `last` has the innovations, its `setup` the breaks.
JointResult fit_biases(const CompressedRecording& recording, const JointResult& of_unit, const NoiseModel& noise);

// Ranges (file units) that a parameter must be known far better than to count as determined: what the noise would let a
// run as long, at the best positions, determine, times 500 (N0), 1e5 (A0, a) and 2e4 (n), between what a unit of
// navigation grade and the worst of sensors can be off.
ParameterVector plausible_ranges(const NoiseModel& noise, double static_s);
// Least-squares step and covariance of a subset of the columns of `result`, with undetermined directions left out.
struct SubsetSolution {
  Eigen::VectorXd step;  // of the subset, zero along undetermined directions
  Eigen::MatrixXd covariance;
  Eigen::MatrixXd undetermined;  // columns: directions in units of the ranges
  // Of the subset, 1: takes part in an undetermined direction by a tenth and more, or by so little and yet enough to be
  // moved by more than half the sigma it has from the determined ones. Its step and covariance say nothing.
  std::vector<char> lost;
};
SubsetSolution solve_subset(const Eigen::MatrixXd& information, const Eigen::VectorXd& gradient,
                            const std::vector<int>& subset, const Eigen::VectorXd& ranges);
Whiteness test_whiteness(const std::vector<Innovation>& innovations);

}  // namespace turncal
