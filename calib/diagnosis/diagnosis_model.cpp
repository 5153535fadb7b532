#include "calib/diagnosis/diagnosis_model.h"

#include <algorithm>

#include "calib/diagnosis/holdout.h"
#include "calib/diagnosis/unexplained.h"
#include "calib/joint/coarser_recording.h"
#include "calib/statistics/distributions.h"

namespace turncal {

double minus_two_log_likelihood(const JointResult& result) {
  return result.last.chi_square + result.last.log_determinant;
}

bool visible(const Scores& scores, int column) {
  return scores.kept[column] > SelectionLimits{}.visible_part && scores.Q(column, column) > 0.0;
}

std::vector<std::string> names_of(const std::vector<EffectColumn>& columns) {
  std::vector<std::string> names;
  for (const EffectColumn& c : columns)
    if (std::find(names.begin(), names.end(), c.entry->name) == names.end()) names.emplace_back(c.entry->name);
  return names;
}

std::string lost_in_its_class(const std::vector<EstimatedEffect>& effects) {
  constexpr double least = 2.0;
  for (const EstimatedEffect& effect : effects) {
    const auto clear = [&](const EstimatedEffect& e) {
      return e.column.entry == effect.column.entry && std::abs(e.value) > least * e.sigma;
    };
    if (!is_turn_on(effect.column) && std::none_of(effects.begin(), effects.end(), clear))
      return std::string(effect.column.entry->name);
  }
  return {};
}

std::vector<EffectColumn> columns_beyond_base(const JointResult& result) {
  std::vector<EffectColumn> columns;
  for (const EstimatedEffect& e : result.effects)
    if (!is_turn_on(e.column)) columns.push_back(e.column);
  return columns;
}

DiagnosisModel::DiagnosisModel(const JoinedRecordings& all, const DiagnosisOptions& the_options)
    : recordings(all),
      recording(all.data),
      options(the_options),
      catalogue(catalogue_columns(recording.info, static_cast<int>(all.parts.size()))),
      columns(catalogue) {
  const std::vector<EffectColumn> patterns = pattern_columns(all.parts);
  columns.insert(columns.end(), patterns.begin(), patterns.end());
  const double columns_count = static_cast<double>(columns.size());
  threshold = chi_square_1_limit(options.false_alarm / columns_count);
  threshold_of_times = chi_square_1_limit(options.false_alarm / (columns_count * refined_values));
  near = chi_square_1_limit(options.limits.selection.near_family_wise / columns_count);
}

JointOptions DiagnosisModel::estimate_options(const std::vector<EffectColumn>& effects, const JointResult* from) const {
  JointOptions o = options.estimate;
  o.effects = recordings.turn_ons;
  o.effects.insert(o.effects.end(), effects.begin(), effects.end());
  o.begins = recordings.begins;
  o.candidates.clear();
  if (from) {
    o.start = from->parameters;
    o.start_noise = from->noise;
    o.start_effects.setZero(static_cast<Eigen::Index>(o.effects.size()));
    for (std::size_t k = 0; k < recordings.turn_ons.size(); ++k)
      o.start_effects[static_cast<Eigen::Index>(k)] = from->effects[k].value;
  }
  return o;
}

JointResult DiagnosisModel::fit(const std::vector<EffectColumn>& effects, const JointResult& from,
                                const NoiseModel* noise) const {
  JointOptions o = estimate_options(effects, &from);
  o.faults_of = &from;
  if (noise) o.noise = *noise;
  return joint_estimate(recording, o);
}

double DiagnosisModel::misfit_beside_slow_noise(const std::vector<EffectColumn>& effects,
                                                const JointResult& from) const {
  JointOptions o = estimate_options(effects, &from);
  o.faults_of = &from;
  o.start_noise = current.noise;
  o.start_noise->bias_correlation_s = options.limits.fit.slow_correlation_s;
  return minus_two_log_likelihood(joint_estimate(recording, o));
}

std::vector<Scores> DiagnosisModel::scores(const std::vector<EffectColumn>& candidates,
                                           const std::vector<NoiseModel>& noises) const {
  const int effects = static_cast<int>(current.effects.size());
  const EffectModel model = effect_model_of(current, recording.info.latitude_deg, candidates);
  FilterSetup setup = current.setup;
  setup.narrow_columns = static_cast<int>(std::count_if(candidates.begin(), candidates.end(), is_pattern));
  setup.narrow_against = parameter_count + effects;
  const CompressedRecording fewer = coarser(recording, coarseness_of_scores, setup);
  const std::vector<FilterResult> passes = run_filter(fewer, current.parameters, model, setup, noises);

  std::vector<int> base, added;
  for (int k = 0; k < parameter_count; ++k)
    if (parameter_is_free[static_cast<std::size_t>(k)]) base.push_back(k);
  for (int k = 0; k < effects; ++k) base.push_back(parameter_count + k);
  for (int k = 0; k < static_cast<int>(candidates.size()); ++k) added.push_back(parameter_count + effects + k);
  std::vector<Scores> scores;
  for (const FilterResult& pass : passes) scores.push_back(eliminate(pass.information, pass.gradient, base, added));
  return scores;
}

bool DiagnosisModel::has_chosen(const EffectColumn& column) const {
  return std::any_of(chosen.begin(), chosen.end(), [&](const EffectColumn& c) { return c.key() == column.key(); });
}

std::vector<EffectColumn> DiagnosisModel::chosen_without(const std::string& name) const {
  std::vector<EffectColumn> without = chosen;
  std::erase_if(without, [&](const EffectColumn& c) { return c.entry->name == name; });
  return without;
}

NoiseModel DiagnosisModel::bare_noise() const {
  NoiseModel noise = current.setup.noise;
  noise.gyro_bias_instability_radps = noise.accel_bias_instability_mps2 = 0.0;
  return noise;
}

}  // namespace turncal
