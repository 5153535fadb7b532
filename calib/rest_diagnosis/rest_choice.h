// Which component is added next, and which others the data hardly tell from it.
#pragma once

#include "calib/rest_diagnosis/rest_diagnosis_model.h"

namespace turncal {

// Once a triad is known to change with time, its slow changes of any shape are held against every other effect: poses
// that were taken in a regular order change slowly with time too.
std::vector<EffectColumn> slow_columns(const RestDiagnosisModel& m);

// An index into m.testable; -1: nothing is declared. `guarded`: the scores with slow_columns() taken off; null: there are none.
int choose_component(const RestDiagnosisModel& m, const RestScores& scores, const RestScores* guarded);

// Into d.aliases, unless the effect has its line there.
void note_aliases(const RestDiagnosisModel& m, const RestScores& scores, int chosen, RestDiagnosis& d);

}  // namespace turncal
