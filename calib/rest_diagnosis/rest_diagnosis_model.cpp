#include "calib/rest_diagnosis/rest_diagnosis_model.h"

#include <algorithm>

namespace turncal {

// Effects with one physical cause: found on one triad, they are looked for on the other.
std::string_view cause_of(const EffectEntry& entry) {
  if (entry.name.ends_with("_bias_drift") || entry.name.ends_with("_warm_up")) return "time";
  if (entry.name.ends_with("_temperature")) return "temperature";
  return {};
}

RestDiagnosisModel::RestDiagnosisModel(const RestData& the_data, const RestDiagnosisOptions& the_options)
    : data(the_data),
      options(the_options),
      site{data.recording->info.latitude_deg},
      reference_c(rest_reference_temperature_c(data)) {
  const std::vector<Block>& blocks = data.recording->blocks;
  if (blocks.empty()) return;
  duration_s = static_cast<double>(blocks.back().start_sample + blocks.back().samples - blocks.front().start_sample) *
               data.recording->info.sample_period_s;
}

EffectModel RestDiagnosisModel::effect_model(const std::vector<EffectColumn>& columns,
                                             const Eigen::VectorXd& values) const {
  EffectModel result = make_effect_model(columns, site, reference_c);
  result.values.setZero(result.columns);
  result.values.head(values.size()) = values;
  return result;
}

RestModelFit RestDiagnosisModel::refit(std::vector<EffectColumn> columns, const Eigen::VectorXd& start_values) const {
  RestFitOptions fit_options;
  fit_options.start_floors = model.fit.floors;
  RestModelFit result{std::move(columns), {}};
  result.fit = refine_rests(data, model.fit.parameters, effect_model(result.columns, start_values), fit_options);
  return result;
}

RestModelFit RestDiagnosisModel::refit(const EffectColumn& added) const {
  std::vector<EffectColumn> columns = model.columns;
  columns.push_back(added);
  return refit(std::move(columns), model.fit.effect_values);
}

std::vector<int> RestDiagnosisModel::members(const EffectEntry& entry, double tau_s) const {
  std::vector<int> result;
  for (std::size_t k = 0; k < testable.size(); ++k)
    if (testable[k].entry == &entry && testable[k].tau_s == tau_s) result.push_back(static_cast<int>(k));
  return result;
}

bool RestDiagnosisModel::in_model(const EffectEntry* entry) const {
  return std::any_of(model.columns.begin(), model.columns.end(),
                     [&](const EffectColumn& c) { return c.entry == entry; });
}

}  // namespace turncal
