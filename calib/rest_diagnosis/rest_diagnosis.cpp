#include "calib/rest_diagnosis/rest_diagnosis.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <set>

#include "calib/rest_diagnosis/rest_candidates.h"
#include "calib/rest_diagnosis/rest_choice.h"
#include "calib/rest_diagnosis/rest_diagnosis_model.h"
#include "calib/rest_diagnosis/rest_gate.h"
#include "calib/rest_diagnosis/rest_name_check.h"
#include "calib/rests/rest_units.h"
#include "calib/statistics/unit_slip.h"

namespace turncal {
namespace {

std::string hangs_on_single_rests(RestKind kind, double left_out, double fitted, double most) {
  if (!(left_out > most * fitted)) return {};
  return std::string("left out in turn, the error of ") + to_string(kind) + " is " +
         std::to_string(std::lround(left_out / fitted)) + " times the fitted one: the fit hangs on single rests";
}

bool of_accelerometers(const EffectEntry& entry) { return !entry.name.starts_with("gyro_"); }

// Where gravity's norm hangs on single rests, so would every effect of the accelerometers.
void judge_accelerometers(RestDiagnosisModel& m, RestDiagnosis& d) {
  d.accel_not_tested = hangs_on_single_rests(RestKind::norm, d.base.left_out.norm_rms_mps2, d.base.errors.norm_rms_mps2,
                                             m.options.most_leverage);
  if (d.accel_not_tested.empty()) return;
  std::erase_if(m.testable, [](const EffectColumn& column) { return of_accelerometers(*column.entry); });
  for (RestCandidate& candidate : d.candidates)
    if (candidate.remark.empty() && of_accelerometers(*find_effect(candidate.effect)))
      candidate.remark = "not tested: " + d.accel_not_tested;
}

// The model without one of its components; false where that does not settle.
RestModelFit without_component(const RestDiagnosisModel& m, std::size_t k) {
  const auto at = static_cast<Eigen::Index>(k);
  const Eigen::VectorXd& all = m.model.fit.effect_values;
  std::vector<EffectColumn> columns = m.model.columns;
  columns.erase(columns.begin() + static_cast<std::ptrdiff_t>(k));
  Eigen::VectorXd values(all.size() - 1);
  values << all.head(at), all.tail(values.size() - at);
  return m.refit(std::move(columns), values);
}

bool drop_component(RestDiagnosisModel& m, RestDiagnosis& d, std::size_t k) {
  RestModelFit smaller = without_component(m, k);
  if (!smaller.fit.converged) return false;
  const EffectEntry* entry = m.model.columns[k].entry;
  m.model = std::move(smaller);
  if (!m.in_model(entry)) std::erase_if(d.aliases, [&](const auto& item) { return item.first == entry->name; });
  return true;
}

double z_of(const RestDiagnosisModel& m, std::size_t k) {
  const auto at = static_cast<Eigen::Index>(k);
  return std::abs(m.model.fit.effect_values[at]) / m.model.fit.sigma[parameter_count + at];
}

// What was found early may have been a stand-in for what was found later.
void drop_superseded(RestDiagnosisModel& m, RestDiagnosis& d) {
  for (std::size_t k = 0; k + 1 < m.model.columns.size();) {
    if (const double z = z_of(m, k); z * z > std::log(m.rows()))
      ++k;
    else if (!drop_component(m, d, k))
      return;
  }
}

// Components that are not clear, the weakest first, but for those without which the error on what is left out rises as much as an effect has to
// lower it. What they would do to the parameters: into `beside`.
void drop_unclear(RestDiagnosisModel& m, RestDiagnosis& d, std::vector<Eigen::VectorXd>& beside) {
  const Parameters with = m.model.fit.parameters;
  const std::size_t all = m.model.columns.size();
  std::set<std::string> needed;
  const auto droppable = [&](std::size_t k) {
    return z_of(m, k) <= m.options.clear && !needed.contains(m.model.columns[k].key());
  };
  while (true) {
    std::optional<std::size_t> weakest;
    for (std::size_t k = 0; k < m.model.columns.size(); ++k)
      if (droppable(k) && (!weakest || z_of(m, k) < z_of(m, *weakest))) weakest = k;
    if (!weakest) break;
    if (passes_gate(m, without_component(m, *weakest), m.model, true) || !drop_component(m, d, *weakest))
      needed.insert(m.model.columns[*weakest].key());
  }
  if (m.model.columns.size() < all) beside.push_back(to_vector(with) - to_vector(m.model.fit.parameters));
}

RestHoldout on_holdout(const RestDiagnosisModel& m, const RestFit& fit, const std::vector<RestEffect>& effects) {
  RestHoldout result;
  if (m.options.holdout == nullptr) return result;
  const RestSystem system = rest_system_at(*m.options.holdout, fit, effects, m.reference_c);
  result.errors = rest_errors(system, system.residual);
  result.chi_square = rest_weights(system, m.model.fit.floors).cwiseProduct(system.residual).squaredNorm();
  result.observations = static_cast<int>(system.residual.size());
  result.normalised_rms = std::sqrt(result.chi_square / std::max(1, result.observations));
  return result;
}

// Sigmas hold where else the parameters may be.
void widen(RestFit& fit, const Parameters& from, const std::vector<Eigen::VectorXd>& shifts) {
  const ParameterVector offset = to_vector(from) - to_vector(fit.parameters);
  Eigen::VectorXd most = Eigen::VectorXd::Zero(parameter_count);
  for (const Eigen::VectorXd& shift : shifts) most = most.cwiseMax((shift + offset).cwiseAbs());
  for (int k = 0; k < parameter_count; ++k)
    if (fit.sigma[k] > 0.0) fit.sigma[k] = std::hypot(fit.sigma[k], most[k]);
}

// The names of the model against what has none.
void judge_names(RestDiagnosisModel& m, RestDiagnosis& d) {
  std::vector<Eigen::VectorXd> beside;
  drop_unclear(m, d, beside);
  d.unexplained = why_names_fall(m, beside);
  if (!d.unexplained.empty()) {
    for (const EffectColumn& column : m.model.columns)
      if (std::find(d.candidate_names.begin(), d.candidate_names.end(), column.entry->name) == d.candidate_names.end())
        d.candidate_names.emplace_back(column.entry->name);
    beside.push_back(Eigen::VectorXd::Zero(parameter_count));
    const Parameters extended = m.model.fit.parameters;
    m.model = {{}, d.base};
    d.aliases.clear();
    widen(m.model.fit, extended, beside);
  } else {
    widen(m.model.fit, m.model.fit.parameters, beside);
  }
}

void conclude(const RestDiagnosisModel& m, RestDiagnosis& d) {
  d.final = m.model.fit;
  for (std::size_t k = 0; k < m.model.columns.size(); ++k)
    d.effects.push_back({m.model.columns[k], m.model.fit.effect_values[static_cast<Eigen::Index>(k)],
                         m.model.fit.sigma[parameter_count + static_cast<Eigen::Index>(k)]});
  const EffectModel none = m.effect_model({}, Eigen::VectorXd());
  const RestSystem before = make_rest_system(m.data, d.base.parameters, none, true);
  const RestSystem after = make_rest_system(m.data, m.model.fit.parameters, m.effect_model(m.model), true);
  const Eigen::VectorXd weights = rest_weights(after, m.model.fit.floors);
  d.error_before = std::sqrt(mean_square(before.residual, weights));
  d.error_after = std::sqrt(mean_square(after.residual, weights));
  d.left_out_before = std::sqrt(mean_square(left_out_residual(before, rest_weights(before, d.base.floors)), weights));
  d.left_out_after = std::sqrt(mean_square(left_out_residual(after, weights), weights));
  d.holdout_before = on_holdout(m, d.base, {});
  d.holdout_after = on_holdout(m, d.final, d.effects);
  double worst = 0.0;
  for (const RestKind kind : {RestKind::norm, RestKind::direction, RestKind::gyro}) {
    const double ratio = m.model.fit.white_ratio[static_cast<std::size_t>(kind)];
    worst = std::max(worst, ratio);
    if (ratio > 2.0) d.remainder.push_back(to_string(kind));
  }
  d.verdict = !d.not_tested.empty()                 ? Verdict::not_tested
              : !d.unexplained.empty()              ? Verdict::unexplained
              : !m.model.columns.empty()            ? Verdict::extended
              : worst > m.options.unexplained_ratio ? Verdict::unexplained
              : !d.accel_not_tested.empty()         ? Verdict::not_tested
                                                    : Verdict::clean;
  d.trusted = d.accel_not_tested.empty() && worst <= m.options.unexplained_ratio &&
              (d.verdict == Verdict::clean || d.verdict == Verdict::extended);
  std::stable_sort(d.candidates.begin(), d.candidates.end(),
                   [](const RestCandidate& a, const RestCandidate& b) { return a.score > b.score; });
}

// Adds the next component, or strikes it out; false when none is declared any more. The first scores fill the table of candidates.
bool select_one(RestDiagnosisModel& m, RestDiagnosis& d, bool& table_filled) {
  const std::vector<EffectColumn> slow = slow_columns(m);
  std::vector<EffectColumn> columns = m.model.columns;
  columns.insert(columns.end(), m.testable.begin(), m.testable.end());
  columns.insert(columns.end(), slow.begin(), slow.end());
  const RestSystem system =
      make_rest_system(m.data, m.model.fit.parameters, m.effect_model(columns, m.model.fit.effect_values), true);
  const int in_model_columns = rest_parameter_count + static_cast<int>(m.model.columns.size());
  const RestScores scores(system, m.model.fit, in_model_columns);
  if (!table_filled) {
    fill_candidates(m, scores, d);
    table_filled = true;
    const std::size_t all = m.testable.size();
    strike_invisible(m, scores);
    if (m.testable.size() != all) return true;  // the scores are numbered anew
  }
  std::optional<RestScores> guarded;
  if (!slow.empty()) {
    std::vector<int> nuisance;
    for (std::size_t k = 0; k < slow.size(); ++k) nuisance.push_back(static_cast<int>(m.testable.size() + k));
    guarded.emplace(system, m.model.fit, in_model_columns, nuisance);
  }
  const int choice = choose_component(m, scores, guarded ? &*guarded : nullptr);
  if (choice < 0) return false;
  const EffectColumn column = m.testable[static_cast<std::size_t>(choice)];
  const bool first = !m.in_model(column.entry);
  const RestModelFit extended = m.refit(column);
  const ColumnScore& score = scores.of(choice);
  RestStage stage{column, score.statistic, std::min(1.0, score.p_value * 2.0 * static_cast<double>(m.testable.size())),
                  false, "accepted"};
  const double value = extended.fit.effect_values[extended.fit.effect_values.size() - 1];
  if (!extended.fit.converged)
    stage.note = "the fit with it does not settle";
  else if (std::abs(value) > absurd_magnitude(*column.entry, m.duration_s))
    stage.note =
        "it would come to " + std::to_string(value) + " " + std::string(column.entry->unit) + ", which no sensor has";
  else if (!passes_gate(m, m.model, extended, first))
    stage.note = "the error on data left out of the fit does not fall";
  else
    stage.accepted = true;
  d.stages.push_back(stage);
  if (!stage.accepted) {
    if (first) {
      m.struck.emplace(column.entry->name);
      d.struck_out.push_back(column.key() + ": " + stage.note);
    }
    std::erase_if(m.testable,
                  [&](const EffectColumn& c) { return c.entry == column.entry && c.component == column.component; });
    return true;
  }
  note_aliases(m, scores, choice, d);
  m.model = extended;
  // The other time constants of an effect that is in the model are out of question.
  std::erase_if(m.testable, [&](const EffectColumn& c) {
    return c.entry == column.entry && (c.component == column.component || c.tau_s != column.tau_s);
  });
  drop_superseded(m, d);
  return true;
}

}  // namespace

// Rows that are left over after the base fit are all that can speak for a name.
std::string why_not_tested(const RestData& data, const RestFit& base, const RestDiagnosisOptions& options) {
  double redundancy = 0.0;
  for (const double r : base.redundancy) redundancy += r;
  if (!base.converged) return "the 21 parameters could not be fitted: " + base.message;
  std::string why;
  if (redundancy < options.least_redundancy)
    why = std::to_string(data.rests.size()) + " rests and " + std::to_string(data.legs.size()) + " rotations leave " +
          std::to_string(std::lround(redundancy)) + " observations beyond the 21 parameters, where " +
          std::to_string(std::lround(options.least_redundancy)) + " are wanted";
  if (!base.undetermined.empty()) {
    why += (why.empty() ? "" : "; ") + std::string("not determined:");
    for (const std::string& key : base.undetermined) why += " " + key;
  }
  // A reversed accelerometer makes the body's frame left-handed, and two gyros turn the other way in it.
  if (why.empty()) why = wrong_axes(base.parameters.n / start_parameters(data.recording->info).n(0, 0));
  if (why.empty()) why = wrong_vertical(data, base.parameters);
  if (!why.empty()) return why;
  return hangs_on_single_rests(RestKind::direction, base.left_out.direction_rms_rad, base.errors.direction_rms_rad,
                               options.most_leverage);
}

double rest_reference_temperature_c(const RestData& data) {
  const double mean = data.recording->mean_temperature_c;
  return std::isnan(mean) ? 0.0 : mean;
}

RestSystem rest_system_at(const RestData& data, const RestFit& fit, const std::vector<RestEffect>& effects,
                          double reference_temperature_c) {
  std::vector<EffectColumn> columns;
  for (const RestEffect& effect : effects) columns.push_back(effect.column);
  EffectModel model = make_effect_model(columns, {data.recording->info.latitude_deg}, reference_temperature_c);
  model.values = fit.effect_values.head(model.columns);
  return make_rest_system(data, fit.parameters, model, false);
}

Result<RestDiagnosis> diagnose_rests(const RestData& data, const RestDiagnosisOptions& options) {
  RestDiagnosisModel m(data, options);
  RestDiagnosis d;
  find_testable(m, d);
  if (d.not_tested = wrong_units(data); !d.not_tested.empty()) {
    d.base.message = d.not_tested;
    return d;
  }
  Result<RestFit> base = fit_rests(data, m.effect_model({}, Eigen::VectorXd()));
  if (!base) return base.error();
  d.base = *base;
  m.model.fit = *base;
  d.not_tested = why_not_tested(data, d.base, options);
  if (d.not_tested.empty()) {
    judge_accelerometers(m, d);
    bool table_filled = false;
    while (static_cast<int>(m.model.columns.size()) < options.max_components && select_one(m, d, table_filled)) {
    }
    judge_names(m, d);
  } else {
    for (RestCandidate& candidate : d.candidates)
      if (candidate.remark.empty()) candidate.remark = "not tested: " + d.not_tested;
  }
  conclude(m, d);
  return d;
}

}  // namespace turncal
