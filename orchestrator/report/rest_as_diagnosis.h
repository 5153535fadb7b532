// What is said differently of a diagnosis of hand-turned data (calib/evidence/rest_diagnosis.h): the errors are those of gravity's norm and
// direction and of the gyros at rest, not velocities.
#pragma once

#include <string>

#include "calib/evidence/rest_diagnosis.h"
#include "imu_io/recordings/parameter_file.h"
#include "orchestrator/figures/diagnosis_context.h"
#include "orchestrator/report/diagnosis_file.h"

namespace turncal {

// "gravity norm at rest 0.93 mm/s² rms, direction after a rotation 6.80 mrad, gyros at rest 0.067 °/s"
std::string error_text(const RestErrors& errors);

// Parameters, sigmas, effects, white noise and errors of a fit.
void describe_rest_fit(const RestFit& fit, const JointResult& joint, const RestData& data, ParameterFile& file);

// What a diagnosis of hand-turned data leaves on disk: the document of report.h, with the errors that rests and rotations by hand can show
// (docs/hand-data.md), and the other two files of it.
DiagnosisFiles rest_diagnosis_files(const RestDiagnosis& result, const RestData& data, const DiagnosisContext& context);

}  // namespace turncal
