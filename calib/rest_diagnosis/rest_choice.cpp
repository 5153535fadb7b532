#include "calib/rest_diagnosis/rest_choice.h"

#include <algorithm>
#include <cmath>

#include "calib/model/limits.h"

namespace turncal {

namespace {

bool cause_on_other_triad(const RestDiagnosisModel& m, const EffectEntry& entry) {
  const std::string_view cause = cause_of(entry);
  bool there = false;
  for (const EffectColumn& column : m.model.columns) {
    if (cause.empty() || cause_of(*column.entry) != cause) continue;
    if (column.entry->name.substr(0, 4) == entry.name.substr(0, 4)) return false;  // accused on this triad already
    there = true;
  }
  return there;
}

int best_component(const RestDiagnosisModel& m, const RestScores& scores, const RestScores* guarded) {
  int tests = 0;
  for (int k = 0; k < static_cast<int>(m.testable.size()); ++k) tests += scores.of(k).visible ? 1 : 0;
  const double limit = m.options.false_alarm / std::max(1, 2 * tests);  // single components, and groups
  const double charge = std::log(m.rows());                             // BIC: of one more parameter
  int best = -1;
  double highest = 0.0;
  for (int k = 0; k < static_cast<int>(m.testable.size()); ++k) {
    const EffectColumn& column = m.testable[static_cast<std::size_t>(k)];
    const ColumnScore& score = scores.of(k);
    if (!score.visible || m.struck.contains(std::string(column.entry->name))) continue;
    const bool further = m.in_model(column.entry);
    bool declared = score.p_value < limit;
    if (!declared && !further) {
      // On the other triad the same cause has only the few effects of its kind to be told from, not the whole
      // catalogue.
      const double group_limit = cause_on_other_triad(m, *column.entry) ? m.options.false_alarm : limit;
      const RestScores::Group group = scores.group(m.members(*column.entry, column.tau_s));
      declared = group.rank > 1 && group.p_value < group_limit;
    }
    if (!declared && !(further && score.statistic > charge)) continue;
    if (guarded != nullptr && !further && cause_of(*column.entry) != "time" && !(guarded->of(k).p_value < limit))
      continue;
    // A time constant that was picked for its fit is a parameter too.
    const double statistic = score.statistic - (column.entry->taus_s.empty() || further ? 0.0 : charge);
    if (statistic <= highest) continue;
    highest = statistic;
    best = k;
  }
  return best;
}

// Among effects the data cannot tell apart, the one with the fewest components.
int simplest_alias(const RestDiagnosisModel& m, const RestScores& scores, int best) {
  const std::size_t most = m.testable[static_cast<std::size_t>(best)].entry->components.size();
  int simplest = best;
  double highest = 0.0;
  for (int k = 0; k < static_cast<int>(m.testable.size()); ++k) {
    const EffectColumn& other = m.testable[static_cast<std::size_t>(k)];
    const ColumnScore& score = scores.of(k);
    if (!score.visible || other.entry->components.size() >= most || m.struck.contains(std::string(other.entry->name)))
      continue;
    if (scores.of(best).statistic - score.statistic > m.options.alias_margin) continue;
    const double statistic = score.statistic - (other.entry->taus_s.empty() ? 0.0 : std::log(m.rows()));
    if (scores.correlation(best, k) < rest_limits.class_correlation || statistic <= highest) continue;
    highest = statistic;
    simplest = k;
  }
  return simplest;
}

}  // namespace

std::vector<EffectColumn> slow_columns(const RestDiagnosisModel& m) {
  std::vector<EffectColumn> columns;
  for (const EffectColumn& column : catalogue_columns(m.data.recording->info)) {
    if (cause_of(*column.entry) != "time") continue;
    const bool accused = std::any_of(m.model.columns.begin(), m.model.columns.end(), [&](const EffectColumn& c) {
      return cause_of(*c.entry) == "time" && c.entry->name.substr(0, 4) == column.entry->name.substr(0, 4);
    });
    if (accused) columns.push_back(column);
  }
  return columns;
}

int choose_component(const RestDiagnosisModel& m, const RestScores& scores, const RestScores* guarded) {
  const int best = best_component(m, scores, guarded);
  return best < 0 ? best : simplest_alias(m, scores, best);
}

void note_aliases(const RestDiagnosisModel& m, const RestScores& scores, int chosen, RestDiagnosis& d) {
  const EffectEntry* entry = m.testable[static_cast<std::size_t>(chosen)].entry;
  std::vector<std::string> names;
  for (int k = 0; k < static_cast<int>(m.testable.size()); ++k) {
    const EffectColumn& other = m.testable[static_cast<std::size_t>(k)];
    if (other.entry == entry || !scores.of(k).visible) continue;
    const bool close = scores.of(chosen).statistic - scores.of(k).statistic < m.options.alias_margin &&
                       scores.of(k).statistic > m.options.alias_margin &&
                       scores.correlation(chosen, k) > rest_limits.kindred_correlation;
    if (!close && scores.correlation(chosen, k) < SelectionLimits{}.alias_correlation) continue;
    const std::string name(other.entry->name);
    if (std::find(names.begin(), names.end(), name) == names.end()) names.push_back(name);
  }
  const auto known =
      std::find_if(d.aliases.begin(), d.aliases.end(), [&](const auto& item) { return item.first == entry->name; });
  if (known == d.aliases.end()) d.aliases.emplace_back(entry->name, names);
}

}  // namespace turncal
