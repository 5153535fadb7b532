#include "calib/joint/score_algebra.h"

#include <algorithm>
#include <cmath>

#include "calib/statistics/linear_algebra.h"

namespace turncal {
namespace {

// Inverse of the group's part of Q on its well-determined directions, in units of its diagonal.
struct Partial {
  Eigen::VectorXd scale;
  Eigen::MatrixXd directions;  // columns
  Eigen::VectorXd values;
};
Partial decompose(const Scores& scores, const std::vector<int>& group, double floor) {
  const Eigen::MatrixXd Q = scores.Q(group, group);
  Partial p;
  p.scale = Q.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  const SymmetricEigen eigen = symmetric_eigen(p.scale.asDiagonal() * Q * p.scale.asDiagonal());
  Eigen::Index first = 0;
  while (first < Q.rows() && eigen.values[first] < floor) ++first;
  p.directions = eigen.vectors.rightCols(Q.rows() - first);
  p.values = eigen.values.tail(Q.rows() - first);
  return p;
}

}  // namespace

Scores eliminate(const Eigen::MatrixXd& information, const Eigen::VectorXd& gradient, const std::vector<int>& base,
                 const std::vector<int>& candidates) {
  Scores result;
  const Eigen::MatrixXd A_bb = information(base, base);
  const Eigen::MatrixXd A_bc = information(base, candidates);
  const Eigen::VectorXd c_b = gradient(base);
  result.Q = information(candidates, candidates);
  result.s = -gradient(candidates);
  const Eigen::VectorXd before = result.Q.diagonal();
  if (!base.empty()) {
    const Eigen::VectorXd scale = A_bb.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
    const Eigen::MatrixXd unit = scale.asDiagonal() * A_bb * scale.asDiagonal();
    // An undetermined base direction must not blow up: its eigenvalue is lifted by a hair.
    const Eigen::MatrixXd right = scale.asDiagonal() * A_bc;
    const Eigen::MatrixXd solved =
        solve_symmetric(unit + 1e-13 * Eigen::MatrixXd::Identity(unit.rows(), unit.cols()), right);
    result.Q -= right.transpose() * solved;
    const Eigen::VectorXd scaled = scale.cwiseProduct(c_b);
    result.s += solved.transpose() * scaled;
  }
  result.kept = result.Q.diagonal().cwiseQuotient(before.cwiseMax(1e-300));
  return result;
}

GroupTest group_test(const Scores& scores, const std::vector<int>& group, double floor) {
  const Partial p = decompose(scores, group, floor);
  const Eigen::VectorXd s = p.scale.cwiseProduct(Eigen::VectorXd(scores.s(group)));
  const Eigen::VectorXd along = p.directions.transpose() * s;
  return {along.cwiseAbs2().cwiseQuotient(p.values).sum(), static_cast<int>(p.values.size())};
}

double multiple_correlation(const Scores& scores, int k, const std::vector<int>& group, double floor) {
  const Partial p = decompose(scores, group, floor);
  const Eigen::MatrixXd cross = scores.Q(group, std::vector<int>{k});
  const Eigen::VectorXd along = p.directions.transpose() * p.scale.cwiseProduct(cross.col(0));
  const double explained = along.cwiseAbs2().cwiseQuotient(p.values).sum();
  return std::sqrt(std::clamp(explained / std::max(scores.Q(k, k), 1e-300), 0.0, 1.0));
}

}  // namespace turncal
