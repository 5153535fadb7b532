// What a diagnosis leaves on disk: diagnosis.conf, parameters.conf and report.html, each written whole or not at all.
//
// diagnosis.conf (docs/report.md): every key stands in every file; a list that is empty and a number that is not known are empty values.
// Numbers: shortest round trip, units of docs/diagnosis.md.
#pragma once

#include <optional>
#include <string>

#include "calib/evidence/diagnosis.h"
#include "calib/evidence/rest_diagnosis.h"
#include "calib/types/status.h"
#include "imu_io/recordings/parameter_file.h"
#include "orchestrator/report/report.h"

namespace turncal {

inline constexpr const char* diagnosis_name = "diagnosis.conf";
inline constexpr const char* report_name = "report.html";

std::string format_diagnosis(const Diagnosis& diagnosis, const std::optional<NavigationWorth>& worth = {});

// Parameters, sigmas, effects (strongest first, with tau_s where an effect has a time constant), noise and quality of a joint
// estimate, in every parameter file with the same keys. What belongs to the recording (describe_recording, hash) and method, time and version is the caller's.
void describe_estimate(const JointResult& result, const CompressedRecording& recording, bool noise_given,
                       ParameterFile& file);

// Its parts: what is not about noise or quality, and the white noise.
void describe_random_walk(const NoiseModel& noise, ParameterFile& file);
void describe_model(const JointResult& result, const CompressedRecording& recording, ParameterFile& file);
// Of several recordings of one unit: which, the biases of each, and how well they repeat from one switch-on to the next.
void describe_turn_ons(const TurnOns& turn_ons, const std::vector<SwitchOn>& switched_on, ParameterFile& file);
std::vector<std::string> turn_on_words(const TurnOns& turn_ons);  // the last of it, a line a bias
// Free parameters that are not determined, with a space between.
std::string undetermined_parameters(const JointResult& result);
// What belongs to the work: hash, method, version, time, verdict.
void complete_parameters(const Diagnosis& diagnosis, const DiagnosisContext& context, ParameterFile& file);

// What the sigmas of a trusted model hold beyond the fit's own, the spread over effects that are confounded and what came near to being claimed: keys
// quality.alias.<parameter>, where there is any.
inline constexpr const char* alias_key_prefix = "quality.alias.";
void describe_alias(const Diagnosis& diagnosis, ParameterFile& file);

ParameterFile diagnosis_parameters(const Diagnosis& diagnosis, const DiagnosisContext& context);

// All that there is to write, made before anything is written.
struct DiagnosisFiles {
  Document report;  // without a title it is for the terminal alone
  std::string conf;
  std::optional<ParameterFile> parameters;  // none where nothing was tested
};
DiagnosisFiles diagnosis_files(const Diagnosis& diagnosis, const DiagnosisContext& context);
// All three into `folder`, which exists; parameters.conf last. What cannot be formatted leaves the folder as it was; what is empty is
// not written, and removed where it was. Returns why the report has no plots; empty: it has them.
Result<std::string> write_diagnosis(const std::string& folder, const DiagnosisFiles& files,
                                    const GnuplotOptions& gnuplot = {});

// What differs in the diagnosis of hand-turned data (calib/evidence/rest_diagnosis.h): the errors are those of gravity's norm and
// direction and of the gyros at rest, not velocities.
// "gravity norm at rest 0.93 mm/s² rms, direction after a rotation 6.80 mrad, gyros at rest 0.067 °/s"
std::string error_text(const RestErrors& errors);

// Parameters, sigmas, effects, white noise and errors of a fit.
void describe_rest_fit(const RestFit& fit, const JointResult& joint, const RestData& data, ParameterFile& file);

// What a diagnosis of hand-turned data leaves on disk: the document of report.h, with the errors that rests and rotations by hand can show
// (docs/import.md), and the other two files of it.
DiagnosisFiles rest_diagnosis_files(const RestDiagnosis& result, const RestData& data, const DiagnosisContext& context);

}  // namespace turncal
