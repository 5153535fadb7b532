#include "orchestrator/jobs/diagnosis_job.h"

#include <algorithm>

#include "calib/rest_diagnosis/rest_diagnosis.h"
#include "calib/rests/single_pose.h"
#include "imu_io/base/format_number.h"
#include "orchestrator/figures/diagnosis_figures.h"
#include "orchestrator/jobs/calibration_job.h"
#include "orchestrator/jobs/navigation/effect_worth.h"
#include "orchestrator/report/diagnosis_text.h"
#include "orchestrator/report/pose_report.h"
#include "orchestrator/report/rest_as_diagnosis.h"
#include "orchestrator/report/rest_report.h"

namespace turncal {
namespace {

Status check_holdout(const LoadedRecording& other, const LoadedRecording& recording) {
  const RecordingInfo& holdout = other.data.info;
  const RecordingInfo& fitted = recording.data.info;
  const auto refuse = [&](const std::string& key, const std::string& value, const std::string& expected) -> Status {
    return input_error(other.path + ": " + key + " = '" + value + "': expected '" + expected +
                       "', as in the recording to be fitted");
  };
  if (holdout.unit_serial != fitted.unit_serial) return refuse("unit_serial", holdout.unit_serial, fitted.unit_serial);
  const auto kind = [](IncrementKind k) { return std::string(k == IncrementKind::pulses ? "pulses" : "rad or mps"); };
  if (holdout.gyro_increment != fitted.gyro_increment)
    return refuse("gyro_increment", kind(holdout.gyro_increment), kind(fitted.gyro_increment));
  if (holdout.accel_increment != fitted.accel_increment)
    return refuse("accel_increment", kind(holdout.accel_increment), kind(fitted.accel_increment));
  if (fitted.accel_increment == IncrementKind::pulses && holdout.accel_pulse_mps != fitted.accel_pulse_mps)
    return refuse("accel_pulse_mps", format_number(holdout.accel_pulse_mps), format_number(fitted.accel_pulse_mps));
  if (other.hash == recording.hash) {
    return input_error(other.path +
                       ": is the recording to be fitted itself: expected data that is not used in the fit");
  }
  if (other.by_hand != recording.by_hand)
    return input_error(other.path + ": expected a recording " + (recording.by_hand ? "without" : "with") +
                       " table angles, as the one to be fitted");
  return check_data(other);
}

// What the effects are worth in miles; a note where it cannot be had.
void navigate_effects(const LoadedRecording& recording, const Diagnosis& diagnosis, const DiagnosisRequest& request,
                      DiagnosisContext& context) {
  request.phase("navigating with and without what was added");
  const LoadedRecording& navigated = request.holdout ? *request.holdout : recording;
  const RecordingInfo& info = navigated.data.info;
  const Segments& segments = navigated.data.segments;
  const double to_s =
      static_cast<double>(segments.back().end_sample - segments.front().start_sample) * info.sample_period_s;
  Result<NavigationWorth> worth = worth_of_effects(diagnosis, context, request.samples, to_s);
  if (!worth) {
    context.notes.push_back("not navigated: " + worth.error().message);
    return;
  }
  context.worth = std::move(*worth);
  context.worth->source = request.holdout ? "second recording" : "fitted recording";
}

Result<DiagnosisOutput> of_table(const LoadedRecording& recording, const DiagnosisRequest& request,
                                 DiagnosisContext& context) {
  DiagnosisOptions settings;
  settings.estimate.noise = request.noise;
  settings.base = request.noise ? nullptr : request.base;
  if (request.holdout) settings.holdout = &request.holdout->data;
  request.phase("diagnosing: fit, scores of the catalogue, selection, held-out data");
  Diagnosis diagnosis = diagnose(recording.data, settings);
  if (diagnosis.verdict == Verdict::not_tested)
    return Error{ErrorKind::unit_failed, recording.path + ": " + diagnosis.reason};
  context.false_alarm = settings.false_alarm;
  context.noise_given = request.noise.has_value();
  if (has_after(diagnosis) && !request.samples.empty()) navigate_effects(recording, diagnosis, request, context);
  request.phase("writing the report");
  DiagnosisFiles files = diagnosis_files(diagnosis, context);
  std::vector<std::string> table = terminal_table(diagnosis, context);
  return DiagnosisOutput{std::move(diagnosis), std::move(files), std::move(table)};
}

// It lies still all the time: what that tells.
Result<DiagnosisOutput> of_single_pose(const LoadedRecording& recording) {
  const Result<LoadedRecording> in_seconds = load_recording(recording.path, {}, CompressionOptions{});
  if (!in_seconds) return in_seconds.error();
  const Result<SinglePose> pose = analyse_single_pose(in_seconds->data);
  if (!pose) return input_error(recording.path + ": " + pose.error().message);
  DiagnosisOutput output;
  output.diagnosis.verdict = Verdict::not_tested;
  output.files.conf = format_pose(*pose);
  output.table = pose_table(*pose);
  return output;
}

Result<DiagnosisOutput> of_hand_turned(const LoadedRecording& recording, const DiagnosisRequest& request,
                                       DiagnosisContext& context) {
  if (request.noise)
    return input_error(recording.path + ": " + no_table_angles +
                       ": expected no --arw, --vrw or bias instability, the noise is measured in the rests");
  const RestData data = make_rest_data(recording.data);
  if (data.rests.size() == 1) return of_single_pose(recording);
  std::optional<RestData> other;
  RestDiagnosisOptions settings;
  if (request.holdout) {
    other = make_rest_data(request.holdout->data);
    if (other->legs.empty()) return input_error(request.holdout->path + ": holds no rotation between two rests");
    settings.holdout = &*other;
  }
  request.phase("diagnosing: fit, scores of the catalogue, selection, rests left out");
  const Result<RestDiagnosis> result = diagnose_rests(data, settings);
  if (!result) return Error{result.error().kind, recording.path + ": " + result.error().message};
  context.notes.insert(context.notes.end(), data.notes.begin(), data.notes.end());
  context.false_alarm = settings.false_alarm;
  context.method = rest_method;
  context.hand_turned = true;
  Diagnosis diagnosis = as_diagnosis(*result, data);
  request.phase("writing the report");
  DiagnosisFiles files = rest_diagnosis_files(*result, data, diagnosis, context);
  std::vector<std::string> table =
      result->base.converged ? terminal_table(diagnosis, context, rest_words(*result, data, diagnosis, Alphabet::plain))
                             : std::vector{"verdict     " + verdict_sentence(diagnosis, context, Alphabet::plain)};
  return DiagnosisOutput{std::move(diagnosis), std::move(files), std::move(table)};
}

}  // namespace

Result<DiagnosisOutput> diagnose_recording(const LoadedRecording& recording, const DiagnosisRequest& request) {
  if (Status status = check_data(recording); !status) return status.error();
  DiagnosisContext context(recording.data);
  context.recording_path = recording.path;
  context.recording_hash = recording.hash;
  context.time_utc = request.time_utc;
  context.of_run = request.of_run;
  for (const LoadedRecording* loaded : {&recording, request.holdout}) {
    if (loaded == nullptr) continue;
    const std::string damage = describe(loaded->damage);
    if (!damage.empty()) context.notes.push_back(loaded->path + ": " + damage);
  }
  if (request.holdout) {
    if (Status status = check_holdout(*request.holdout, recording); !status) return status.error();
    context.holdout_path = request.holdout->path;
  }
  Result<DiagnosisOutput> output = (recording.by_hand ? of_hand_turned : of_table)(recording, request, context);
  if (output) output->table.insert(output->table.begin(), context.notes.begin(), context.notes.end());
  return output;
}

}  // namespace turncal
