// Which effects a recording of rests can show at all, and what the scores say of each.
#pragma once

#include "calib/rest_diagnosis/rest_diagnosis_model.h"

namespace turncal {

// m.testable, and a line in d.candidates for every effect of the catalogue.
void find_testable(RestDiagnosisModel& m, RestDiagnosis& d);
// `scores`: of m.testable beside the base model.
void fill_candidates(const RestDiagnosisModel& m, const RestScores& scores, RestDiagnosis& d);
// A component of which only an absurdly large value would be caught is out of question.
void strike_invisible(RestDiagnosisModel& m, const RestScores& scores);

}  // namespace turncal
