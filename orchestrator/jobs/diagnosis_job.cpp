#include "orchestrator/jobs/diagnosis_job.h"

#include "calib/evidence/rest_diagnosis.h"
#include "calib/rests/single_pose.h"
#include "imu_io/base/format_number.h"
#include "orchestrator/figures/diagnosis_figures.h"
#include "orchestrator/jobs/calibration_job.h"
#include "orchestrator/jobs/navigation/navigation_job.h"
#include "orchestrator/report/diagnosis_file.h"
#include "orchestrator/report/rest_as_diagnosis.h"
#include "orchestrator/report/result_table.h"

namespace turncal {
namespace {

using Recordings = std::vector<const LoadedRecording*>;

// All of one unit, and those to be fitted together of one place and one rate.
Status check_together(const Recordings& fitted, const Recordings& holdouts) {
  Recordings all = fitted;
  all.insert(all.end(), holdouts.begin(), holdouts.end());
  TRY(check_same_unit(all));
  const LoadedRecording& first = *fitted.front();
  const bool several = fitted.size() > 1 || holdouts.size() > 1;
  if (several && first.by_hand)
    return input_error(first.path + ": " + no_table_angles + ": expected one recording, and one holdout at most");
  for (const LoadedRecording* one : fitted) {
    const auto same = [&](const char* key, double RecordingInfo::*value) -> Status {
      const double is = one->data.info.*value, expected = first.data.info.*value;
      if (is == expected) return {};
      return input_error(one->path + ": " + key + " = " + format_number(is) + ": expected " + format_number(expected) +
                         ", as in " + first.path);
    };
    TRY(same("sample_period_s", &RecordingInfo::sample_period_s));
    TRY(same("latitude_deg", &RecordingInfo::latitude_deg));
    TRY(same("gravity_mps2", &RecordingInfo::gravity_mps2));
  }
  for (const LoadedRecording* one : all) TRY(check_data(*one));
  return {};
}

// What the effects are worth in miles; a note where it cannot be had.
void navigate_effects(const LoadedRecording& recording, const Diagnosis& diagnosis, const DiagnosisRequest& request,
                      DiagnosisContext& context) {
  request.phase("navigating with and without what was added");
  const LoadedRecording& navigated = request.holdouts.empty() ? recording : *request.holdouts.front();
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
  context.worth->source = request.holdouts.empty() ? "fitted recording" : "second recording";
}

Result<DiagnosisOutput> of_table(const Recordings& recordings, const JoinedRecordings& joined,
                                 const DiagnosisRequest& request, DiagnosisContext& context) {
  const LoadedRecording& recording = *recordings.front();
  DiagnosisOptions settings;
  settings.estimate.noise = request.noise;
  settings.base = request.noise ? nullptr : request.base;
  for (const LoadedRecording* holdout : request.holdouts) settings.holdouts.push_back(&holdout->data);
  request.phase("diagnosing: fit, what may be missing, held-out data");
  Diagnosis diagnosis = diagnose(joined, settings);
  const std::string open = undetermined_parameters(diagnosis.extended);
  if (diagnosis.verdict == Verdict::not_tested && diagnosis.extended.converged && !open.empty())
    return Error{ErrorKind::unit_failed, recording.path + ": this recording does not determine " + open + ": " +
                                             why_open(joined.data, diagnosis.extended)};
  if (diagnosis.verdict == Verdict::not_tested)
    return Error{ErrorKind::unit_failed, recording.path + ": " + diagnosis.reason};
  note_mounting(diagnosis.base, context.notes);
  if (recordings.size() > 1)
    for (std::string& line : turn_on_words(diagnosis.each.turn_ons)) context.notes.push_back(std::move(line));
  context.noise_given = request.noise.has_value();
  if (has_after(diagnosis) && !request.samples.empty()) navigate_effects(recording, diagnosis, request, context);
  request.phase("writing the report");
  DiagnosisFiles files = diagnosis_files(diagnosis, context);
  return DiagnosisOutput{std::move(diagnosis), std::move(files)};
}

// It lies still all the time: what that tells.
Result<DiagnosisOutput> of_single_pose(const LoadedRecording& recording, const DiagnosisContext& context) {
  const LoadedRecording in_seconds = TRY(load_recording(recording.path, {}, CompressionOptions{}));
  const Result<SinglePose> pose = analyse_single_pose(in_seconds.data);
  if (!pose) return input_error(recording.path + ": " + pose.error().message);
  DiagnosisOutput output;
  output.diagnosis.verdict = Verdict::not_tested;
  output.files.conf = format_pose(*pose);
  for (const std::string& note : context.notes) output.files.report.add(Paragraph{note, "note"});
  output.files.report.add(pose_facts(*pose));
  return output;
}

Result<DiagnosisOutput> of_hand_turned(const LoadedRecording& recording, const DiagnosisRequest& request,
                                       DiagnosisContext& context) {
  if (request.noise)
    return input_error(recording.path + ": " + no_table_angles +
                       ": expected no --arw, --vrw or bias instability, the noise is measured in the rests");
  const RestData data = make_rest_data(recording.data);
  if (data.rests.size() == 1) return of_single_pose(recording, context);
  std::optional<RestData> other;
  if (!request.holdouts.empty()) {
    other = make_rest_data(request.holdouts.front()->data);
    if (other->legs.empty())
      return input_error(request.holdouts.front()->path + ": holds no rotation between two rests");
  }
  request.phase("diagnosing: fit, what may be missing, rests left out");
  Result<RestDiagnosis> result = diagnose_rests(data, other ? &*other : nullptr);
  if (!result) return Error{result.error().kind, recording.path + ": " + result.error().message};
  context.notes.insert(context.notes.end(), data.notes.begin(), data.notes.end());
  context.method = rest_method;
  context.hand_turned = true;
  request.phase("writing the report");
  DiagnosisFiles files = rest_diagnosis_files(*result, data, context);
  return DiagnosisOutput{std::move(result->diagnosis), std::move(files)};
}

}  // namespace

Result<DiagnosisOutput> diagnose_recordings(const Recordings& recordings, const DiagnosisRequest& request) {
  TRY(check_together(recordings, request.holdouts));
  const LoadedRecording& first = *recordings.front();
  std::vector<const CompressedRecording*> parts;
  for (const LoadedRecording* recording : recordings) parts.push_back(&recording->data);
  const JoinedRecordings joined = join_recordings(parts);
  DiagnosisContext context(joined.data);
  context.recording_hash = first.hash;
  context.time_utc = request.time_utc;
  context.of_run = request.of_run;
  for (const LoadedRecording* recording : recordings) {
    context.recording_path += (context.recording_path.empty() ? "" : ", ") + recording->path;
    context.switched_on.push_back({recording->hash, recording->data.info.started_utc_s});
  }
  for (const LoadedRecording* holdout : request.holdouts)
    context.holdout_path += (context.holdout_path.empty() ? "" : ", ") + holdout->path;
  for (const Recordings& all : {recordings, request.holdouts})
    for (const LoadedRecording* loaded : all) {
      const std::string damage = describe(loaded->damage);
      if (!damage.empty()) context.notes.push_back(loaded->path + ": " + damage);
    }
  return first.by_hand ? of_hand_turned(first, request, context) : of_table(recordings, joined, request, context);
}

}  // namespace turncal
