// What a recording determines, and the least-squares step in that.
//
// Directions of parameter space that the data hardly shrink are named, not solved for: eigenvectors of the information in units of
// plausible ranges whose sigma is more than a tenth of the range.
#pragma once

#include <vector>

#include <Eigen/Core>

#include "calib/model/noise_model.h"
#include "calib/model/parameters.h"

namespace turncal {

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
