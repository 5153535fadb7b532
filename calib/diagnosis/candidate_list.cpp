#include "calib/diagnosis/candidate_list.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "calib/statistics/distributions.h"

namespace turncal {

namespace {

std::vector<double> taus_of(const EffectEntry& entry) {
  return entry.taus_s.empty() ? std::vector<double>{0.0} : entry.taus_s;
}

// Visible columns of an effect with one time constant.
std::vector<int> members_of(const DiagnosisModel& m, const Scores& scores, const EffectEntry& entry, double tau_s) {
  std::vector<int> members;
  for (int k = 0; k < static_cast<int>(m.catalogue.size()); ++k) {
    const EffectColumn& column = m.catalogue[static_cast<std::size_t>(k)];
    if (column.entry == &entry && column.tau_s == tau_s && visible(scores, k)) members.push_back(k);
  }
  return members;
}

CandidateScore score_of(const DiagnosisModel& m, const Scores& s, int k) {
  CandidateScore c;
  c.column = m.catalogue[static_cast<std::size_t>(k)];
  c.visible = visible(s, k);
  if (!c.visible) return c;
  c.value = s.s[k] / s.Q(k, k);
  c.sigma = 1.0 / std::sqrt(s.Q(k, k));
  c.z = c.value / c.sigma;
  c.detectable = m.options.limits.selection.caught_at * c.sigma;
  c.visible = c.detectable <= absurd_magnitude(*c.column.entry);
  return c;
}

}  // namespace

void list_candidates(const DiagnosisModel& m, const Scores& s, Diagnosis& d) {
  for (int k = 0; k < static_cast<int>(m.catalogue.size()); ++k) {
    const CandidateScore c = score_of(m, s, k);
    // Of variants with different time constants the best one stands for the component.
    const auto same = std::find_if(d.candidates.begin(), d.candidates.end(),
                                   [&](const CandidateScore& o) { return o.column.key() == c.column.key(); });
    if (same == d.candidates.end())
      d.candidates.push_back(c);
    else if (c.visible && (!same->visible || std::abs(c.z) > std::abs(same->z)))
      *same = c;
  }
  for (const EffectEntry& entry : effect_catalogue()) {
    const bool any = std::any_of(d.candidates.begin(), d.candidates.end(),
                                 [&](const CandidateScore& c) { return c.column.entry == &entry && c.visible; });
    if (!any) {
      d.undetectable.emplace_back(entry.name);
      continue;
    }
    GroupScore group;
    group.name = entry.name;
    for (const double tau_s : taus_of(entry)) {
      const std::vector<int> members = members_of(m, s, entry, tau_s);
      if (members.empty()) continue;
      const GroupTest test = group_test(s, members);
      if (test.chi_square >= group.chi_square)
        group = {group.name, test.chi_square, test.rank, static_cast<int>(members.size()),
                 chi_square_tail(test.chi_square, test.rank)};
    }
    d.groups.push_back(group);
  }
}

void name_aliases(const DiagnosisModel& m, const Scores& s, const EffectColumn& chosen, double chosen_z_square,
                  SelectionStage& stage, Diagnosis& d) {
  const std::string name(chosen.entry->name);
  int chosen_index = 0;
  for (int k = 0; k < static_cast<int>(m.catalogue.size()); ++k) {
    const EffectColumn& column = m.catalogue[static_cast<std::size_t>(k)];
    if (column.key() == chosen.key() && column.tau_s == chosen.tau_s) chosen_index = k;
  }
  d.aliases[name];
  for (const EffectEntry& entry : effect_catalogue()) {
    if (&entry == chosen.entry) continue;
    int best = -1;
    double best_z_square = 0.0;
    bool imitates = false;
    for (const double tau_s : taus_of(entry)) {
      const std::vector<int> members = members_of(m, s, entry, tau_s);
      for (const int k : members) {
        const double z_square = s.s[k] * s.s[k] / s.Q(k, k);
        if (z_square <= best_z_square) continue;
        best = k;
        best_z_square = z_square;
      }
      // Large enough, an effect is told even from its imitators: all their components together explain the data less well.
      const SelectionLimits& limits = m.options.limits.selection;
      if (!members.empty() && multiple_correlation(s, chosen_index, members) > limits.alias_correlation &&
          group_test(s, members).chi_square > chosen_z_square - limits.bic_margin)
        imitates = true;
    }
    const bool as_good = best >= 0 && best_z_square > chosen_z_square - m.options.limits.selection.bic_margin;
    if (as_good) {
      stage.rivals.emplace_back(std::string(entry.name), best_z_square);
      stage.rival_columns.push_back(m.catalogue[static_cast<std::size_t>(best)]);
    }
    if ((as_good || imitates) && best >= 0) stage.alias_columns.push_back(m.catalogue[static_cast<std::size_t>(best)]);
    if (as_good || imitates) add_alias(name, entry, d);
  }
}

void add_alias(const std::string& name, const EffectEntry& other, Diagnosis& d) {
  std::vector<std::string>& names = d.aliases[name];
  if (std::find(names.begin(), names.end(), other.name) != names.end()) return;
  names.emplace_back(other.name);
  std::string& how = d.separate_by[name];
  how += (how.empty() ? "" : "; ") + std::string(other.name) + ": " + std::string(other.seen_by);
}

}  // namespace turncal
