#include "calib/diagnosis/effect_gate.h"

#include <algorithm>
#include <optional>

#include "calib/diagnosis/holdout.h"

namespace turncal {

namespace {

std::vector<EffectColumn> chosen_without(const DiagnosisModel& m, const std::string& name) {
  std::vector<EffectColumn> without;
  for (const EffectColumn& c : m.chosen)
    if (c.entry->name != name) without.push_back(c);
  return without;
}

std::vector<std::string> names_of(const std::vector<EffectColumn>& columns) {
  std::vector<std::string> names;
  for (const EffectColumn& c : columns)
    if (std::find(names.begin(), names.end(), c.entry->name) == names.end()) names.emplace_back(c.entry->name);
  return names;
}

// The effect of `name` did not help on held-out data; does another of its alias class, in its place?
bool take_rival(DiagnosisModel& m, Diagnosis& d, const std::string& name, double error_without,
                const HoldoutGate& check) {
  for (SelectionStage& stage : d.stages) {
    if (!stage.accepted || stage.chosen.entry->name != name) continue;
    for (const EffectColumn& rival : stage.rival_columns) {
      const std::string rival_name(rival.entry->name);
      if (std::find(d.gated_out.begin(), d.gated_out.end(), rival_name) != d.gated_out.end()) continue;
      std::vector<EffectColumn> model = chosen_without(m, name);
      model.push_back(rival);
      JointResult other = m.fit(model, m.current);
      if (check.error(other, m.current.noise).chi_square >= error_without) continue;
      std::vector<std::string> names = d.aliases[name];
      std::replace(names.begin(), names.end(), rival_name, name);
      d.aliases.erase(name);
      d.aliases[rival_name] = names;
      d.separate_by[rival_name] = d.separate_by[name];
      d.separate_by.erase(name);
      stage.note += "; held-out data prefer " + rival.key() + " of the same alias class";
      d.gated_out.push_back(name);
      m.chosen = model;
      m.current = std::move(other);
      return true;
    }
  }
  return false;
}

}  // namespace

void gate_effects(DiagnosisModel& m, Diagnosis& d) {
  const HoldoutGate check(
      m.recording, m.options.holdout,
      [&m](const std::vector<EffectColumn>& effects, const JointResult& from, const std::vector<char>& unobserved) {
        JointOptions o = m.estimate_options(effects, &from);
        o.unobserved = unobserved;
        o.noise = m.current.noise;
        o.faults_of = &from;
        o.one_step =
            true;  // a quarter of the dwells moves no parameter by more than a few sigma: the problem is linear there
        return joint_estimate(m.recording, o);
      });
  d.holdout_source = check.source();
  std::optional<HoldoutError> of_current, of_base;  // at the noise of m.current
  for (bool changed = true; changed && !m.chosen.empty();) {
    changed = false;
    of_base.reset();
    of_current = check.error(m.current);
    for (const std::string& name : names_of(m.chosen)) {
      const std::vector<EffectColumn> without = chosen_without(m, name);
      // Judged at the noise of m.current, so it is fitted at that, too.
      JointOptions at_noise = m.estimate_options(without, &m.current);
      at_noise.noise = m.current.noise;
      at_noise.faults_of = &m.current;
      const HoldoutError of_reduced =
          check.error(without.empty() ? d.base : joint_estimate(m.recording, at_noise), m.current.noise);
      if (without.empty()) of_base = of_reduced;
      if (of_reduced.chi_square > of_current->chi_square) continue;
      changed = true;
      if (take_rival(m, d, name, of_reduced.chi_square, check)) break;
      d.gated_out.push_back(name);
      d.aliases.erase(name);
      d.separate_by.erase(name);
      m.chosen = without;
      m.current = m.fit(m.chosen, d.base);
      break;
    }
  }
  d.holdout_before = of_base && !m.chosen.empty() ? *of_base : check.error(d.base, m.current.noise);
  d.holdout_after = m.chosen.empty() ? d.holdout_before : *of_current;
}

}  // namespace turncal
