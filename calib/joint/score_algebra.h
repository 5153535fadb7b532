// Small dense algebra on the information matrix of one filter pass: every sub-model is a solve away.
//
// With A, c the information and gradient over [base and chosen (b), candidates (c)]:
//   Q = A_cc - A_cb A_bb^-1 A_bc,   s = -(c_c - A_cb A_bb^-1 c_b)
// candidate k added alone comes to s_k / Q_kk with sigma Q_kk^-1/2; a group to Q^-1 s; T = s' Q^-1 s ~ chi2(rank Q).
#pragma once

#include <vector>

#include <Eigen/Core>

namespace turncal {

struct Scores {
  Eigen::MatrixXd Q;
  Eigen::VectorXd s;
  Eigen::VectorXd kept;  // Q_kk / A_kk: the part of each candidate that the base cannot imitate
};
Scores eliminate(const Eigen::MatrixXd& information, const Eigen::VectorXd& gradient, const std::vector<int>& base,
                 const std::vector<int>& candidates);

// T and rank over a subset of the candidates; directions below `floor` of the largest (of the unit-diagonal matrix) are left out.
struct GroupTest {
  double chi_square = 0.0;
  int rank = 0;
};
GroupTest group_test(const Scores& scores, const std::vector<int>& group, double floor = 1e-6);

// Multiple correlation of candidate k with a group: 1 when the group can imitate it.
double multiple_correlation(const Scores& scores, int k, const std::vector<int>& group, double floor = 1e-6);

}  // namespace turncal
