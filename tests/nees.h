// Normalised estimation error squared: the error of the free parameters in the metric of the predicted covariance. For a right
// estimate chi-square with as many degrees of freedom as there are free parameters.
#pragma once

#include <Eigen/Dense>

#include "calib/joint/joint_estimate.h"

namespace turncal {

inline double nees(const JointResult& r, const Parameters& truth) {
  const ParameterVector difference = to_vector(r.parameters) - to_vector(truth);
  const Eigen::VectorXd error = difference(r.free);
  const Eigen::VectorXd scale = r.covariance.diagonal().cwiseSqrt().cwiseInverse();
  const Eigen::MatrixXd correlation = scale.asDiagonal() * r.covariance * scale.asDiagonal();
  const Eigen::VectorXd normalised = scale.cwiseProduct(error);
  return normalised.dot(correlation.ldlt().solve(normalised));
}

}  // namespace turncal
