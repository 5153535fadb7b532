// From a loaded recording to verdict, report and files of a diagnosis: the one place where a diagnosis is called, by
// `turncal diagnose` and at the end of every run.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "calib/evidence/diagnosis.h"
#include "orchestrator/jobs/loaded_recording.h"
#include "orchestrator/report/diagnosis_file.h"

namespace turncal {

struct DiagnosisRequest {
  std::string time_utc;  // for the record
  std::vector<const LoadedRecording*> holdouts = {};
  std::optional<NoiseModel> noise;    // given, not measured
  const JointResult* base = nullptr;  // the joint estimate of this recording, where there is one already
  std::string samples;  // path of what is navigated for it, of the holdout where there is one; empty: nothing is
  bool of_run = false;  // the verdict on the unit is the run's to say
  std::function<void(const std::string&)> phase = [](const std::string&) {};  // told what is going on
};

struct DiagnosisOutput {
  Diagnosis diagnosis;
  DiagnosisFiles files;
};

// Of one recording, or of several of one unit (calib/joint/several_recordings.h), which are of a table then.
// Errors: kind input for recordings that cannot be diagnosed (together), unit_failed when the base model does not settle.
Result<DiagnosisOutput> diagnose_recordings(const std::vector<const LoadedRecording*>& recordings,
                                            const DiagnosisRequest& request);
inline Result<DiagnosisOutput> diagnose_recording(const LoadedRecording& recording, const DiagnosisRequest& request) {
  return diagnose_recordings({&recording}, request);
}

}  // namespace turncal
