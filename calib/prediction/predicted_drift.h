// What a planned calibration is worth in miles: the free navigation of a unit at rest with the parameters that it would give.
//
// predict() has the covariance of the parameters; expected_drift() (calib/navigation/free_navigation.h) takes it, with the noise,
// through an alignment and the free navigation after it. What the calibration does not determine counts as known.
#pragma once

#include "calib/navigation/free_navigation.h"
#include "calib/prediction/predict.h"

namespace turncal {

struct DriftPlan {
  double align_s = 300.0;
  double free_s = 3600.0;
  double heading_rad = 0.0;  // of the unit, level and at rest
};

ExpectedDrift predicted_drift(const RecordingInfo& info, const Prediction& prediction, const PredictOptions& options,
                              const DriftPlan& plan);

}  // namespace turncal
