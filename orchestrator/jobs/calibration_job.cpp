#include "orchestrator/jobs/calibration_job.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>

#include "calib/closed_form/closed_form.h"
#include "calib/joint/joint_estimate.h"
#include "calib/rests/rest_model.h"
#include "calib/statistics/compression.h"
#include "calib/statistics/segmentation.h"
#include "orchestrator/jobs/compress_source.h"
#include "orchestrator/report/rest_view.h"
#include "orchestrator/station/version.h"

namespace turncal {

namespace {

void note_data(const RecordingSource& source, const CompressedRecording& recording, std::vector<std::string>& notes) {
  if (const std::string damage = describe(source.damage()); !damage.empty()) notes.push_back(damage);
  std::map<DataEvent::Kind, std::int64_t> counts;
  for (const DataEvent& event : recording.events) counts[event.kind] += event.count;
  for (const auto& [kind, count] : counts) {
    notes.push_back("data: " + std::to_string(count) + " x " + to_string(kind));
  }
}

Status closed_form(const CompressedRecording& recording, CalibrationOutput& output) {
  const Result<ClosedFormResult> result = closed_form_calibrate(recording, start_parameters(recording.info));
  if (!result) return result.error();
  if (!result->converged) return Error{ErrorKind::unit_failed, "the calibration does not settle: " + result->message};
  output.file.parameters = to_vector(result->parameters);
  output.file.model = "base";
  char text[120];
  std::snprintf(text, sizeof text, "closed form: settled after %d passes over %lld samples", result->passes,
                static_cast<long long>(recording.samples));
  output.notes.push_back(text);
  return {};
}

void note_joint(const JointResult& result, std::vector<std::string>& notes) {
  char text[200];
  std::snprintf(text, sizeof text, "joint estimate: settled after %d iterations; normalised residual %.4f%s",
                result.iterations, result.normalised_rms,
                result.whiteness.white ? "" : ", NOT WHITE: the noise model does not explain the residual");
  notes.push_back(text);
  if (!result.start.mounting_text.empty())
    notes.push_back("the unit is mounted " + result.start.mounting_text + " against the table's axes");
  for (const Fault& fault : result.faults) {
    notes.push_back("fault: " + fault.what + " at sample " + std::to_string(fault.first_sample) + ": " + fault.action);
  }
  for (const Undetermined& direction : result.undetermined) {
    std::string line = "not determined by this recording:";
    for (const auto& [key, weight] : direction.combination) line += " " + key;
    notes.push_back(line);
  }
}

std::string undetermined_keys(const JointResult& result) {
  std::string keys;
  for (std::size_t i = 0; i < parameter_keys.size(); ++i) {
    if (parameter_is_free[i] && !result.determined[i]) keys += " " + std::string(parameter_keys[i]);
  }
  return keys;
}

Status joint(const CompressedRecording& recording, bool partial, CalibrationOutput& output) {
  const JointResult result = joint_estimate(recording);
  if (!result.converged) return Error{ErrorKind::unit_failed, "the calibration does not settle: " + result.message};
  if (const std::string keys = undetermined_keys(result); !keys.empty() && !partial) {
    return input_error("this recording does not determine" + keys +
                       ": expected the steps that do (--partial writes what there is)");
  }
  output.file.parameters = to_vector(result.parameters);
  for (std::size_t i = 0; i < output.file.sigma.size(); ++i) {
    const double sigma = result.sigma[static_cast<Eigen::Index>(i)];
    if (result.determined[i] && sigma > 0.0) output.file.sigma[i] = sigma;
  }
  output.file.model = "base";
  const NoiseModel& noise = result.noise;
  const auto axes = [&output](const char* name, const Eigen::Vector3d& value, double si) {
    for (int i = 0; i < 3; ++i) output.file.add_further(std::string(name) + "." + "xyz"[i], value[i] / si);
  };
  axes("noise.angle_random_walk_deg_per_rt_h", noise.angle_random_walk, radprs_per_degprh);
  axes("noise.velocity_random_walk_ug_per_rt_hz", noise.velocity_random_walk, mpsprs_per_ugprHz);
  output.file.add_further("noise.gyro_bias_instability_degph", noise.gyro_bias_instability_radps / radps_per_degph);
  output.file.add_further("noise.accel_bias_instability_ug",
                          noise.accel_bias_instability_mps2 / standard_gravity_mps2 * 1e6);
  output.file.add_further("quality.normalised_rms", result.normalised_rms);
  output.file.add_further("quality.white", result.whiteness.white ? "true" : "false");
  output.file.add_further("quality.trusted", result.whiteness.white ? "true" : "false");
  output.file.add_further("quality.faults", static_cast<double>(result.faults.size()));
  for (std::size_t k = 0; k < result.faults.size(); ++k) {
    const Fault& fault = result.faults[k];
    output.file.add_further("quality.fault." + std::to_string(k + 1), "samples " + std::to_string(fault.first_sample) +
                                                                          " to " + std::to_string(fault.last_sample) +
                                                                          ": " + fault.what + "; " + fault.action);
  }
  // A row a parameter: its covariances with those before it in the order of the file, its variance last.
  for (std::size_t i = 0; i < result.free.size(); ++i) {
    const int key = result.free[i];
    if (key >= parameter_count || !result.determined[static_cast<std::size_t>(key)]) continue;
    std::string row;
    for (std::size_t j = 0; j <= i; ++j) {
      const int other = result.free[j];
      if (other >= parameter_count || !result.determined[static_cast<std::size_t>(other)]) continue;
      char text[32];
      std::snprintf(text, sizeof text, "%.9e",
                    result.covariance(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)));
      row += (row.empty() ? "" : " ") + std::string(text);
    }
    output.file.add_further("quality.covariance." + std::string(parameter_keys[static_cast<std::size_t>(key)]), row);
  }
  note_joint(result, output.notes);
  return {};
}

Status rests_by_hand(const CompressedRecording& recording, bool partial, CalibrationOutput& output) {
  const RestData data = make_rest_data(recording);
  const Result<RestFit> fit = fit_rests(data, EffectModel{});
  if (!fit) return fit.error();
  if (!fit->converged) return Error{ErrorKind::unit_failed, "the calibration does not settle: " + fit->message};
  if (!fit->undetermined.empty() && !partial) {
    std::string keys;
    for (const std::string& key : fit->undetermined) keys += " " + key;
    return input_error("these rests and rotations do not determine" + keys +
                       ": expected more of them, about other axes (--partial writes what there is)");
  }
  describe_rest_fit(*fit, {}, data, output.file);
  output.notes.push_back("no table angles: " + std::to_string(data.rests.size()) + " rests and " +
                         std::to_string(data.legs.size()) + " rotations by hand, settled after " +
                         std::to_string(fit->iterations) + " iterations");
  output.notes.push_back("errors: " + error_text(fit->errors));
  output.notes.push_back("left out in turn: " + error_text(fit->left_out));
  for (std::size_t k = 0; k < data.legs.size(); ++k)
    if (!data.legs[k].fault.empty())
      output.notes.push_back("rotation " + std::to_string(k + 1) + " set aside: " + data.legs[k].fault);
  for (const std::string& key : fit->undetermined) output.notes.push_back("not determined by this recording: " + key);
  return {};
}

}  // namespace

