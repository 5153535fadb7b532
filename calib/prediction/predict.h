// What a planned run would determine, and how well, before anything is run.
//
// The recording an ideal unit would make of the plan (planned_motion.h) goes through joint_estimate() like any other, with
// the noise given and the parameters of that unit as the start: the step is zero and the covariance is the prediction. There
// is no second covariance code. For effects of the catalogue, the columns of that same pass with the base eliminated
// (score_algebra.h) give, for each component added alone, sigma = Q_kk^-1/2; the smallest magnitude that would be caught is
// 5 sigma, as in a diagnosis.
//
// Units: sigmas in file units (parameters.h), effects in those of docs/diagnosis.md.
// Not predicted: what table errors, temperature gradients and effects outside the model do to the error; faults.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "calib/joint/joint_estimate.h"
#include "calib/model/effects.h"
#include "calib/navigation/free_navigation.h"
#include "calib/prediction/planned_motion.h"

namespace turncal {

struct PredictOptions {
  NoiseModel noise;                               // its pulses are those of the RecordingInfo, whatever is set
  std::optional<Parameters> unit;                 // default: typical_unit(info)
  std::optional<TemperatureProfile> temperature;  // without one, temperature effects are left out
  bool effects = false;
};

struct PredictedEffect {  // one component, added alone to the 21 parameters
  EffectColumn column;
  double sigma = 0.0;
  double detectable = 0.0;           // 5 sigma
  bool visible = false;              // false: only a magnitude that no sensor has would be caught
  std::vector<std::string> aliases;  // other effects that imitate it (multiple correlation above 0.97, base eliminated)
  bool among_its_own = false;        // the other components of its own effect imitate it
};

struct Prediction {
  std::string message = "not run";  // of the estimator
  bool valid = false;
  std::int64_t samples = 0;
  double static_s = 0.0;                            // observed static seconds
  ParameterVector sigma = ParameterVector::Zero();  // 0 for the three fixed and for undetermined ones
  std::vector<int> free;                            // parameter of each row of the covariance
  Eigen::MatrixXd covariance;                       // file units; along determined directions only
  std::vector<bool> determined;
  std::vector<Undetermined> undetermined;
  std::vector<PredictedEffect> effects;  // catalogue order, every variant
};

Prediction predict(const RecordingInfo& info, const PlannedMotion& motion, const PredictOptions& options);

// Returns for each of the 24 its sigma with `motion` recorded on in the same run, over that of `fit` alone, at its noise; 1 where `fit` is open.
ParameterVector shrunk_by(const PlannedMotion& motion, const JointResult& fit, const RecordingInfo& info);

// Returns start_parameters() with accelerometer biases of a few mg: an accelerometer that reads exactly no pulse at
// rest would keep one quantisation error for whole dwells, which no real one does.
Parameters typical_unit(const RecordingInfo& info);

// The value of a planned calibration in miles: the free navigation of a unit at rest with the parameters that it would give.
//
// predict() has the covariance of the parameters; expected_drift() (calib/navigation/free_navigation.h) takes it, with the noise,
// through an alignment and the free navigation after it. What the calibration does not determine counts as known.
struct DriftPlan {
  double align_s = 300.0;
  double free_s = 3600.0;
  double heading_rad = 0.0;  // of the unit, level and at rest
};

ExpectedDrift predicted_drift(const RecordingInfo& info, const Prediction& prediction, const PredictOptions& options,
                              const DriftPlan& plan);

}  // namespace turncal
