// One unit in several recordings: scale factors and installation are common, the six biases are of each switch-on.
//
// Every recording has its own joint estimate (joint_estimate.h): near it the likelihood is quadratic, with information I_i (the
// inverse of its covariance) and gradient g_i (nothing, once settled) at p_i. With p = (common, biases 1, ..., biases K) their sum is solved once,
//   sum_i T_i' (I_i (T_i p - p_i) + g_i) = 0,  T_i picks what recording i knows of,
// which is what one estimate from all seconds of all recordings would find (to second order in p_i - T_i p, some sigma), each at its own noise.
//
// The recordings agree when what chi-square falls by when each has all parameters for itself is chi-square with as many degrees of freedom
// as that frees directions (disagreement()).
// Turn-on repeatability of a bias: the scatter of its K values, less what their own sigmas explain (IEEE 952, 1293).
// Not modelled: changes of scale factor or installation from day to day; they show in the agreement. Effects are not combined: for those
// the recordings are joined (joined_recordings.h), which needs one noise for all.
#pragma once

#include <string>
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
// What chi2 falls by at the best x, along the directions that it determines within `ranges` (determined.h).
struct Fall {
  double chi_square = 0.0;
  int degrees = 0;
};
Fall fall_of(const Quadratic& q, const Eigen::VectorXd& ranges);
// Of several that speak of the same columns: what their chi2 falls by when each has an x of its own.
Fall disagreement(const std::vector<Quadratic>& parts, const Eigen::VectorXd& ranges);

// At least two estimates without effects, each converged.
SeveralRecordings combine_recordings(const std::vector<JointResult>& estimates);

}  // namespace turncal
