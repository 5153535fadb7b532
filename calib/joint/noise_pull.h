// What the noise of the counts does to the gradient.
#pragma once

#include <vector>

#include "calib/joint/joint_filter.h"

namespace turncal {

// The noise of the counts goes into the derivatives, too: those by a scale factor n hold nu_i / n, nu_i what sensor i's noise makes of
// the innovations, and E sum N' S^-1 nu = sum tr(S^-1 cov nu_i) / n = (d log det S / d log s_i) / n with s_i its variance, not 0:
// scale factors come out too small, by a sigma at 3 deg/sqrt(h) (errors in variables). This is what is to be taken off the gradient.
// `free`: the columns that are estimated, with their covariance; file units. Of the 24 parameters.
Eigen::VectorXd pull_of_noise(const CompressedRecording& recording, const Parameters& parameters,
                              const EffectModel& effects, const FilterSetup& at, const std::vector<int>& free,
                              const Eigen::MatrixXd& covariance);

}  // namespace turncal
