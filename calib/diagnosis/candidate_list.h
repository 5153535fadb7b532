// What the scores of all catalogue columns say about each effect: its value, the smallest one this recording would catch, the test
// of all its components together, and which effects it cannot tell apart.
#pragma once

#include "calib/diagnosis/diagnosis_model.h"

namespace turncal {

// Into d.candidates, d.groups and d.undetectable. `scores`: of m.columns, beside the base model.
void list_candidates(const DiagnosisModel& m, const Scores& scores, Diagnosis& d);

// Effects that would have done as well as the one chosen, or that can imitate it: into d.aliases, d.separate_by and the stage.
// `z_square`: of the chosen one, from the same scores.
void name_aliases(const DiagnosisModel& m, const Scores& scores, const EffectColumn& chosen, double z_square,
                  SelectionStage& stage, Diagnosis& d);

// Beside the effect `name`: the recording cannot tell it from `other`. Once.
void add_alias(const std::string& name, const EffectEntry& other, Diagnosis& d);

}  // namespace turncal
