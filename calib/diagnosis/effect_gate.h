// An effect stays only if the error of data not used in the fit is lower with it than without it: step 4 of diagnosis.h.
#pragma once

#include "calib/diagnosis/diagnosis_model.h"

namespace turncal {

// An effect that held-out data do not confirm makes the verdict unexplained, unless they outweigh what the fit had gained: then it was found by
// chance (of clean recordings selection finds one in a hundred).
// Takes effects out of m.chosen, or puts another of their alias class in their place, until held-out data agree with each; into
// d.gated_out, d.aliases, d.holdout_before and d.holdout_after.
void gate_effects(DiagnosisModel& m, Diagnosis& d);

}  // namespace turncal
