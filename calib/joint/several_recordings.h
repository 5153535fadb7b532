// One unit in several recordings: scale factors and misalignments are common, the six biases are of each switch-on.
//
// Near the joint estimate of a recording the likelihood is quadratic, with information I_i and gradient g_i at p_i. With p = (common, biases 1,
// ..., biases K) their sum is solved once,
//   sum_i T_i' (I_i (T_i p - p_i) + g_i) = 0,  T_i selects the parameters of recording i,
// which equals one estimate from all seconds of all recordings (to second order in p_i - T_i p), each at its own noise.
//
// The recordings agree if separate parameters for each lower chi-square by no more than chance does (disagreement()).
// Turn-on repeatability of a bias: the scatter of its K values, less what their own sigmas explain (IEEE 952, 1293).
// Not modelled: changes of scale factor or misalignment from day to day; they show in the agreement. For effects the recordings are joined
// (JoinedRecordings), which needs one noise for all.
#pragma once

#include <optional>
#include <vector>

#include "calib/joint/joint_estimate.h"

namespace turncal {

using Biases = Eigen::Matrix<double, 6, 1>;  // N01 N02 N03 (deg/h), A01 A02 A03 (g)

// The biases of every switch-on.
struct TurnOns {
  std::vector<Biases> biases, sigma;  // of each recording
  Biases mean = Biases::Zero();
  Biases repeatability = Biases::Zero();  // one sigma from one switch-on to the next; 0: no more than noise
};
// `values`: the six biases of the first recording, then of the second, ...; with their covariance.
TurnOns turn_ons_of(const Eigen::VectorXd& values, const Eigen::MatrixXd& covariance);

struct SeveralRecordings {
  // Common parameters; biases: the mean over the recordings, with the scatter of the mean in its sigma. Everything that
  // describes one recording (noise, faults, innovations) is of the first.
  JointResult unit;
  TurnOns turn_ons;
  double disagreement = 0.0;  // chi-square
  int degrees = 0;
  double p_value = 1.0;
  bool agree = true;  // p_value above one in a thousand; if not, the sigmas are widened until they agree
};

// Estimates a recording that leaves directions of the 21 open, near the parameters that another recording has determined. Its six biases are fitted;
// the covariance and the last pass hold its information on all 21. A fit of all 21 would end anywhere along the open directions.
JointResult estimate_beside(const CompressedRecording& recording, const Parameters& known);

// Returns the information of an estimate about itself: the inverse of its covariance; the data's own where directions are open.
Eigen::MatrixXd information_of(const JointResult& estimate);

// chi2 about x = 0: const + 2 c'x + x'A x.
struct Quadratic {
  Eigen::MatrixXd A;
  Eigen::VectorXd c;
};
// The fall of chi2 at the best x, in the directions that it determines within `ranges` (score_algebra.h), and their number.
struct Fall {
  double chi_square = 0.0;
  int degrees = 0;
};
Fall fall_of(const Quadratic& q, const Eigen::VectorXd& ranges);
// Returns by how much chi2 falls if each of several quadratics in the same columns has its own x instead of a common one.
Fall disagreement(const std::vector<Quadratic>& parts, const Eigen::VectorXd& ranges);

// REQUIRES: at least two estimates without effects, each converged.
SeveralRecordings combine_recordings(const std::vector<JointResult>& estimates);

// Several recordings of one unit joined end to end, with six more columns for every one after the first.
//
// Scale factors, misalignments and effects are common. Between two recordings the chain of attitude is cut and the biases' wander begins
// anew (Break::begins_recording). The biases of recording k beyond those of the first are six effects, the turn-on columns,
//   bias of recording k = bias of the first + turn-on of k
// Effects of the time since a run began (EffectEntry::of_one_run) have a column for every recording, with time from its own first sample.
// So everything that is done with one recording can be done with several.
struct JoinedRecordings {
  std::vector<const CompressedRecording*> parts;
  CompressedRecording data;
  std::vector<std::size_t> begins;     // first block of every part but the first
  std::vector<EffectColumn> turn_ons;  // six for every part but the first
};
// REQUIRES: at least one; of one unit, one site and one kind of increment.
JoinedRecordings join_recordings(const std::vector<const CompressedRecording*>& parts);

bool is_turn_on(const EffectColumn& column);
bool is_gyro_turn_on(const EffectColumn& column);

// If the innovations of every recording alone are white, and those of all `together` are not: returns what
// `combine_recordings` finds, provided that they disagree.
std::optional<SeveralRecordings> contradiction(const JoinedRecordings& recordings, const JointResult& together);

// Reduces an estimate of several recordings to what is the unit's: biases become the mean over the recordings, with the scatter of the mean in their
// sigma; effects of one run are those of the first. Returns the rest. `also`: another covariance of the same estimate, to be reduced too.
struct OfEachRecording {
  TurnOns turn_ons;
  std::vector<EstimatedEffect> effects;  // effects of one run in the later recordings
};
OfEachRecording leave_what_is_common(JointResult& estimate, std::size_t recordings, Eigen::MatrixXd* also = nullptr);

}  // namespace turncal
