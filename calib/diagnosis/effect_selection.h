// Forward selection of effects by likelihood: steps 2 and 3 of diagnosis.h, with the aliases of each effect.
#pragma once

#include "calib/diagnosis/diagnosis_model.h"

namespace turncal {

// Adds effects to m.chosen, with m.current fitted anew, until nothing more is accepted, and says in d.stages why. Where a pattern
// without a name explains the residual better, d.verdict becomes unexplained.
// REQUIRES: m.current and d.base are the fit without effects.
void select_effects(DiagnosisModel& m, Diagnosis& d);

}  // namespace turncal
