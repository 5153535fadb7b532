// Small dense algebra on the information matrix of one filter pass: every sub-model is a solve away.
//
// With A, c the information and gradient over [base and chosen (b), candidates (c)]:
//   Q = A_cc - A_cb A_bb^-1 A_bc,   s = -(c_c - A_cb A_bb^-1 c_b)
// candidate k added alone comes to s_k / Q_kk with sigma Q_kk^-1/2; a group to Q^-1 s.
#pragma once

#include <vector>

#include <Eigen/Core>

#include "calib/model/parameters.h"

namespace turncal {

struct Scores {
  Eigen::MatrixXd Q;
  Eigen::VectorXd s;
  Eigen::VectorXd kept;  // Q_kk / A_kk: the part of each candidate that the base cannot imitate
};
Scores eliminate(const Eigen::MatrixXd& information, const Eigen::VectorXd& gradient, const std::vector<int>& base,
                 const std::vector<int>& candidates);

// Of a candidate of which the base already imitates all but a billionth (SelectionLimits) the data say nothing.
bool is_visible(const Scores& scores, int candidate);

// Multiple correlation of candidate k with a group: 1 when the group can imitate it.
double multiple_correlation(const Scores& scores, int k, const std::vector<int>& group, double floor = 1e-6);

// What a recording determines, and the least-squares step in that.
//
// Directions of parameter space that the data hardly shrink are named, not solved for: eigenvectors of the information in units of
// plausible ranges whose sigma is more than a tenth of the range.

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

}  // namespace turncal
