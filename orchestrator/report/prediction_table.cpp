#include "orchestrator/report/prediction_table.h"

#include <algorithm>
#include <map>
#include <set>

#include "orchestrator/figures/report_format.h"

namespace turncal {

namespace {

std::string row_name(const PredictedEffect& effect) {
  std::string name = effect.column.key();
  if (effect.column.tau_s > 0.0) name += formatted(" (%g s)", effect.column.tau_s);
  return name;
}

void print_confusions(const NamedPrediction& column, std::ostream& out) {
  std::map<std::string, std::set<std::string>> aliases;
  std::vector<std::string> unseen;
  for (const PredictedEffect& effect : column.prediction.effects) {
    if (!effect.visible) unseen.push_back(row_name(effect));
    if (effect.among_its_own) aliases[std::string(effect.column.entry->name)].insert("its own other components");
    for (const std::string& alias : effect.aliases) aliases[std::string(effect.column.entry->name)].insert(alias);
  }
  out << "\n"
      << column.name << ": " << (aliases.empty() ? "no effect is imitated by another" : "imitated by others (~)")
      << "\n";
  for (const auto& [name, others] : aliases)
    out << "  " << name << " by " << join({others.begin(), others.end()}) << "\n";
  out << column.name << ": not detectable (-): " << (unseen.empty() ? "none" : join(unseen)) << "\n";
}

}  // namespace

std::string describe(const Undetermined& direction) {
  std::vector<std::string> terms;
  for (const auto& [key, weight] : direction.combination) terms.push_back(formatted("%+.2f %s", weight, key.c_str()));
  return join(terms, " ");
}

void print_sigmas(const std::vector<NamedPrediction>& columns, const RecordingInfo& info, std::ostream& out) {
  out << formatted("%-5s %-13s", "sigma", "unit");
  for (std::size_t c = 0; c < columns.size(); ++c)
    out << formatted(" %14s", columns[c].name.c_str()) << (c > 0 ? "  ratio" : "");
  out << "\n";
  for (int k = 0; k < parameter_count; ++k) {
    const auto index = static_cast<std::size_t>(k);
    if (!parameter_is_free[index]) continue;
    out << formatted("%-5s %-13s", std::string(parameter_keys[index]).c_str(),
                     parameter_unit(parameter_keys[index], info.gyro_increment));
    const Prediction& first = columns.front().prediction;
    for (std::size_t c = 0; c < columns.size(); ++c) {
      const Prediction& p = columns[c].prediction;
      out << (p.determined[index] ? formatted(" %14.3g", p.sigma[k]) : formatted(" %14s", "-"));
      if (c == 0) continue;
      out << (p.determined[index] && first.determined[index] ? formatted("  %5.2f", p.sigma[k] / first.sigma[k])
                                                             : formatted("  %5s", "-"));
    }
    out << "\n";
  }
}

void print_undetermined(const std::vector<NamedPrediction>& columns, std::ostream& out) {
  for (const NamedPrediction& column : columns) {
    std::vector<std::string> lost;
    for (std::size_t k = 0; k < parameter_keys.size(); ++k)
      if (parameter_is_free[k] && !column.prediction.determined[k]) lost.emplace_back(parameter_keys[k]);
    if (lost.empty()) {
      out << column.name << ": all 21 parameters are determined\n";
      continue;
    }
    out << column.name << ": not determined: " << join(lost, " ") << "\n";
    for (const Undetermined& direction : column.prediction.undetermined)
      out << "  combination, in plausible ranges: " << describe(direction) << "\n";
  }
}

void print_effects(const std::vector<NamedPrediction>& columns, std::ostream& out) {
  out << formatted("%-40s %-9s", "smallest effect caught (5 sigma, alone)", "unit");
  for (const NamedPrediction& column : columns) out << formatted(" %15s", column.name.c_str());
  out << "\n";
  for (std::size_t row = 0; row < columns.front().prediction.effects.size(); ++row) {
    const PredictedEffect& first = columns.front().prediction.effects[row];
    out << formatted("%-40s %-9s", row_name(first).c_str(), std::string(first.column.entry->unit).c_str());
    for (const NamedPrediction& column : columns) {
      const PredictedEffect& effect = column.prediction.effects[row];
      out << (effect.visible ? formatted(" %14.3g%c", effect.detectable,
                                         effect.aliases.empty() && !effect.among_its_own ? ' ' : '~')
                             : formatted(" %14s ", "-"));
    }
    out << "\n";
  }
  for (const NamedPrediction& column : columns) print_confusions(column, out);
}

}  // namespace turncal
