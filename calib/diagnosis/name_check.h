// A name is given only where nothing without a name explains the data as well: step 5 of diagnosis.h.
#pragma once

#include "calib/diagnosis/diagnosis_model.h"

namespace turncal {

// Each effect of m.chosen against every family of nameless_families.h, at the model without it and the noise with it. Where it is
// not better by SelectionLimits::family_margin, into d.rivalled; a curve with temperature or rate that holds the effect as one of its functions
// must itself be better. A family that comes within bic_margin of the name, or holds it, may be the truth as well: the parameters with it go
// into m.beside, and the temperature coefficient of the sensor that it is of into the alias class.
void check_names(DiagnosisModel& m, Diagnosis& d);

// The family that explains best what `fit` leaves; empty: none gains more than the threshold.
std::string looks_like(const DiagnosisModel& m, const JointResult& fit);

}  // namespace turncal
