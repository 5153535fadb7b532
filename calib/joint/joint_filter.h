// One pass of the joint estimator: a Kalman filter for the error of the navigated motion, with a column for every parameter.
//
// linear_motion.h navigates the recording and gives it as a linear system; in every second at rest the mean velocity is
// observed to be zero. The filter's state is (psi, v) and, where the noise has bias instability, (b_g, b_a): 6 or 12. What
// the parameters do to it is carried as X = d(state)/d(parameters) through the same transitions and the same gains:
//   predict  X <- Phi X + B,   innovation derivative  N = H X + D,   update  X <- X - K N
// so that sum over seconds of N' S^-1 N and N' S^-1 nu are the information matrix and vector of generalised least squares
// for all parameters and all candidate effects at once (the augmented Kalman filter: P. de Jong, The Diffuse Kalman
// Filter, Ann. Stat. 19 (1991); with the prediction-error view of Ljung, System Identification, 2nd ed., ch. 7).
//
// The mean velocity over a second shares its noise with the state at the end of the second; the update uses the cross
// covariance, so no white noise is counted twice. Attitude and heading are diffuse at the beginning of every chain: they
// are estimated, and neither the given heading nor a table angle is believed.
// Gravity is constant and the station does not move: no Schuler loop, no Coriolis term (v is a few cm/s at most).
#pragma once

#include <cstdint>
#include <vector>

#include <Eigen/Core>

#include "calib/model/effects.h"
#include "calib/model/parameters.h"
#include "calib/statistics/block_motion.h"

