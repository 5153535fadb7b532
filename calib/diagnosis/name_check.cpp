#include "calib/diagnosis/name_check.h"

#include "calib/diagnosis/fit_pass.h"
#include "calib/diagnosis/nameless_families.h"

namespace turncal {

namespace {

struct FamilyFits {
  std::vector<int> columns;  // of their shifts
  std::vector<Family> families;
  std::vector<FamilyFit> fits;
};

FamilyFits fit_families(const DiagnosisModel& m, const JointResult& at) {
  const FitPass pass = run_fit_pass(m.recording, at, at.setup);
  const SegmentScores scores(m.recording, pass.filter, pass.columns, at.reference_temperature_c, m.options.limits.fit);
  FamilyFits all{pass.columns, nameless_families(scores.pieces()), {}};
  for (const Family& family : all.families) all.fits.push_back(fit_family(scores, family));
  return all;
}

}  // namespace

std::string looks_like(const DiagnosisModel& m, const JointResult& fit) {
  const FamilyFits all = fit_families(m, fit);
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
  const SelectionLimits& limits = m.options.limits.selection;
  for (const std::string& name : names_of(m.chosen)) {
    std::vector<EffectColumn> without;
    for (const EffectColumn& c : m.chosen)
      if (c.entry->name != name) without.push_back(c);
    const JointResult reduced = m.fit(without, m.current, &m.current.noise);
    const double gain = minus_two_log_likelihood(reduced) - minus_two_log_likelihood(m.current);
    const FamilyFits all = fit_families(m, reduced);
    NameCheck check{name, gain, "", 0.0};
    for (std::size_t f = 0; f < all.fits.size(); ++f) {
      const FamilyFit& fit = all.fits[f];
      if (fit.gain > check.family_gain) {
        check.family = all.families[f].what;
        check.family_gain = fit.gain;
      }
      if (fit.gain < gain - limits.bic_margin || fit.shift.size() == 0) continue;
      ParameterVector beside = to_vector(reduced.parameters);
      for (std::size_t k = 0; k < all.columns.size(); ++k)
        if (all.columns[k] < parameter_count) beside[all.columns[k]] += fit.shift[static_cast<Eigen::Index>(k)];
      m.beside.push_back(from_vector(beside));
    }
    d.name_checks.push_back(check);
    if (check.family_gain > gain - limits.family_margin) d.rivalled.push_back(name);
  }
}

}  // namespace turncal
