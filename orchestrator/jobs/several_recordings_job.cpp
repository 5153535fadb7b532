#include <algorithm>
#include <cmath>
#include <cstdio>

#include "calib/joint/several_recordings.h"
#include "orchestrator/jobs/calibration_job.h"
#include "orchestrator/report/diagnosis_file.h"

namespace turncal {
namespace {

// What one recording does not determine the others may: one that leaves directions open, or does not settle for it, is looked at beside one that does not.
Result<std::vector<CalibrationOutput>> calibrate_each(const std::vector<LoadedRecording>& recordings,
                                                      CalibrationRequest request) {
  request.partial = true;
  std::vector<Result<CalibrationOutput>> each;
  for (const LoadedRecording& recording : recordings) each.push_back(calibrate_recording(recording, request));
  const auto whole = [](const Result<CalibrationOutput>& one) { return one.ok() && one->fit->undetermined.empty(); };
  const auto known = std::find_if(each.begin(), each.end(), whole);
  if (known != each.end()) request.known = (*known)->fit->parameters;
  std::vector<CalibrationOutput> outputs;
  for (std::size_t k = 0; k < each.size(); ++k) {
    if (request.known && !whole(each[k])) {
      each[k] = calibrate_recording(recordings[k], request);
      if (each[k])
        each[k]->notes.push_back("determines too little by itself: its biases beside the parameters of " +
                                 recordings[static_cast<std::size_t>(known - each.begin())].path);
    }
    if (!each[k]) return each[k].error();
    outputs.push_back(std::move(*each[k]));
  }
  return outputs;
}

}  // namespace

Result<CalibrationOutput> calibrate_recordings(const std::vector<LoadedRecording>& recordings,
                                               const CalibrationRequest& request) {
  if (recordings.size() == 1) return calibrate_recording(recordings.front(), request);
  if (request.method != calibration_methods[0])
    return input_error("--method " + request.method + ": expected joint where there are several recordings");
  std::vector<const LoadedRecording*> all;
  std::vector<SwitchOn> switched_on;
  for (const LoadedRecording& recording : recordings) {
    if (recording.by_hand)
      return input_error(recording.path + ": " + no_table_angles + ": expected several recordings to be from a table");
    all.push_back(&recording);
    switched_on.push_back({recording.hash, recording.data.info.started_utc_s});
  }
  TRY(check_same_unit(all));
  CalibrationOutput output;
  std::vector<CalibrationOutput> each = TRY(calibrate_each(recordings, request));
  std::vector<JointResult> estimates;
  bool judged = true;
  for (std::size_t k = 0; k < recordings.size(); ++k) {
    CalibrationOutput& one = each[k];
    output.notes.push_back(recordings[k].path + ":");
    for (const std::string& note : one.notes) output.notes.push_back("  " + note);
    judged = judged && one.fit->whiteness.level > 0.0;
    if (!one.distrust.empty()) output.distrust = recordings[k].path + ": " + one.distrust;
    estimates.push_back(std::move(*one.fit));
  }
  const SeveralRecordings several = combine_recordings(estimates);
  const std::string open = undetermined_parameters(several.unit);
  if (!open.empty() && !request.partial)
    return not_determined("these recordings do not determine " + open + ": expected the steps that do");
  ParameterFile file = std::move(each.front().file);
  file.further.clear();
  file.sigma = {};
  describe_estimate(several.unit, recordings.front().data, false, file);
  if (!several.agree) output.distrust = "the recordings contradict each other";
  describe_trust(judged && output.distrust.empty(), file);
  describe_turn_ons(several.turn_ons, switched_on, file);
  file.add_further("quality.recordings_agree", std::string(several.agree ? "true" : "false"));
  file.add_further("quality.recordings_p_value", several.p_value);
  output.file = std::move(file);
  char text[240];
  std::snprintf(text, sizeof text,
                "%zu recordings, one unit: what they say of it differs by chi-square %.1f of %d, p %.2g%s",
                recordings.size(), several.disagreement, several.degrees, several.p_value,
                several.agree ? "" : ": THEY CONTRADICT EACH OTHER; every sigma is widened until they do not");
  output.notes.push_back(text);
  const std::vector<std::string> words = turn_on_words(several.turn_ons);
  output.notes.insert(output.notes.end(), words.begin(), words.end());
  output.fit = several.unit;
  return output;
}

std::optional<UnitStatistics> statistics_of(const std::vector<LoadedRecording>& recordings,
                                            const CalibrationOutput& output) {
  if (!output.fit) return std::nullopt;
  if (recordings.size() == 1) return unit_statistics(recordings.front().data, *output.fit);
  std::vector<const CompressedRecording*> all;
  for (const LoadedRecording& recording : recordings) all.push_back(&recording.data);
  return unit_statistics(all);
}

}  // namespace turncal
