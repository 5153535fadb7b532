// What the effects that a diagnosis added are worth: a recording navigated freely without and with them, and without each.
//
// Before: the 24 parameters estimated alone; after: those of the extended model, with its effects taken off. What one effect is worth is
// the radial rate of the distance between two tracks, with all effects and without that one. Noise is the same in both and
// falls out. Parameters p and the other effects then are as they would have been estimated without it,
//   p' = p - P_pe P_ee^-1 e      (P the covariance of the joint estimate, e the effect's components; least squares with e = 0)
// Units of the catalogue and of the parameter file throughout.
#pragma once

#include <optional>
#include <string>

#include "calib/diagnosis/diagnosis.h"
#include "calib/types/status.h"
#include "orchestrator/figures/diagnosis_context.h"

namespace turncal {

// `recording`: the path of its samples; what lies after `to_s` is not navigated. Errors: those of navigate_recording().
// REQUIRES: effects were added.
Result<NavigationWorth> worth_of_effects(const Diagnosis& diagnosis, const DiagnosisContext& context,
                                         const std::string& recording, std::optional<double> to_s);

// The extended model with one of its effects held at zero. `covariance`: that of the fit, not widened; its rows are extended.free.
struct ModelWithout {
  ParameterVector parameters;
  std::vector<double> effects;  // as JointResult::effects; 0 for those of `name`
};
ModelWithout model_without(const JointResult& extended, const Eigen::MatrixXd& covariance, const std::string& name);

}  // namespace turncal