Result<CalibrationOutput> calibrate_recording(RecordingSource& source, const CalibrationRequest& request) {
  const Result<CompressedRecording> recording = compress_source(source);
  if (!recording) return recording.error();
  CalibrationOutput output;
  if (std::isfinite(recording->mean_temperature_c)) output.mean_temperature_c = recording->mean_temperature_c;
  for (const Block& block : recording->blocks) {
    if (!std::isfinite(block.temperature_c)) continue;
    const double temperature_c = block.temperature_c;
    output.min_temperature_c = std::min(output.min_temperature_c.value_or(temperature_c), temperature_c);
    output.max_temperature_c = std::max(output.max_temperature_c.value_or(temperature_c), temperature_c);
  }
  note_data(source, *recording, output.notes);
  const bool closed = request.method == "closed-form";
  const bool by_hand = without_table_angles(source.segments());
  if (closed && by_hand)
    return input_error(source.path() +
                       ": has no table angles: expected the fourteen steps of a table for --method closed-form");
  if (Status status = by_hand  ? rests_by_hand(*recording, request.partial, output)
                      : closed ? closed_form(*recording, output)
                               : joint(*recording, request.partial, output);
      !status) {
    return Error{status.error().kind, source.path() + ": " + status.error().message};
  }
  Result<std::string> hash = source.content_hash();
  if (!hash) return hash.error();
  describe_recording(source.info(), output.file);
  output.file.recording_hash = *hash;
  output.file.method = by_hand ? rest_method : request.method;
  output.file.software_version = software_version();
  output.file.time_utc = request.time_utc;
  return output;
}

}  // namespace turncal
