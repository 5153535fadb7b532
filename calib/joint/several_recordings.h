// One unit in several recordings: scale factors and misalignments are common, the six biases are of each switch-on.
//
// Near the joint estimate of a recording the likelihood is quadratic, with information I_i and gradient g_i at p_i. With p = (common, biases 1,
// ..., biases K) their sum is solved once,
//   sum_i T_i' (I_i (T_i p - p_i) + g_i) = 0,  T_i picks what recording i knows of,
// as one estimate from all seconds of all recordings would be (to second order in p_i - T_i p), each at its own noise.
//
// The recordings agree when chi-square falls by no more than chance when each has all parameters for itself (disagreement()).
// Turn-on repeatability of a bias: the scatter of its K values, less what their own sigmas explain (IEEE 952, 1293).
// Not modelled: changes of scale factor or misalignment from day to day; they show in the agreement. For effects the recordings are joined
// (JoinedRecordings), which needs one noise for all.
#pragma once

#include <optional>
#include <vector>

#include "calib/joint/joint_estimate.h"

namespace turncal {

using Biases = Eigen::Matrix<double, 6, 1>;  // N01 N02 N03 (deg/h), A01 A02 A03 (g)

// What is of each switch-on.
struct TurnOns {
  std::vector<Biases> biases, sigma;  // of each recording
  Biases mean = Biases::Zero();
  Biases repeatability = Biases::Zero();  // one sigma from one switch-on to the next; 0: no more than noise
};
// `values`: six biases of the first recording, of the second, ...; `covariance`: of them.
TurnOns turn_ons_of(const Eigen::VectorXd& values, const Eigen::MatrixXd& covariance);

struct SeveralRecordings {
  // Common parameters; biases: the mean over the recordings, with the scatter of the mean in its sigma. Everything that
  // describes one recording (noise, faults, innovations) is of the first.
  JointResult unit;
  TurnOns turn_ons;
  double disagreement = 0.0;  // chi-square
  int degrees = 0;
  double p_value = 1.0;
  bool agree = true;  // p_value above one in a thousand; where not, sigmas are those that would make them agree
};

// A recording that leaves directions of the 21 open, near the parameters that another has determined: its six biases are fitted, and what
// it says of all 21 there is in the covariance and the last pass. Its own fit would end anywhere along what it leaves open.
JointResult estimate_beside(const CompressedRecording& recording, const Parameters& known);

// Of one estimate, about itself: everything that its covariance counts, or what the data say where directions are open.
Eigen::MatrixXd information_of(const JointResult& estimate);

// chi2 = .. + 2 c'x + x'A x about where x is zero.
struct Quadratic {
  Eigen::MatrixXd A;
  Eigen::VectorXd c;
};
// What chi2 falls by at the best x, along the directions that it determines within `ranges` (score_algebra.h).
struct Fall {
  double chi_square = 0.0;
  int degrees = 0;
};
Fall fall_of(const Quadratic& q, const Eigen::VectorXd& ranges);
// Of several that speak of the same columns: what their chi2 falls by when each has an x of its own.
Fall disagreement(const std::vector<Quadratic>& parts, const Eigen::VectorXd& ranges);

// At least two estimates without effects, each converged.
SeveralRecordings combine_recordings(const std::vector<JointResult>& estimates);

// Several recordings of one unit as one: one behind the other, with six columns for every one after the first.
//
// Scale factors, misalignments and effects are common. Between two recordings the chain of attitude is cut and the biases' wander begins
// anew (Break::begins_recording); what the biases of recording k have beside those of the first is six effects, the turn-on columns,
//   bias of recording k = bias of the first + turn-on of k
// Effects of the time since a run began (EffectEntry::of_one_run) have a column for every recording, and time counts from its own first sample.
// So everything that is done with one recording is done with several.
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

// Each by itself is fitted to its noise and all together, at `together`, are not: then what `combine_recordings` says of them, if that is that
// they disagree.
std::optional<SeveralRecordings> contradiction(const JoinedRecordings& recordings, const JointResult& together);

// Of an estimate of several recordings what is the unit's: biases are the mean over the recordings, with the scatter of the mean in their
// sigma; effects of one run are those of the first. The rest goes into what is returned. `also`: another covariance of the same estimate.
struct OfEachRecording {
  TurnOns turn_ons;
  std::vector<EstimatedEffect> effects;  // of one run, of a recording after the first
};
OfEachRecording leave_what_is_common(JointResult& estimate, std::size_t recordings, Eigen::MatrixXd* also = nullptr);

}  // namespace turncal
