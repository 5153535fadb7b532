#include "calib/joint/determined.h"

#include <algorithm>
#include <cmath>

#include "calib/model/limits.h"
#include "calib/statistics/linear_algebra.h"

namespace turncal {

ParameterVector plausible_ranges(const NoiseModel& noise, double static_s) {
  const double t = std::max(static_s, 1.0);
  const double arw = noise.angle_random_walk.maxCoeff();
  const double vrw = noise.velocity_random_walk.maxCoeff();
  constexpr double turn_s = 36.0;  // in which the unit turns once
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
  // Determined: the data shrink the range to a tenth and less. The scaled matrix is first balanced, so that the small
  // eigenvalues are not lost in the rounding of the large ones.
  const Eigen::VectorXd balance = (A.diagonal().array() + 1.0).sqrt().inverse();
  const Eigen::MatrixXd B =
      balance.asDiagonal() * (A + Eigen::MatrixXd::Identity(A.rows(), A.cols())) * balance.asDiagonal();
  const Eigen::MatrixXd with_prior = balance.asDiagonal() * solve_symmetric(B, Eigen::MatrixXd(balance.asDiagonal()));
  const SymmetricEigen eigen = symmetric_eigen(with_prior);  // sigma^2 / (1 + sigma^2), in ranges
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
      solution.lost[static_cast<std::size_t>(i)] = 1;
  }
  return solution;
}

}  // namespace turncal
