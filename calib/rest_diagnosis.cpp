#include "calib/rest_diagnosis.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <set>

#include "calib/attitude.h"
#include "calib/rest_selection.h"

namespace turncal {
namespace {

using Eigen::VectorXd;

constexpr double alias_correlation = 0.9;    // one class: the data hardly tell them apart
constexpr double kindred_correlation = 0.7;  // what one explains, the other nearly does

// Effects with one physical cause: found on one triad, they are looked for on the other.
std::string_view cause_of(const EffectEntry& entry) {
  if (entry.name.ends_with("_bias_drift") || entry.name.ends_with("_warm_up")) return "time";
  if (entry.name.ends_with("_temperature")) return "temperature";
  return {};
}

// Whether an effect's regressors change when the unit is turned about the vertical: then they need the heading.
bool needs_heading(const EffectEntry& entry, const Site& site) {
  const int count = static_cast<int>(entry.components.size());
  BlockState s;
  s.f_b = {3.0, 8.0, 4.0};
  s.w_b = {0.3, -0.2, 0.5};
  s.w_dot_b = {0.1, 0.2, -0.3};
  s.duration_s = 0.2;
  s.time_s = 100.0;
  s.since_rotation_s = 3.0;
  s.temperature_c = 5.0;
  const double tau = entry.taus_s.empty() ? 0.0 : entry.taus_s.front();
  Eigen::Matrix3Xd gyro[2], accel[2];
  for (int k = 0; k < 2; ++k) {
    s.C_nb = attitude_from_angles(k * 1.5, 0.4, 0.7);
    gyro[k].setZero(3, count);
    accel[k].setZero(3, count);
    entry.write(s, site, tau, gyro[k], accel[k]);
  }
  return (gyro[0] - gyro[1]).norm() + (accel[0] - accel[1]).norm() > 1e-9 * (gyro[0].norm() + accel[0].norm());
}

// The weighted mean square of prediction errors, the weights being those of `weights`; rows that cannot be predicted
// are left out of both sides by the caller's mask.
double mean_square(const VectorXd& residual, const VectorXd& weights) {
  double sum = 0.0;
  double count = 0.0;
  for (Eigen::Index k = 0; k < residual.size(); ++k) {
    if (std::isnan(residual[k])) continue;
    sum += std::pow(residual[k] * weights[k], 2);
    count += 1.0;
  }
  return count > 0.0 ? sum / count : 0.0;
}

class RestDiagnoser {
 public:
  RestDiagnoser(const RestData& data, const RestDiagnosisOptions& options)
      : data_(data),
        options_(options),
        site_{data.recording->info.latitude_deg},
        reference_c_(rest_reference_temperature_c(data)) {
    const std::vector<Block>& blocks = data.recording->blocks;
    if (!blocks.empty())
      duration_s_ = static_cast<double>(blocks.back().start_sample + blocks.back().samples - blocks.front().start_sample) *
                    data.recording->info.sample_period_s;
  }
  Result<RestDiagnosis> run();

 private:
  struct Model {
    std::vector<EffectColumn> columns;
    RestFit fit;
  };
  struct Choice {
    int candidate = -1;
    double statistic = 0.0;
    bool declared = false;  // against the family-wise limit; else by BIC, as a further component
  };

  void find_testable();
  EffectModel effect_model(const std::vector<EffectColumn>& columns, const VectorXd& values) const;
  RestSystem system_with_candidates(const std::vector<EffectColumn>& slow) const;
  Model refit(const Model& from, const EffectColumn& column) const;
  void drop_superseded();
  double rows() const { return static_cast<double>(data_.rests.size() * 4 + data_.legs.size() * 2); }
  bool cause_on_other_triad(const EffectEntry& entry) const;
  void fill_table(const RestScores& scores);
  Choice choose(const RestScores& scores, const RestScores* guarded) const;
  std::vector<EffectColumn> slow_columns() const;
  int simplest_alias(const RestScores& scores, int best) const;
  void note_aliases(const RestScores& scores, int chosen);
  bool passes_gate(const Model& before, const Model& after, bool first) const;
  std::vector<int> members(const EffectEntry& entry, double tau_s) const;
  bool in_model(const EffectEntry* entry) const;
  std::string why_not_tested() const;
  void strike_invisible(const RestScores& scores);
  double holdout_gain(const Model& before, const Model& after) const;
  RestHoldout on_holdout(const RestFit& fit, const std::vector<RestEffect>& effects) const;
  void conclude();

