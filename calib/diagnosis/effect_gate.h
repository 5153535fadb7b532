// An effect stays only if the error of data not used in the fit is lower with it than without it: step 4 of diagnosis.h.
#pragma once

#include "calib/diagnosis/diagnosis_model.h"

namespace turncal {

// Takes effects out of m.chosen, or puts another of their alias class in their place, until held-out data agree with each; into
// d.gated_out, d.aliases, d.holdout_before and d.holdout_after.
void gate_effects(DiagnosisModel& m, Diagnosis& d);

}  // namespace turncal
