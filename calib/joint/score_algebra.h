// Small dense algebra on the information matrix of one filter pass: every sub-model is a solve away.
//
// With A, c the information and gradient over [base and chosen (b), candidates (c)]:
//   Q = A_cc - A_cb A_bb^-1 A_bc,   s = -(c_c - A_cb A_bb^-1 c_b)
// candidate k added alone is estimated as s_k / Q_kk with sigma Q_kk^-1/2; a group as Q^-1 s.
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

// False if the base imitates a candidate but for a billionth (SelectionLimits): the data do not show it.
bool is_visible(const Scores& scores, int candidate);

// Multiple correlation of candidate k with a group: 1 when the group can imitate it.
double multiple_correlation(const Scores& scores, int k, const std::vector<int>& group);

// What a recording determines, and the least-squares step within it.
//
// Directions of parameter space that the data hardly constrain are reported, not solved for: eigenvectors of the
// information, in units of plausible ranges, whose sigma is more than a tenth of the range.

// Returns the ranges (file units) below which a parameter must be known by far to count as determined: the sigmas that
// the noise allows in a run as long at the best positions, times 500 (N0), 1e5 (A0, a) and 2e4 (n), between the errors
// of a navigation-grade unit and of the worst sensors.
ParameterVector plausible_ranges(const NoiseModel& noise, double static_s);
// Least-squares step and covariance of a subset of the columns, without the undetermined directions.
struct SubsetSolution {
  Eigen::VectorXd step;  // of the subset, zero along undetermined directions
  Eigen::MatrixXd covariance;
  Eigen::MatrixXd undetermined;  // columns: directions in units of the ranges
  // 1: not determined. It takes part in an undetermined direction by a tenth or more, or by enough to move it by more
  // than half the sigma that it has from the determined ones. Its step and covariance are meaningless.
  std::vector<char> lost;
};
SubsetSolution solve_subset(const Eigen::MatrixXd& information, const Eigen::VectorXd& gradient,
                            const std::vector<int>& subset, const Eigen::VectorXd& ranges);

}  // namespace turncal