  const RestData& data_;
  const RestDiagnosisOptions options_;
  const Site site_;
  const double reference_c_;
  double duration_s_ = 0.0;
  std::vector<EffectColumn> testable_;  // what is still in question
  std::set<std::string> struck_;        // effects the gate refused
  Model model_;
  RestDiagnosis result_;
};

void RestDiagnoser::find_testable() {
  std::set<std::string_view> headed;
  for (const EffectEntry& entry : effect_catalogue())
    if (needs_heading(entry, site_)) headed.insert(entry.name);
  for (const EffectColumn& column : catalogue_columns(data_.recording->info))
    if (!headed.contains(column.entry->name)) testable_.push_back(column);
  for (const EffectEntry& entry : effect_catalogue()) {
    RestCandidate candidate;
    candidate.effect = entry.name;
    for (const std::string_view component : entry.components) candidate.components.emplace_back(component);
    if (headed.contains(entry.name))
      candidate.remark = "needs the heading";
    else if (entry.needs_temperature && !data_.recording->info.has_temperature)
      candidate.remark = "no temperature recorded";
    result_.candidates.push_back(std::move(candidate));
  }
}

EffectModel RestDiagnoser::effect_model(const std::vector<EffectColumn>& columns, const VectorXd& values) const {
  EffectModel model = make_effect_model(columns, site_, reference_c_);
  model.values.setZero(model.columns);
  model.values.head(values.size()) = values;
  return model;
}

RestSystem RestDiagnoser::system_with_candidates(const std::vector<EffectColumn>& slow) const {
  std::vector<EffectColumn> columns = model_.columns;
  columns.insert(columns.end(), testable_.begin(), testable_.end());
  columns.insert(columns.end(), slow.begin(), slow.end());
  return make_rest_system(data_, model_.fit.parameters, effect_model(columns, model_.fit.effect_values), true);
}

RestDiagnoser::Model RestDiagnoser::refit(const Model& from, const EffectColumn& column) const {
  Model model;
  model.columns = from.columns;
  model.columns.push_back(column);
  RestFitOptions options;
  options.start_floors = from.fit.floors;
  model.fit = refine_rests(data_, from.fit.parameters, effect_model(model.columns, from.fit.effect_values), options);
  return model;
}

// What was found early may have been a stand-in for what was found later.
void RestDiagnoser::drop_superseded() {
  for (std::size_t k = 0; k + 1 < model_.columns.size();) {
    const auto at = static_cast<Eigen::Index>(k);
    const double z = model_.fit.effect_values[at] / model_.fit.sigma[parameter_count + at];
    if (z * z > std::log(rows())) {
      ++k;
      continue;
    }
    Model smaller;
    smaller.columns = model_.columns;
    smaller.columns.erase(smaller.columns.begin() + static_cast<std::ptrdiff_t>(k));
    VectorXd values(model_.fit.effect_values.size() - 1);
    values << model_.fit.effect_values.head(at), model_.fit.effect_values.tail(values.size() - at);
    RestFitOptions options;
    options.start_floors = model_.fit.floors;
    smaller.fit = refine_rests(data_, model_.fit.parameters, effect_model(smaller.columns, values), options);
    if (!smaller.fit.converged) return;
    const EffectEntry* entry = model_.columns[k].entry;
    model_ = std::move(smaller);
    if (!in_model(entry)) std::erase_if(result_.aliases, [&](const auto& item) { return item.first == entry->name; });
  }
}

std::vector<int> RestDiagnoser::members(const EffectEntry& entry, double tau_s) const {
  std::vector<int> result;
  for (std::size_t k = 0; k < testable_.size(); ++k)
    if (testable_[k].entry == &entry && testable_[k].tau_s == tau_s) result.push_back(static_cast<int>(k));
  return result;
}

bool RestDiagnoser::in_model(const EffectEntry* entry) const {
  return std::any_of(model_.columns.begin(), model_.columns.end(),
                     [&](const EffectColumn& c) { return c.entry == entry; });
}

void RestDiagnoser::fill_table(const RestScores& scores) {
  int tests = 0;
  for (int k = 0; k < static_cast<int>(testable_.size()); ++k) tests += scores.of(k).visible ? 1 : 0;
  for (RestCandidate& candidate : result_.candidates) {
    if (!candidate.remark.empty()) continue;
    const EffectEntry& entry = *find_effect(candidate.effect);
    const std::vector<double> taus = entry.taus_s.empty() ? std::vector<double>{0.0} : entry.taus_s;
    double best_group = -1.0;
    for (const double tau : taus) {
      const std::vector<int> group = members(entry, tau);
      const RestScores::Group test = scores.group(group);
      if (test.rank == 0 || test.chi_square <= best_group) continue;
      best_group = test.chi_square;
      candidate.tau_s = tau;
      candidate.rank = test.rank;
      candidate.score = test.chi_square;
      candidate.p_value = test.p_value;
      candidate.best_statistic = -1.0;
      candidate.detectable.clear();
      candidate.values.clear();
      candidate.sigmas.clear();
      for (const int k : group) {
        const ColumnScore& score = scores.of(k);
        const bool absurd = 5.0 * score.sigma > absurd_magnitude(entry, duration_s_);
        candidate.detectable.push_back(score.visible && !absurd ? 5.0 * score.sigma : INFINITY);
        candidate.values.push_back(score.value);
        candidate.sigmas.push_back(score.sigma);
        if (absurd) continue;
        if (score.visible && score.statistic > candidate.best_statistic) {
          candidate.best_statistic = score.statistic;
          candidate.best_component =
              entry.components[static_cast<std::size_t>(testable_[static_cast<std::size_t>(k)].component)];
          candidate.p_value = std::min(candidate.p_value, score.p_value);
        }
      }
    }
    candidate.p_value = std::min(1.0, candidate.p_value * tests);
    if (candidate.rank == 0) candidate.remark = "leaves no trace in rests and in gravity's direction after rotations";
    else if (candidate.best_component.empty())
      candidate.remark = "would have to be larger than any sensor has it to be caught";
  }
}

// A component of which only an absurdly large value would be caught is out of question.
void RestDiagnoser::strike_invisible(const RestScores& scores) {
  std::vector<EffectColumn> kept;
  for (std::size_t k = 0; k < testable_.size(); ++k) {
    const ColumnScore& score = scores.of(static_cast<int>(k));
    if (score.visible && 5.0 * score.sigma <= absurd_magnitude(*testable_[k].entry, duration_s_))
      kept.push_back(testable_[k]);
  }
  testable_ = std::move(kept);
}

// Rows that are left over after the base fit are all that can speak for a name.
std::string RestDiagnoser::why_not_tested() const {
  const RestFit& base = result_.base;
  double redundancy = 0.0;
  for (const double r : base.redundancy) redundancy += r;
  if (!base.converged) return "the 21 parameters could not be fitted: " + base.message;
  std::string why;
  if (redundancy < options_.least_redundancy)
    why = std::to_string(data_.rests.size()) + " rests and " + std::to_string(data_.legs.size()) +
          " rotations leave " + std::to_string(static_cast<int>(std::lround(redundancy))) +
          " observations beyond the 21 parameters, where " +
          std::to_string(static_cast<int>(std::lround(options_.least_redundancy))) + " are wanted";
  const auto hangs = [&](RestKind kind, double left_out, double fitted) {
    if (!(left_out > options_.most_leverage * fitted)) return;
    why += (why.empty() ? "the fit hangs on single rests: left out in turn, " : " and ") + std::string("the error of ") +
           to_string(kind) + " is " + std::to_string(static_cast<int>(std::lround(left_out / fitted))) + " times the fitted one";
  };
  if (why.empty() && base.undetermined.empty()) {
    hangs(RestKind::norm, base.left_out.norm_rms_mps2, base.errors.norm_rms_mps2);
    hangs(RestKind::direction, base.left_out.direction_rms_rad, base.errors.direction_rms_rad);
  } else if (!base.undetermined.empty()) {
    why += (why.empty() ? "" : "; ") + std::string("not determined:");
    for (const std::string& key : base.undetermined) why += " " + key;
  }
  return why;
}

// Once a triad is known to change with time, its slow changes of any shape are held against every other effect: poses
// that were taken in a regular order change slowly with time too.
std::vector<EffectColumn> RestDiagnoser::slow_columns() const {
  std::vector<EffectColumn> columns;
  for (const EffectColumn& column : catalogue_columns(data_.recording->info)) {
    if (cause_of(*column.entry) != "time") continue;
    const bool accused = std::any_of(model_.columns.begin(), model_.columns.end(), [&](const EffectColumn& c) {
      return cause_of(*c.entry) == "time" && c.entry->name.substr(0, 4) == column.entry->name.substr(0, 4);
    });
    if (accused) columns.push_back(column);
  }
  return columns;
}

RestDiagnoser::Choice RestDiagnoser::choose(const RestScores& scores, const RestScores* guarded) const {
  int tests = 0;
  for (int k = 0; k < static_cast<int>(testable_.size()); ++k) tests += scores.of(k).visible ? 1 : 0;
  const double limit = options_.false_alarm / std::max(1, 2 * tests);  // single components, and groups
  const double charge = std::log(rows());                              // BIC: of one more parameter
  Choice best;
  for (int k = 0; k < static_cast<int>(testable_.size()); ++k) {
    const EffectColumn& column = testable_[static_cast<std::size_t>(k)];
    const ColumnScore& score = scores.of(k);
    if (!score.visible || struck_.contains(std::string(column.entry->name))) continue;
    const bool further = in_model(column.entry);
    bool declared = score.p_value < limit;
    if (!declared && !further) {
      // On the other triad the same cause has only the few effects of its kind to be told from, not the whole
      // catalogue.
      const double group_limit = cause_on_other_triad(*column.entry) ? options_.false_alarm : limit;
      const RestScores::Group group = scores.group(members(*column.entry, column.tau_s));
      declared = group.rank > 1 && group.p_value < group_limit;
    }
    if (!declared && !(further && score.statistic > charge)) continue;
    if (guarded != nullptr && !further && cause_of(*column.entry) != "time" && !(guarded->of(k).p_value < limit))
      continue;
    // A time constant that was picked for its fit is a parameter too.
    const double statistic = score.statistic - (column.entry->taus_s.empty() || further ? 0.0 : charge);
    if (statistic > best.statistic) best = {k, statistic, declared};
  }
  return best;
}

// Among effects the data cannot tell apart, the one with the fewest components.
int RestDiagnoser::simplest_alias(const RestScores& scores, int best) const {
  const std::size_t most = testable_[static_cast<std::size_t>(best)].entry->components.size();
  int simplest = best;
  double highest = 0.0;
  for (int k = 0; k < static_cast<int>(testable_.size()); ++k) {
    const EffectColumn& other = testable_[static_cast<std::size_t>(k)];
    const ColumnScore& score = scores.of(k);
    if (!score.visible || other.entry->components.size() >= most || struck_.contains(std::string(other.entry->name)))
      continue;
    if (scores.of(best).statistic - score.statistic > options_.alias_margin) continue;
    const double statistic = score.statistic - (other.entry->taus_s.empty() ? 0.0 : std::log(rows()));
    if (scores.correlation(best, k) < alias_correlation || statistic <= highest) continue;
    highest = statistic;
    simplest = k;
  }
  return simplest;
}

bool RestDiagnoser::cause_on_other_triad(const EffectEntry& entry) const {
  const std::string_view cause = cause_of(entry);
  bool there = false;
  for (const EffectColumn& column : model_.columns) {
    if (cause.empty() || cause_of(*column.entry) != cause) continue;
    if (column.entry->name.substr(0, 4) == entry.name.substr(0, 4)) return false;  // accused on this triad already
    there = true;
  }
  return there;
}

void RestDiagnoser::note_aliases(const RestScores& scores, int chosen) {
  const EffectEntry* entry = testable_[static_cast<std::size_t>(chosen)].entry;
  std::vector<std::string> names;
  for (int k = 0; k < static_cast<int>(testable_.size()); ++k) {
    const EffectColumn& other = testable_[static_cast<std::size_t>(k)];
    if (other.entry == entry || !scores.of(k).visible) continue;
    const bool close = scores.of(chosen).statistic - scores.of(k).statistic < options_.alias_margin &&
                       scores.of(k).statistic > options_.alias_margin &&
                       scores.correlation(chosen, k) > kindred_correlation;
    if (!close && scores.correlation(chosen, k) < 0.97) continue;
    const std::string name(other.entry->name);
    if (std::find(names.begin(), names.end(), name) == names.end()) names.push_back(name);
  }
  const auto known = std::find_if(result_.aliases.begin(), result_.aliases.end(),
                                  [&](const auto& item) { return item.first == entry->name; });
  if (known == result_.aliases.end()) result_.aliases.emplace_back(entry->name, names);
}

// Both sides with the weights of the model before, so that the new effect is measured with the old yardstick.
bool RestDiagnoser::passes_gate(const Model& before, const Model& after, bool first) const {
  const RestSystem a =
      make_rest_system(data_, before.fit.parameters, effect_model(before.columns, before.fit.effect_values), true);
  const RestSystem b =
      make_rest_system(data_, after.fit.parameters, effect_model(after.columns, after.fit.effect_values), true);
  const VectorXd yardstick = rest_weights(a, before.fit.floors);
  VectorXd error_before = left_out_residual(a, yardstick);
  VectorXd error_after = left_out_residual(b, rest_weights(b, after.fit.floors));
  // Kind by kind, as the likelihood has it: one kind's large errors must not drown another's.
  double gain = 0.0;
  double rows = 0.0;
  for (const RestKind kind : {RestKind::norm, RestKind::direction, RestKind::gyro}) {
    VectorXd x = error_before;
    VectorXd y = error_after;
    double count = 0.0;
    for (Eigen::Index k = 0; k < x.size(); ++k) {
      const bool use = a.kind[static_cast<std::size_t>(k)] == kind && !std::isnan(x[k]) && !std::isnan(y[k]);
      if (!use) x[k] = y[k] = NAN;
      count += use ? 1.0 : 0.0;
    }
    const double was = mean_square(x, yardstick);
    const double is = mean_square(y, yardstick);
    if (count < 1.0 || !(was > 0.0) || !(is > 0.0)) continue;
    gain += count * std::log(was / is);
    rows += count;
  }
  // gain / rows: logarithm of the mean square over all kinds
  if (!(gain > (first ? 2.0 * options_.gate_gain * rows : 0.0))) return false;
  return options_.holdout == nullptr || !first || holdout_gain(before, after) > 0.0;
}

// The same on the second recording: positive when its error falls.
double RestDiagnoser::holdout_gain(const Model& before, const Model& after) const {
  const auto system = [&](const Model& m) {
    return make_rest_system(*options_.holdout, m.fit.parameters, effect_model(m.columns, m.fit.effect_values), false);
  };
  const RestSystem a = system(before);
  const RestSystem b = system(after);
  const VectorXd weights = rest_weights(a, before.fit.floors);
  std::array<double, rest_kind_count> was{}, is{}, rows{};
  for (Eigen::Index k = 0; k < a.residual.size(); ++k) {
    const auto kind = static_cast<std::size_t>(a.kind[static_cast<std::size_t>(k)]);
    was[kind] += std::pow(a.residual[k] * weights[k], 2);
    is[kind] += std::pow(b.residual[k] * weights[k], 2);
    rows[kind] += 1.0;
  }
  double gain = 0.0;
  for (std::size_t k = 0; k < rest_kind_count; ++k)
    if (was[k] > 0.0 && is[k] > 0.0) gain += rows[k] * std::log(was[k] / is[k]);
  return gain;
}

RestHoldout RestDiagnoser::on_holdout(const RestFit& fit, const std::vector<RestEffect>& effects) const {
  RestHoldout result;
  if (options_.holdout == nullptr) return result;
  const RestSystem system = rest_system_at(*options_.holdout, fit, effects, reference_c_);
  result.errors = rest_errors(system, system.residual);
  result.chi_square = rest_weights(system, result_.final.floors).cwiseProduct(system.residual).squaredNorm();
  result.observations = static_cast<int>(system.residual.size());
  result.normalised_rms = std::sqrt(result.chi_square / std::max(1, result.observations));
  return result;
}

void RestDiagnoser::conclude() {
  result_.final = model_.fit;
  for (std::size_t k = 0; k < model_.columns.size(); ++k)
    result_.effects.push_back({model_.columns[k], model_.fit.effect_values[static_cast<Eigen::Index>(k)],
                               model_.fit.sigma[parameter_count + static_cast<Eigen::Index>(k)]});
  const EffectModel none = effect_model({}, VectorXd());
  const RestSystem before = make_rest_system(data_, result_.base.parameters, none, true);
  const RestSystem after =
      make_rest_system(data_, model_.fit.parameters, effect_model(model_.columns, model_.fit.effect_values), true);
  const VectorXd weights = rest_weights(after, model_.fit.floors);
  result_.error_before = std::sqrt(mean_square(before.residual, weights));
  result_.error_after = std::sqrt(mean_square(after.residual, weights));
  result_.left_out_before =
      std::sqrt(mean_square(left_out_residual(before, rest_weights(before, result_.base.floors)), weights));
  result_.left_out_after = std::sqrt(mean_square(left_out_residual(after, weights), weights));
  result_.holdout_before = on_holdout(result_.base, {});
  result_.holdout_after = on_holdout(result_.final, result_.effects);
  double worst = 0.0;
  for (const RestKind kind : {RestKind::norm, RestKind::direction, RestKind::gyro}) {
    const double ratio = model_.fit.white_ratio[static_cast<std::size_t>(kind)];
    worst = std::max(worst, ratio);
    if (ratio > 2.0) result_.remainder.push_back(to_string(kind));
  }
  result_.verdict = !model_.columns.empty()              ? RestDiagnosis::Verdict::extended
                    : worst > options_.unexplained_ratio ? RestDiagnosis::Verdict::unexplained
                                                         : RestDiagnosis::Verdict::clean;
  std::stable_sort(result_.candidates.begin(), result_.candidates.end(),
                   [](const RestCandidate& a, const RestCandidate& b) { return a.score > b.score; });
}

Result<RestDiagnosis> RestDiagnoser::run() {
  find_testable();
  const EffectModel none = effect_model({}, VectorXd());
  Result<RestFit> base = fit_rests(data_, none);
  if (!base) return base.error();
  result_.base = *base;
  model_.fit = *base;
  result_.not_tested = why_not_tested();
  if (!result_.not_tested.empty()) {
    for (RestCandidate& candidate : result_.candidates)
      if (candidate.remark.empty()) candidate.remark = "not tested: too few observations";
    conclude();
    return std::move(result_);
  }
  bool first_pass = true;
  while (static_cast<int>(model_.columns.size()) < options_.max_components) {
    const std::vector<EffectColumn> slow = slow_columns();
    const RestSystem system = system_with_candidates(slow);
    const int in_model_columns = rest_parameter_count + static_cast<int>(model_.columns.size());
    const RestScores scores(system, model_.fit, in_model_columns);
    if (first_pass) {
      fill_table(scores);
      first_pass = false;
      const std::size_t all = testable_.size();
      strike_invisible(scores);
      if (testable_.size() != all) continue;  // the scores are numbered anew
    }
    std::optional<RestScores> guarded;
    if (!slow.empty()) {
      std::vector<int> nuisance;
      for (std::size_t k = 0; k < slow.size(); ++k) nuisance.push_back(static_cast<int>(testable_.size() + k));
      guarded.emplace(system, model_.fit, in_model_columns, nuisance);
    }
    Choice choice = choose(scores, guarded ? &*guarded : nullptr);
    if (choice.candidate < 0) break;
    choice.candidate = simplest_alias(scores, choice.candidate);
    const EffectColumn column = testable_[static_cast<std::size_t>(choice.candidate)];
    const bool first = !in_model(column.entry);
    const Model extended = refit(model_, column);
    const ColumnScore& score = scores.of(choice.candidate);
    RestStage stage{column, score.statistic,
                    std::min(1.0, score.p_value * 2.0 * static_cast<double>(testable_.size())), false, "accepted"};
    const double value = extended.fit.effect_values[extended.fit.effect_values.size() - 1];
    if (!extended.fit.converged) stage.note = "the fit with it does not settle";
    else if (std::abs(value) > absurd_magnitude(*column.entry, duration_s_))
      stage.note = "it would come to " + std::to_string(value) + " " + std::string(column.entry->unit) + ", which no sensor has";
    else if (!passes_gate(model_, extended, first))
      stage.note = "the error on data left out of the fit does not fall";
    else stage.accepted = true;
    result_.stages.push_back(stage);
    if (!stage.accepted) {
      if (first) {
        struck_.emplace(column.entry->name);
        result_.struck_out.push_back(column.key() + ": " + stage.note);
      }
      std::erase_if(testable_,
                    [&](const EffectColumn& c) { return c.entry == column.entry && c.component == column.component; });
      continue;
    }
    note_aliases(scores, choice.candidate);
    model_ = extended;
    // The other time constants of an effect that is in the model are out of question.
    std::erase_if(testable_, [&](const EffectColumn& c) {
      return c.entry == column.entry && (c.component == column.component || c.tau_s != column.tau_s);
    });
    drop_superseded();
  }
  conclude();
  return std::move(result_);
}

}  // namespace

const char* to_string(RestDiagnosis::Verdict verdict) {
  switch (verdict) {
    case RestDiagnosis::Verdict::clean:
      return "clean";
    case RestDiagnosis::Verdict::extended:
      return "extended";
    case RestDiagnosis::Verdict::unexplained:
      return "unexplained";
  }
  return "?";
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
  return RestDiagnoser(data, options).run();
}

}  // namespace turncal