namespace turncal {

// The motion is not trusted across this block: the variance of attitude and velocity is raised before it. When nothing is
// known of the attitude any more, the chain ends: the next rest levels anew and has a heading of its own.
struct Break {
  std::size_t block = 0;
  double attitude_sigma_rad = 1.0;
  double velocity_sigma_mps = 1.0;
  bool begins_recording = false;  // another recording of the unit: nothing is known, the biases' wander included
  bool nothing_is_known() const { return attitude_sigma_rad > 0.02; }
};

struct FilterSetup {
  NoiseModel noise;
  double initial_tilt_sigma_rad = 0.2;  // levelled on one second with parameters that may be far off
  double initial_heading_sigma_rad = 1.0;
  double initial_velocity_sigma_mps = 1e-3;
  Eigen::Matrix3d mounting = Eigen::Matrix3d::Identity();  // C_nb = C(table angles) mounting
  // Heading about which each chain is linearised, added to the commanded one; missing entries equal the first.
  std::vector<double> headings_rad;
  bool with_columns = true;  // false: only the innovations
  bool keep_innovations = false;
  bool keep_taken_off = false;   // for applying effects
  bool keep_steps = false;       // for tests of lack of fit: the same filter can be run backward
  std::vector<Break> breaks;     // in block order
  std::vector<char> unobserved;  // a block marked 1 is not observed though it is a static second (left-out dwells)
};

// A recording in fewer blocks, for passes that need not look at every second.
//
// Blocks merge exactly (merge() of compression.h); only the place of an event within a longer interval is lost. At rest
// the velocity random walk dominates the mean velocity over t seconds until about 20 s, where the angle random walk
// takes over: single seconds in the middle of a dwell add little. Those beside a turn determine the velocity at its
// ends and stay as they are: the interval that begins s seconds after a turn, or ends s before the next, is at most
// max(1, s) long. In turns the formulas of block_motion.h hold up to about 0.1 rad a block. Steady turns already come
// in long blocks (compression.h); merging affects the beginning and end of a turn. Nothing is merged across the border
// of a segment, a gap, a Break or a change of FilterSetup::unobserved.
struct Coarseness {
  double rest_s = 8.0;    // longest interval at rest
  double turn_rad = 0.0;  // blocks of a turn together turn the unit by this much; 0: they stay as they are
};
// For scoring hundreds of columns, and pieces of rest. Named effects are fitted on every second.
inline constexpr Coarseness coarseness_of_scores = {8.0, 0.0};
// Merges blocks. `setup`: its breaks and unobserved blocks become those of the coarser recording.
CompressedRecording coarser(const CompressedRecording& recording, const Coarseness& coarseness, FilterSetup& setup);

// One static second as the filter saw it.
struct Innovation {
  std::size_t block = 0;
  double time_s = 0.0;                // middle of the second, from the first sample
  Eigen::Vector3d velocity_mps;       // predicted mean velocity, n frame: what should have been zero
  Eigen::Vector3d normalised;         // L^-1 nu with S = L L': three unit-variance numbers when the model is right
  Eigen::Vector3d free_velocity_mps;  // mean velocity navigated freely since the last rotation began, n frame
};

// What the effects of the model add to the readings over a block, without motion of the unit.
struct TakenOff {
  Eigen::Vector3d turn_rad = Eigen::Vector3d::Zero();
  Eigen::Vector3d push_mps = Eigen::Vector3d::Zero();
};

// Derivatives of psi and v (n frame), by the end of a block or later, by a constant excess in the readings of gyros and accelerometers.
using JumpByReadings = Eigen::Matrix<double, 6, 6>;

// One block as the filter linearised it: with these the same filter can be run backward.
struct FilterStep {
  std::size_t block = 0;
  bool observed = false;
  bool begins_chain = false;                           // psi and v start anew
  bool begins_recording = false;                       // and so do b_g and b_a
  double rho = 1.0;                                    // decay of b_g, b_a over the block
  Eigen::Vector3d rotation = Eigen::Vector3d::Zero();  // of the block, body frame, rad
  Eigen::Matrix3d turn_n, F, C_mid;                    // see linear_motion.h
  JumpByReadings jump;
  // observed: gain of (psi, v, b_g, b_a), innovation, its inverse covariance, its derivatives (a row a column of the pass)
  Eigen::Matrix<double, 12, 3> K = Eigen::Matrix<double, 12, 3>::Zero();
  Eigen::Vector3d nu = Eigen::Vector3d::Zero();
  Eigen::Matrix3d S_inverse = Eigen::Matrix3d::Zero();
  Eigen::Matrix<double, Eigen::Dynamic, 3> N;
};

struct FilterResult {
  Eigen::MatrixXd information;    // of [24 parameters in file units, effect columns]; rows of fixed ones are there too
  Eigen::VectorXd gradient;       // sum N' S^-1 nu; the Gauss-Newton step of a free subset is -A^-1 c
  double chi_square = 0.0;        // sum nu' S^-1 nu
  double log_determinant = 0.0;   // sum log det S
  std::int64_t observations = 0;  // scalar ones: three a static second
  std::vector<Innovation> innovations;
  std::vector<Eigen::Matrix3d> covariances;  // of the innovations' velocity, with keep_innovations
  std::vector<Innovation> left_out;  // of unobserved static seconds: predicted, not used (with keep_innovations)
  std::vector<TakenOff> taken_off;   // of every block, with keep_taken_off
  std::vector<FilterStep> steps;     // of every block from the first rest on, with keep_steps
  // Per chain: the error of the heading about which it was linearised, as estimated at its end, and the sigma.
  std::vector<double> heading_error_rad, heading_sigma_rad;
  std::vector<Eigen::VectorXd> heading_by_parameter;  // derivatives of that error by the parameters of all columns
};

// Runs the filter. `effects`: the candidate columns beside the 24 (may be empty), and the values already in the model.
FilterResult run_filter(const CompressedRecording& recording, const Parameters& parameters, const EffectModel& effects,
                        const FilterSetup& setup);

// The same for several noise models that differ in bias instability alone. The steps are those of the first.
std::vector<FilterResult> run_filter(const CompressedRecording& recording, const Parameters& parameters,
                                     const EffectModel& effects, const FilterSetup& setup,
                                     const std::vector<NoiseModel>& noises);

// The same on intervals made once (linear_motion.h), for one noise model after another: the noise of a turn is the sum
// of its sources with these weights, and of sources without a weight.
struct LinearInterval;
FilterResult run_filter(const std::vector<LinearInterval>& intervals, const FilterSetup& setup,
                        const std::vector<double>& source_weights);

}  // namespace turncal
