#include "calib/diagnosis/name_check.h"

#include <utility>

#include "calib/diagnosis/candidate_list.h"
#include "calib/diagnosis/lack_of_fit.h"
#include "calib/diagnosis/nameless_families.h"

namespace turncal {

namespace {

struct FamilyFits {
  std::vector<int> columns;  // of their shifts
  std::vector<Family> families;
  std::vector<FamilyFit> fits;
};

struct ScoredFit {
  FitPass pass;
  SegmentScores scores;
  std::vector<Family> families;
};

ScoredFit scored(const DiagnosisModel& m, const JointResult& at) {
  FitPass pass = run_fit_pass(m.recording, at, at.setup);
  SegmentScores scores(pass.recording, pass.filter, pass.columns, at.reference_temperature_c, m.options.limits.fit);
  std::vector<Family> families = nameless_families(scores.pieces());
  return {std::move(pass), std::move(scores), std::move(families)};
}

FamilyFits families_at(const DiagnosisModel& m, const JointResult& at) {
  ScoredFit s = scored(m, at);
  std::vector<FamilyFit> fits = fit_families(s.scores, s.families);
  return {std::move(s.pass.columns), std::move(s.families), std::move(fits)};
}

// For each effect of the model the families that hold it: what goes with a temperature or a rate by a curve, of which the effect is one as far
// as this recording shows. A coefficient of temperature is, and so is a drift where the temperature changes with time.
using Holding = std::vector<std::vector<bool>>;  // [effect][family]
Holding holding(const DiagnosisModel& m) {
  const ScoredFit s = scored(m, m.current);
  const std::size_t effects = m.current.effects.size();
  Holding holds(effects, std::vector<bool>(s.families.size(), false));
  for (std::size_t f = 0; f < s.families.size(); ++f) {
    if (!s.families[f].by_a_curve()) continue;
    const SegmentScores::Test test = s.scores.tests({s.families[f].weights}).front();
    for (std::size_t e = 0; e < effects; ++e)
      holds[e][f] =
          s.scores.correlation(test, static_cast<Eigen::Index>(s.pass.columns.size() - effects + e),
                               m.options.limits.fit.rank_floor) > m.options.limits.selection.alias_correlation;
  }
  return holds;
}

const EffectEntry& temperature_effect(DisturbedSensor sensor) {
  static constexpr const char* names[] = {"gyro_bias_temperature", "gyro_scale_temperature", "accel_bias_temperature",
                                          "accel_scale_temperature"};
  return *find_effect(names[static_cast<int>(sensor)]);
}

}  // namespace

std::string looks_like(const DiagnosisModel& m, const JointResult& fit) {
  const FamilyFits all = families_at(m, fit);
  std::string what;
  double most = m.threshold;
  for (std::size_t k = 0; k < all.fits.size(); ++k) {
    if (all.fits[k].gain <= most) continue;
    most = all.fits[k].gain;
    what = all.families[k].what;
  }
  return what;
}

void check_names(DiagnosisModel& m, Diagnosis& d) {
  if (m.chosen.empty()) return;
  const SelectionLimits& limits = m.options.limits.selection;
  const Holding holds = holding(m);
  for (const std::string& name : names_of(m.chosen)) {
    const JointResult reduced = m.fit(m.chosen_without(name), m.current, &m.current.noise);
    const double gain = minus_two_log_likelihood(reduced) - minus_two_log_likelihood(m.current);
    const FamilyFits all = families_at(m, reduced);
    NameCheck check{name, gain, "", 0.0};
    bool rivalled = false;
    for (std::size_t f = 0; f < all.fits.size(); ++f) {
      const FamilyFit& fit = all.fits[f];
      const Family& family = all.families[f];
      if (fit.gain > check.family_gain) {
        check.family = family.what;
        check.family_gain = fit.gain;
      }
      bool held = false;
      for (std::size_t e = 0; e < holds.size(); ++e)
        held = held || (holds[e][f] && m.current.effects[e].column.entry->name == name);
      rivalled = rivalled || fit.gain > gain - (held ? 0.0 : limits.family_margin);
      if ((fit.gain < gain - limits.bic_margin && !held) || fit.shift.size() == 0) continue;
      if (family.kind == temperature_curve && name != temperature_effect(family.sensor).name)
        add_alias(name, temperature_effect(family.sensor), d);
      ParameterVector beside = to_vector(reduced.parameters);
      for (std::size_t k = 0; k < all.columns.size(); ++k)
        if (all.columns[k] < parameter_count) beside[all.columns[k]] += fit.shift[static_cast<Eigen::Index>(k)];
      m.beside.push_back(from_vector(beside));
    }
    d.name_checks.push_back(check);
    if (rivalled) d.rivalled.push_back(name);
  }
}

}  // namespace turncal
