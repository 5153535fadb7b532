// The joint estimate: all free parameters (and any effects asked for) from every static second of a recording.
//
// Gauss-Newton on run_filter() (joint_filter.h) until no parameter moves by 0.3 sigma, and over every second until none moves by one:
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

#include "calib/joint/noise_fit.h"
#include "calib/joint/score_algebra.h"

namespace turncal {

// Where the joint estimate begins, from the rests and the commanded angles of the table alone.
//
// At rest number k with commanded attitude C_k, levelled on the accelerometers, the gyros read
//   mean rate_k = N0 + C_k' (e_n, w_U, e_e)
// with w_U the known vertical part of the earth's rate and (e_n, e_e) its horizontal part in a frame whose north is the
// given one: five unknowns, linear, so the given heading may be wrong by any angle. The true north lies where (e_n, e_e)
// points. Used only as a start: the estimate linearises about it and goes on from there.
//
// The directions of gravity tell how the unit is mounted on the table: one of 24 orientations, or the reverse of one (the
// accelerometers have the wrong sign, which no mounting makes).
struct JointStart {
  Eigen::Matrix3d mounting = Eigen::Matrix3d::Identity();  // C_nb = C(table angles) mounting
  std::string mounting_text;  // empty: as the table's axes; "turned by 90 deg about up", ...
  std::string error;          // plain words when no mounting explains the rests: "gravity has the wrong sign", ...
  double heading_rad = 0.0;   // to be added to the commanded heading; 0 when the earth's rate is not seen
  double heading_sigma_rad = 1.0;
  Eigen::Vector3d N0_degph = Eigen::Vector3d::Zero();  // 0 where below what the start should know
};
JointStart joint_start(const CompressedRecording& recording, const Parameters& parameters);

// Are the innovations white at the noise model, and as large as it says?
struct Whiteness {
  bool white = false;
  double level = 0.0;               // mean square of the normalised innovations; 1 when the noise model is right
  Eigen::VectorXd autocorrelation;  // lags 1 .. 5 s, mean of the three components
  std::string message;
};
Whiteness test_whiteness(const std::vector<Innovation>& innovations);

struct JointResult;

struct JointOptions {
  std::optional<Parameters> start;        // default: start_parameters()
  std::optional<NoiseModel> noise;        // given: not fitted
  std::optional<NoiseModel> start_noise;  // where the fit begins; default: read off the Allan deviation
  bool fit_bias_instability = true;
  std::vector<EffectColumn> effects;              // estimated together with the 21
  Eigen::VectorXd start_effects;                  // of the effects; default: zero
  std::vector<EffectColumn> candidates;           // columns of the last pass only
  std::optional<double> reference_temperature_c;  // default: the mean of the recording
  std::vector<char> unobserved;                   // blocks left out (hold-out), see FilterSetup
  std::vector<std::size_t> begins;                // first blocks of further recordings (several_recordings.h)
  std::vector<Break> breaks;                      // known beforehand, beside those that the data show
  // Which of the 24 are estimated; default: the 21 free ones.
  std::optional<std::vector<int>> free_parameters;
  bool look_for_faults = true;
  const JointResult* faults_of = nullptr;  // given: its faults and breaks are taken over, none are looked for
  // With faults_of and noise: takes one Gauss-Newton step from that fit (dwells left out). Sets only the parameters,
  // the effects' values and the number of open directions.
  bool one_step = false;
  int max_iterations = 15;
};

struct Fault {                                     // where the chain was cut, and why
  std::int64_t first_sample = 0, last_sample = 0;  // the fault lies in [first, last]
  std::size_t block = 0;
  std::string what;       // "gap of 1 sample(s) in the unit's counter", ...
  std::string action;     // "velocity is estimated anew after it", ...
  double step_mps = 0.0;  // of a velocity step that no noise explains
};

struct Undetermined {  // one open direction of parameter space
  // Key, weight: largest first, in file units, norm 1 in ranges.
  std::vector<std::pair<std::string, double>> combination;
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
  Eigen::VectorXd noise_pull;            // bias of the gradient by errors in variables, of the 24; removed
  Eigen::MatrixXd unseen_instability;    // part of the covariance from a bias instability not kept (noise_fit.h)
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

// Returns the first-order response of the estimate to parameters that vary with temperature: 24 x 24, C. Column k is the error of each parameter,
// about its value at the mean temperature, for a slope of k of one unit per C. Zero without a thermometer and for undetermined parameters.
Eigen::MatrixXd response_to_temperature(const CompressedRecording& recording, const JointResult& fit);

// Moves the heading about which every chain is linearised to the one that `pass` estimated, after the `step` taken
// since in `columns`. Returns the largest correction in its sigma; 0 if the start does not observe the heading.
// A chain that sees a horizontal rate larger than the Earth's overshoots: a step is at most half a radian, and a step
// back at most half of the `last` one.
double correct_headings(const FilterResult& pass, const Eigen::VectorXd& step, const std::vector<int>& columns,
                        const JointStart& start, std::vector<double>& headings_rad, std::vector<double>& last);

// Faults: where a recording contradicts itself, the joint estimate cuts the chain.
//
// Two sources: the Compressor's events on raw samples (gaps of the counter, invalid samples, glitches), and static seconds whose innovation nothing
// explains: nu' S^-1 nu above the one-in-10^9 quantile of chi-square, and above ten times the 90 % quantile of the seconds after a rotation (an
// effect that the model lacks acts after every rotation, and must not pass for a fault).
// A sample of g lost or counted twice in a rotation shows as a velocity step of gravity x period up or down.

// Returns the faults that the raw data show; adds a break for each that matters, in block order.
std::vector<Fault> faults_from_events(const CompressedRecording& recording, std::vector<Break>& breaks);

// Inserts a break in block order.
void add_break(std::vector<Break>& breaks, const Break& cut);

// Finds the worst unexplained second; adds fault and break and returns true, or returns false when there is none.
bool cut_worst_fault(const CompressedRecording& recording, const std::vector<Innovation>& innovations,
                     std::vector<Fault>& faults, std::vector<Break>& breaks);

}  // namespace turncal
