// Two components in one model that stand for a curve which neither of them is.
//
// A drift and a warm-up of one gyro are all but the same straight line in a short run; what is left of the two is a parabola. A curve that
// fits neither is then described by both, each many times larger than what they explain, against each other. So two members of one alias
// class (SelectionLimits::alias_correlation of their columns, everything else in the model eliminated) on one axis of one sensor are no names
// where each of them explains far more than both together.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "calib/model/effects.h"

namespace turncal {

struct CurveOfTwo {
  std::string what;  // "bias of gyro x with time"; of two that are not of time "bias of gyro x"
  std::string
      why;  // "gyro_bias_drift.x and gyro_warm_up.x are one curve to the data, and it is in the name of neither"
  bool found() const { return !what.empty(); }
};
// `values`: of the columns; `information`: of two of them, everything else in the model eliminated.
CurveOfTwo curve_of_two(const std::vector<EffectColumn>& columns, const Eigen::VectorXd& values,
                        const std::function<Eigen::Matrix2d(int, int)>& information);

}  // namespace turncal
