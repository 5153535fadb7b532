// An effect stays only when it lowers the error on rests and rotations left out in turn, and on a second recording where there is one.
#pragma once

#include "calib/rest_diagnosis/rest_diagnosis_model.h"

namespace turncal {

// `first`: the first component of its effect, of which more is asked. Both sides with the weights of the model before, so that the
// new effect is measured with the old yardstick.
bool passes_gate(const RestDiagnosisModel& m, const RestModelFit& before, const RestModelFit& after, bool first);

// The weighted mean square of prediction errors; rows that are NaN could not be predicted and are left out.
double mean_square(const Eigen::VectorXd& residual, const Eigen::VectorXd& weights);

}  // namespace turncal
