// The report of a diagnosis of hand-turned data: the same page as report.h, with the errors that rests and rotations by hand
// can show (docs/hand-data.md), and the three files of it.
#pragma once

#include "calib/rest_diagnosis/rest_diagnosis.h"
#include "orchestrator/report/diagnosis_file.h"
#include "orchestrator/report/report.h"

namespace turncal {

// `d` is as_diagnosis(result, data).
Report make_rest_report(const RestDiagnosis& result, const RestData& data, const Diagnosis& d,
                        const DiagnosisContext& context);

DiagnosisFiles rest_diagnosis_files(const RestDiagnosis& result, const RestData& data, const Diagnosis& d,
                                    const DiagnosisContext& context);

}  // namespace turncal
