#include "orchestrator/fleet/prior_history.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>

#include "calib/fleet/fleet_prior.h"
#include "calib/model/limits.h"
#include "orchestrator/fleet/fleet_members.h"
#include "orchestrator/jobs/navigation/calibrated_intervals.h"
#include "orchestrator/records/output_folder.h"
#include "orchestrator/report/diagnosis_file.h"

namespace turncal {
namespace {

constexpr const char* source_key = "quality.prior.calibrations_of_others";

bool counts(const ParameterFile& file, const StoredCovariance& stored) {
  for (std::size_t k = 0; k < parameter_keys.size(); ++k)
    if (parameter_is_free[k] && !(file.sigma[k].value_or(0.0) > 0.0)) return false;
  return stored.source == std::string_view("covariance") && is_trusted(file) && !find_further(file, source_key);
}

std::string keys_of(const std::vector<int>& parameters) {
  std::string text;
  for (const int k : parameters) text += (text.empty() ? "" : " ") + parameter_key(k);
  return text;
}

// The estimate again with the noise of the part in it. None: too few units say theirs, or the recording leaves directions open.
std::optional<NoiseOfClass> use_noise(const FleetPrior& prior, const LoadedRecording& recording,
                                      CalibrationOutput& output) {
  if (!prior.noise || !output.fit->noise_fit || !output.fit->undetermined.empty()) return std::nullopt;
  const NoiseOfClass noise = noise_of_class(*prior.noise, *output.fit->noise_fit);
  JointResult again = estimate_with_noise(recording.data, *output.fit, noise.noise);
  if (!again.converged) return std::nullopt;
  *output.fit = std::move(again);
  return noise;
}

void describe_noise(const NoiseOfClass& noise, ParameterFile& file, std::vector<std::string>& notes) {
  constexpr const char* names[] = {"angle_random_walk", "velocity_random_walk"};
  constexpr const char* words[] = {"angle random walk", "velocity random walk"};
  for (const int k : {0, 1}) file.add_further(std::string("quality.prior.share.") + names[k], noise.share[k]);
  notes.push_back(
      fmt::format("prior: its share of the noise: angle random walk {:.0f} %, velocity random walk {:.0f} %",
                  100.0 * noise.share[0], 100.0 * noise.share[1]));
  for (const int k : noise.changed)
    notes.push_back(
        fmt::format("prior: NOT USED for the {}: it is unlike the others' by {:.1f} sigma", words[k], noise.z[k]));
}

Result<std::vector<EarlierCalibration>> read_history(const PriorSource& source, const std::string& recording_hash,
                                                     bool simulated) {
  struct One {
    std::string time_utc;
    EarlierCalibration earlier;
  };
  std::map<std::string, One> by_recording;
  const auto take = [&](const std::string& where, const Result<std::string>& text) {
    const Result<ParameterFile> file = text ? parse_parameter_file(*text, where) : Result<ParameterFile>(text.error());
    if (!file || file->simulated != simulated || file->recording_hash == recording_hash) return;
    const std::string* const part = find_further(*file, "record.part");
    if (!source.part.empty() && (!part || *part != source.part)) return;
    const Result<StoredCovariance> stored = stored_covariance(*file, where);
    if (!stored || !counts(*file, *stored)) return;
    const std::string* const measured = find_further(*file, "record.measured_utc");
    One one{file->time_utc,
            {file->unit_serial, measured ? *measured : file->time_utc, file->parameters, stored->covariance, {}}};
    if (const Result<NoiseModel> noise = stored_noise(*file, where); noise && has_noise(*file))
      one.earlier.noise = *noise;
    const auto [place, is_new] = by_recording.try_emplace(file->recording_hash, one);
    if (!is_new && place->second.time_utc < one.time_utc) place->second = one;
  };
  TRY(each_kept_file(source.from, parameters_name, take));
  std::vector<EarlierCalibration> history;
  for (auto& [hash, one] : by_recording) history.push_back(std::move(one.earlier));
  return history;
}

}  // namespace

Status add_prior(const PriorSource& source, const LoadedRecording& recording, const CalibrationRequest& request,
                 CalibrationOutput& output) {
  const std::string& unit = recording.data.info.unit_serial;
  const std::vector<EarlierCalibration> history =
      TRY(read_history(source, recording.hash, recording.data.info.simulated));
  const std::optional<FleetPrior> prior = fleet_prior(history, unit);
  if (!prior)
    return input_error(fmt::format("{}: expected trusted calibrations of {} other units{}, found {} calibrations",
                                   source.from, fleet_limits.least_prior_units,
                                   source.part.empty() ? "" : " of part " + source.part, history.size()));
  if (!output.fit) return input_error(recording.path + ": a prior: expected a recording with table angles");
  if (!output.fit->undetermined.empty()) {  // its own fit has ended anywhere along what it leaves open
    CalibrationRequest beside = request;
    beside.known = from_vector(prior->mean);
    CalibrationOutput again = TRY(calibrate_recording(recording, beside));
    output = std::move(again);
  }
  const std::optional<NoiseOfClass> noise = use_noise(*prior, recording, output);
  const PriorEffect effect = use_prior(*prior, *output.fit);
  ParameterFile& file = output.file;
  std::erase_if(file.further, [](const auto& key) {
    return key.first.starts_with("noise.") || (key.first.starts_with("quality.") && key.first != "quality.trusted");
  });
  describe_estimate(*output.fit, recording.data, false, file);
  file.add_further(source_key, static_cast<double>(prior->units));
  file.add_further("quality.prior.calibrations_of_unit", static_cast<double>(prior->own));
  if (noise) describe_noise(*noise, file, output.notes);
  if (!effect.changed.empty()) {
    const std::string keys = keys_of(effect.changed);
    file.add_further("quality.prior.not_used", keys);
    std::string line =
        std::string("prior: NOT USED: ") +
        (prior->own > 0 ? "the unit has changed since its last calibration:" : "the unit is unlike the others:");
    for (const int k : effect.changed)
      line += fmt::format(" {} by {:.1f} sigma", parameter_key(k), effect.from_prior[k]);
    output.notes.push_back(line);
    return {};
  }
  std::string shares = "prior: its share of the information:";
  for (std::size_t k = 0; k < parameter_keys.size(); ++k) {
    if (!parameter_is_free[k]) continue;
    const double share = effect.share[static_cast<Eigen::Index>(k)];
    file.add_further(fmt::format("quality.prior.share.{}", parameter_keys[k]), share);
    shares += fmt::format(" {} {:.0f} %", parameter_keys[k], 100.0 * share);
  }
  output.notes.push_back(
      fmt::format("prior: {} other units, {} earlier calibrations of this one", prior->units, prior->own));
  if (prior->own == 0 && prior->pairs < fleet_limits.least_prior_pairs)
    output.notes.push_back(
        "prior: the unit's own history is not used: too few units were calibrated twice to tell how much a unit "
        "changes");
  output.notes.push_back(shares);
  return {};
}

}  // namespace turncal
