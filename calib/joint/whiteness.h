// Are the innovations white at the noise model, and as large as it says?
#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

#include "calib/joint/joint_filter.h"

namespace turncal {

struct Whiteness {
  bool white = false;
  double level = 0.0;               // mean square of the normalised innovations; 1 when the noise model is right
  Eigen::VectorXd autocorrelation;  // lags 1 .. 5 s, mean of the three components
  std::string message;
};
Whiteness test_whiteness(const std::vector<Innovation>& innovations);

}  // namespace turncal
