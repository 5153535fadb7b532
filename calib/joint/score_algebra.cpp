#include "calib/joint/score_algebra.h"

#include <algorithm>
#include <cmath>

#include "calib/model/limits.h"
#include "calib/statistics/numerics.h"

namespace turncal {

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
    // The eigenvalue of an undetermined base direction is lifted by a hair, so that its inverse stays finite.
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

bool is_visible(const Scores& scores, int candidate) {
  return scores.kept[candidate] > SelectionLimits{}.visible_part && scores.Q(candidate, candidate) > 0.0;
}

double multiple_correlation(const Scores& scores, int k, const std::vector<int>& group) {
  // The group's part of Q, scaled to a unit diagonal, in its eigendirections above rounding.
  const Eigen::MatrixXd Q = scores.Q(group, group);
  const Eigen::VectorXd scale = Q.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  const SymmetricEigen eigen = symmetric_eigen(scale.asDiagonal() * Q * scale.asDiagonal());
  Eigen::Index first = 0;
  while (first < Q.rows() && eigen.values[first] < 1e-6) ++first;
  const Eigen::MatrixXd directions = eigen.vectors.rightCols(Q.rows() - first);
  const Eigen::VectorXd values = eigen.values.tail(Q.rows() - first);
  const Eigen::MatrixXd cross = scores.Q(group, std::vector<int>{k});
  const Eigen::VectorXd along = directions.transpose() * scale.cwiseProduct(cross.col(0));
  const double explained = along.cwiseAbs2().cwiseQuotient(values).sum();
  return std::sqrt(std::clamp(explained / std::max(scores.Q(k, k), 1e-300), 0.0, 1.0));
}

ParameterVector plausible_ranges(const NoiseModel& noise, double static_s) {
  const double t = std::max(static_s, 1.0);
  const double arw = noise.angle_random_walk.maxCoeff();
  const double vrw = noise.velocity_random_walk.maxCoeff();
  constexpr double turn_s = 36.0;  // time of one revolution
  const double bias = arw / std::sqrt(t) / radps_per_degph;
  const double force = vrw / std::sqrt(t) / standard_gravity_mps2;
  const double scale = arw * std::sqrt(turn_s) / (2.0 * pi);
  ParameterVector ranges;
  ranges.segment<3>(0).setConstant(std::clamp(500.0 * bias, 1.0, 2e4));  // deg/h
  ranges.segment<3>(3).setConstant(std::clamp(1e5 * force, 0.02, 0.2));  // g
  ranges.segment<9>(6).setConstant(std::clamp(2e4 * scale, 0.01, 0.1));  // of 0.93 or 1
  ranges.segment<9>(15).setConstant(std::clamp(1e5 * force, 0.01, 0.1));
  return ranges;
}

SubsetSolution solve_subset(const Eigen::MatrixXd& information, const Eigen::VectorXd& gradient,
                            const std::vector<int>& subset, const Eigen::VectorXd& ranges) {
  const Eigen::VectorXd scale = ranges(subset);
  const Eigen::MatrixXd A = scale.asDiagonal() * Eigen::MatrixXd(information(subset, subset)) * scale.asDiagonal();
  const Eigen::VectorXd c = scale.cwiseProduct(Eigen::VectorXd(gradient(subset)));
  // Determined: the data shrink the range to a tenth or less. The balanced inverse keeps small eigenvalues from being
  // lost in the rounding of large ones.
  const SymmetricEigen eigen =
      symmetric_eigen(balanced_inverse(A + Eigen::MatrixXd::Identity(A.rows(), A.cols())));  // sigma^2 / (1 + sigma^2)
  constexpr double limit = determined_limits.of_range * determined_limits.of_range;
  Eigen::Index good = 0;
  while (good < A.rows() && eigen.values[good] < limit) ++good;
  SubsetSolution solution;
  solution.undetermined = eigen.vectors.rightCols(A.rows() - good);
  if (good == A.rows()) {
    const Eigen::VectorXd plain = A.diagonal().array().sqrt().inverse();
    const Eigen::MatrixXd unit = plain.asDiagonal() * A * plain.asDiagonal();
    const Eigen::VectorXd back = scale.cwiseProduct(plain);
    solution.covariance = back.asDiagonal() *
                          solve_symmetric(unit, Eigen::MatrixXd::Identity(A.rows(), A.cols()).eval()) *
                          back.asDiagonal();
  } else {
    // sigma^2 without the prior, on the determined directions only
    const Eigen::VectorXd variance = eigen.values.head(good).array() / (1.0 - eigen.values.head(good).array());
    const Eigen::MatrixXd V = eigen.vectors.leftCols(good);
    solution.covariance = scale.asDiagonal() * V * variance.asDiagonal() * V.transpose() * scale.asDiagonal();
  }
  solution.covariance = (0.5 * (solution.covariance + solution.covariance.transpose())).eval();
  solution.step = -solution.covariance * Eigen::VectorXd(gradient(subset));
  solution.lost.assign(subset.size(), 0);
  Eigen::VectorXd moved =
      Eigen::VectorXd::Zero(A.rows());  // variance from the undetermined directions, ranges as prior
  for (Eigen::Index d = 0; d < solution.undetermined.cols(); ++d)
    moved += eigen.values[good + d] * solution.undetermined.col(d).cwiseProduct(scale).cwiseAbs2();
  for (Eigen::Index i = 0; i < A.rows(); ++i) {
    const bool takes_part = solution.undetermined.cols() > 0 &&
                            solution.undetermined.row(i).cwiseAbs().maxCoeff() >= determined_limits.smallest_part;
    if (takes_part || moved[i] > std::pow(determined_limits.of_sigma, 2) * solution.covariance(i, i))
      solution.lost[i] = 1;
  }
  return solution;
}

}  // namespace turncal
