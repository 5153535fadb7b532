#include "orchestrator/report/diagnosis_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "imu_io/base/clock.h"
#include "imu_io/base/data_text.h"
#include "imu_io/base/files.h"
#include "imu_io/base/text.h"
#include "orchestrator/records/output_folder.h"
#include "orchestrator/station/number_text.h"
#include "orchestrator/station/version.h"

namespace turncal {

namespace {

// Returns the effects in the order of their strongest components.
std::vector<std::string> by_strength(const JointResult& result) {
  std::vector<const EstimatedEffect*> order;
  for (const EstimatedEffect& e : result.effects)
    if (e.column.entry != nullptr) order.push_back(&e);
  std::ranges::stable_sort(
      order, [](auto* a, auto* b) { return std::abs(a->value) * b->sigma > std::abs(b->value) * a->sigma; });
  std::vector<std::string> names;
  for (const EstimatedEffect* e : order)
    if (std::ranges::find(names, e->column.entry->name) == names.end()) names.emplace_back(e->column.entry->name);
  return names;
}

// Adds a row for each parameter: its covariances with the previous ones in the order of the file, its variance last.
void describe_covariance(const JointResult& result, ParameterFile& file) {
  const auto left_out = [&result](int key) { return key >= parameter_count || !result.determined[std::size_t(key)]; };
  if (result.covariance.rows() < Eigen::Index(result.free.size())) return;
  for (std::size_t i = 0; i < result.free.size(); ++i) {
    if (left_out(result.free[i])) continue;
    std::vector<double> row;
    for (std::size_t j = 0; j <= i; ++j)
      if (!left_out(result.free[j])) row.push_back(result.covariance(Eigen::Index(i), Eigen::Index(j)));
    file.add_further("quality.covariance." + parameter_key(result.free[i]), fmt::format("{:.9e}", fmt::join(row, " ")));
  }
}

}  // namespace

std::string format_diagnosis(const Diagnosis& d, const std::optional<NavigationWorth>& worth) {
  KeyValues lines;
  lines.comment("turncal diagnosis: which effect the 24 parameters lack, and the error before and after it was added");
  lines.text("verdict", to_string(d.verdict));
  lines.flag("quality.trusted", d.trusted());
  lines.text("quality.reason", plain(d.why_not_trusted));
  lines.text("reason", plain(brief_reason(d)));
  lines.text("statement", d.reason);
  lines.text("effects", join(d.effect_names));
  if (d.statements.tested) {
    lines.number("missing.probability", d.statements.anything);
    int number = 0;
    for (const Statement& node : d.statements.nodes) {
      const std::string begin = "missing." + std::to_string(++number) + ".";
      lines.text(begin + "sensor", node.sensor);
      lines.text(begin + "quantity", node.quantity);
      lines.text(begin + "driver", node.driver);
      lines.text(begin + "formula", node.formula);
      lines.number(begin + "probability", node.probability);
    }
  }
  if (const OmnibusTest* worst = d.omnibus.worst()) {
    lines.text("lack_of_fit.worst", worst->what);
    lines.number("lack_of_fit.log10_probability", worst->log10_p);
    lines.number("lack_of_fit.log10_limit", d.omnibus.log10_limit());
  }
  const auto add = [&lines](const EstimatedEffect& e) {
    lines.number("effect." + e.column.key(), e.value);
    lines.number("sigma.effect." + e.column.key(), e.sigma);
  };
  for (const std::string& name : d.effect_names) {
    const auto parts = components_of(d.extended, name);
    for (const EstimatedEffect* e : parts) add(*e);
    for (const EstimatedEffect& e : d.each.effects)
      if (e.column.entry->name == name) add(e);
    if (!parts.empty() && parts.front()->column.tau_s > 0.0)
      lines.number("effect." + name + "." + std::string(parts.front()->column.entry->variant),
                   parts.front()->column.tau_s);
  }
  for (const std::string& name : d.effect_names) {
    const auto found = d.aliases.find(name);
    lines.text("alias." + name, found == d.aliases.end() ? "" : join(found->second));
  }
  lines.text("undetectable", join(d.undetectable));
  for (const CandidateScore& c : d.candidates)
    if (c.visible && c.column.entry != nullptr && std::isfinite(c.detectable))
      lines.number("detectable." + c.column.key(), c.detectable);
  lines.number("error.before", d.error_before);
  lines.number("error.after", d.error_after);
  const auto held_out = [&lines](const std::string& key, const HoldoutError& error, double value) {
    lines.number("holdout." + key, error.observations > 0 ? value : std::numeric_limits<double>::quiet_NaN());
  };
  held_out("before", d.holdout_before, d.holdout_before.normalised_rms);
  held_out("after", d.holdout_after, d.holdout_after.normalised_rms);
  held_out("velocity_rms_before_mps", d.holdout_before, d.holdout_before.velocity_rms_mps);
  held_out("velocity_rms_after_mps", d.holdout_after, d.holdout_after.velocity_rms_mps);
  lines.text("holdout.source", d.holdout_source);
  if (d.holdout_own_noise > 1.0) lines.number("holdout.own_noise", d.holdout_own_noise);
  for (std::size_t k = 0; k < d.each.turn_ons.biases.size(); ++k)
    for (int column = 0; column < 6; ++column)
      lines.number("recording." + std::to_string(k + 1) + "." + parameter_key(column),
                   d.each.turn_ons.biases[k][column]);
  if (worth) {
    lines.text("navigation.source", worth->source);
    lines.number("navigation.free_s", worth->free_s);
    lines.number("navigation.before_nm_per_h", worth->before);
    lines.number("navigation.after_nm_per_h", worth->after);
    lines.number("navigation.noise_nm_per_h", worth->noise);
    for (const auto& [name, rate] : worth->effects) lines.number("navigation." + name + "_nm_per_h", rate);
  }
  return lines.take();
}

void describe_model(const JointResult& result, const CompressedRecording& recording, ParameterFile& file) {
  file.parameters = to_vector(result.parameters);
  for (std::size_t k = 0; k < parameter_keys.size(); ++k) {
    const double sigma = result.sigma[Eigen::Index(k)];
    file.sigma[k] = sigma > 0.0 ? std::optional(sigma) : std::nullopt;
  }
  if (std::isfinite(recording.mean_temperature_c)) file.reference_temperature_c = result.reference_temperature_c;
  file.effects.clear();
  for (const std::string& name : by_strength(result)) {
    const auto parts = components_of(result, name);
    for (const EstimatedEffect* e : parts)
      file.effects.push_back(
          {name, component_name(e->column), e->value, e->sigma > 0.0 ? std::optional(e->sigma) : std::nullopt});
    if (parts.front()->column.tau_s > 0.0)
      file.effects.push_back(
          {name, std::string(parts.front()->column.entry->variant), parts.front()->column.tau_s, std::nullopt});
  }
  file.model = result.effects.empty() ? "base" : "extended";
  if (const std::string keys = undetermined_parameters(result); !keys.empty())
    file.add_further(std::string(undetermined_key), keys);
}

std::string undetermined_parameters(const JointResult& result) {
  std::vector<std::string> keys;
  for (std::size_t k = 0; k < parameter_keys.size(); ++k)
    if (parameter_is_free[k] && !result.determined[k]) keys.push_back(parameter_key(k));
  return join(keys, " ");
}

void describe_random_walk(const NoiseModel& noise, ParameterFile& file) {
  for (int k = 0; k < 3; ++k)
    file.add_further(fmt::format("noise.angle_random_walk.{}_deg_per_rt_h", "xyz"[k]),
                     noise.angle_random_walk[k] / radprs_per_degprh);
  for (int k = 0; k < 3; ++k)
    file.add_further(fmt::format("noise.velocity_random_walk.{}_ug_per_rt_hz", "xyz"[k]),
                     noise.velocity_random_walk[k] / mpsprs_per_ugprHz);
}

void describe_estimate(const JointResult& result, const CompressedRecording& recording, bool noise_given,
                       ParameterFile& file) {
  describe_model(result, recording, file);
  file.add_further("noise.source", std::string(noise_given ? "given" : "measured"));
  describe_random_walk(result.noise, file);
  file.add_further("noise.gyro_bias_instability_degph", result.noise.gyro_bias_instability_radps / radps_per_degph);
  file.add_further("noise.accel_bias_instability_ug",
                   result.noise.accel_bias_instability_mps2 / standard_gravity_mps2 * 1e6);
  file.add_further("noise.bias_correlation_s", result.noise.bias_correlation_s);
  file.add_further("noise.gyro_pulse_arcsec", result.noise.gyro_pulse_rad / rad_per_arcsec);
  file.add_further("noise.accel_pulse_mps", result.noise.accel_pulse_mps);
  file.add_further("quality.normalised_rms", result.normalised_rms);
  file.add_further("quality.innovation_level", result.whiteness.level);
  file.add_further("quality.innovations_white", std::string(result.whiteness.white ? "true" : "false"));
  file.add_further("quality.faults", double(result.faults.size()));
  for (std::size_t k = 0; k < result.faults.size(); ++k) {
    const Fault& fault = result.faults[k];
    file.add_further(fmt::format("quality.fault.{}", k + 1), fmt::format("samples {} to {}: {}; {}", fault.first_sample,
                                                                         fault.last_sample, fault.what, fault.action));
  }
  describe_covariance(result, file);
  if (!result.undetermined.empty())
    file.add_further("quality.undetermined_directions", double(result.undetermined.size()));
}

void describe_turn_ons(const TurnOns& turn_ons, const std::vector<SwitchOn>& switched_on, ParameterFile& file) {
  file.add_further("record.recordings", double(switched_on.size()));
  for (std::size_t k = 0; k < switched_on.size(); ++k) {
    const std::string begin = "record.recording." + std::to_string(k + 1) + ".";
    file.add_further(begin + "hash", switched_on[k].hash);
    if (const auto& at = switched_on[k].started_utc_s) file.add_further(begin + "started_utc", format_utc(double(*at)));
    for (int column = 0; column < 6; ++column) {
      const std::string key = parameter_key(column);
      file.add_further(begin + key, turn_ons.biases[k][column]);
      file.add_further(begin + "sigma." + key, turn_ons.sigma[k][column]);
    }
  }
  for (int column = 0; column < 6; ++column)
    file.add_further("quality.turn_on_repeatability." + parameter_key(column), turn_ons.repeatability[column]);
}

std::vector<std::string> turn_on_words(const TurnOns& turn_ons) {
  std::vector<std::string> words;
  for (int column = 0; column < 6; ++column) {
    const bool gyro = column < 3;
    words.push_back(fmt::format("turn-on repeatability of {}: {} {}", parameter_key(column),
                                significant((gyro ? 1.0 : 1e6) * turn_ons.repeatability[column], 3),
                                gyro ? "deg/h" : "ug"));
  }
  return words;
}

void describe_alias(const Diagnosis& d, ParameterFile& file) {
  if (!d.trusted() || d.fitted_covariance.rows() != d.extended.covariance.rows()) return;
  for (std::size_t i = 0; i < d.extended.free.size(); ++i) {
    const int key = d.extended.free[i];
    const auto at = Eigen::Index(i);
    const double all = d.extended.covariance(at, at), spread = all - d.fitted_covariance(at, at);
    if (key >= parameter_count || !(spread > 1e-9 * all)) continue;
    file.add_further(alias_key_prefix + parameter_key(key), std::sqrt(spread));
  }
}

ParameterFile diagnosis_parameters(const Diagnosis& diagnosis, const DiagnosisContext& context) {
  ParameterFile file;
  describe_recording(context.recording.info, file);
  describe_estimate(diagnosis.extended, context.recording, context.noise_given, file);
  describe_alias(diagnosis, file);
  for (const auto& [column, value] : diagnosis.without_effects)
    file.add_further("record.without_effects." + parameter_key(column), value);
  complete_parameters(diagnosis, context, file);
  if (!diagnosis.each.turn_ons.biases.empty()) describe_turn_ons(diagnosis.each.turn_ons, context.switched_on, file);
  return file;
}

void complete_parameters(const Diagnosis& diagnosis, const DiagnosisContext& context, ParameterFile& file) {
  file.recording_hash = context.recording_hash;
  file.method = context.method;
  file.software_version = software_version();
  file.time_utc = context.time_utc;
  describe_trust(diagnosis.why_not_trusted, file);
  file.add_further("verdict.diagnosis", std::string(to_string(diagnosis.verdict)));
}

DiagnosisFiles diagnosis_files(const Diagnosis& diagnosis, const DiagnosisContext& context) {
  const std::string simulated = context.recording.info.simulated ? "# Simulated data: a dry run, or a twin.\n" : "";
  return {diagnosis_document(diagnosis, context), simulated + format_diagnosis(diagnosis, context.worth),
          diagnosis_parameters(diagnosis, context)};
}

Result<std::string> write_diagnosis(const std::string& folder, const DiagnosisFiles& files,
                                    const GnuplotOptions& gnuplot) {
  const std::string parameters =
      TRY(files.parameters ? format_parameter_file(*files.parameters) : Result<std::string>(std::string()));
  // A file that this diagnosis does not have must not stay from an earlier one.
  const auto write = [&folder](const char* name, const std::string& text) -> Status {
    const std::string file = folder + "/" + name;
    if (!text.empty()) return write_file_atomically(file, text);
    std::error_code error;
    std::filesystem::remove(file, error);
    return error ? Status(device_error(file + ": cannot remove: " + error.message())) : Status();
  };
  const HtmlPage page = as_page(files.report, gnuplot);
  TRY(write(report_name, page.html));
  TRY(write(diagnosis_name, files.conf));
  TRY(write(parameters_name, parameters));
  return page.plot_problem;
}

}  // namespace turncal
