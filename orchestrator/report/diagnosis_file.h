// The files of a diagnosis: diagnosis.conf, parameters.conf and report.html, each written whole or not at all.
//
// diagnosis.conf (docs/report.md): every file has every key; an empty list and an unknown number are empty values.
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

// Add parameters, sigmas, effects (strongest first, with tau_s if an effect has a time constant), noise and quality of a joint
// estimate; every parameter file has the same keys. The caller adds the recording (describe_recording, hash), method, time and version.
void describe_estimate(const JointResult& result, const CompressedRecording& recording, bool noise_given,
                       ParameterFile& file);

// Its parts: the white noise, and everything except noise and quality.
void describe_random_walk(const NoiseModel& noise, ParameterFile& file);
void describe_model(const JointResult& result, const CompressedRecording& recording, ParameterFile& file);
// Adds, for several recordings of one unit, which they are, the biases of each, and the turn-on repeatability.
void describe_turn_ons(const TurnOns& turn_ons, const std::vector<SwitchOn>& switched_on, ParameterFile& file);
std::vector<std::string> turn_on_words(const TurnOns& turn_ons);  // turn-on repeatability, a line for each bias
// Returns the undetermined free parameters, separated by blanks.
std::string undetermined_parameters(const JointResult& result);
// Adds hash, method, version, time and verdict.
void complete_parameters(const Diagnosis& diagnosis, const DiagnosisContext& context, ParameterFile& file);

// Adds what the sigmas of a trusted model contain beyond the fit's own: the spread over confounded effects, and over effects that were
// nearly claimed. Keys quality.alias.<parameter>, if there is any.
inline constexpr const char* alias_key_prefix = "quality.alias.";
void describe_alias(const Diagnosis& diagnosis, ParameterFile& file);

ParameterFile diagnosis_parameters(const Diagnosis& diagnosis, const DiagnosisContext& context);

// Everything to be written, made before anything is written.
struct DiagnosisFiles {
  Document report;  // without a title: for the terminal alone
  std::string conf;
  std::optional<ParameterFile> parameters;  // none when nothing was tested
};
DiagnosisFiles diagnosis_files(const Diagnosis& diagnosis, const DiagnosisContext& context);
// Writes all three into `folder`, which must exist; parameters.conf last. If one cannot be formatted the folder stays as it was. An empty file is
// not written, and an older one is removed. Returns why the report has no plots; empty: it has them.
Result<std::string> write_diagnosis(const std::string& folder, const DiagnosisFiles& files,
                                    const GnuplotOptions& gnuplot = {});

// The diagnosis of hand-turned data (calib/evidence/rest_diagnosis.h): its errors are those of gravity's norm and
// direction and of the gyros at rest, not velocities.
// Returns "gravity norm at rest 0.93 mm/s² rms, direction after a rotation 6.80 mrad, gyros at rest 0.067 °/s".
std::string error_text(const RestErrors& errors);

// Adds parameters, sigmas, effects, white noise and errors of a fit.
void describe_rest_fit(const RestFit& fit, const JointResult& joint, const RestData& data, ParameterFile& file);

// Returns the files of a diagnosis of hand-turned data: the document of report.h, with the errors that rests and rotations by hand can show
// (docs/import.md), and the other two.
DiagnosisFiles rest_diagnosis_files(const RestDiagnosis& result, const RestData& data, const DiagnosisContext& context);

}  // namespace turncal
