#include "calib/diagnosis/name_check.h"

#include <algorithm>
#include <iterator>
#include <string_view>
#include <utility>

#include "calib/diagnosis/fit_pass.h"
#include "calib/diagnosis/nameless_families.h"

namespace turncal {

namespace {

struct FamilyFits {
  std::vector<int> columns;  // of their shifts
  std::vector<Family> families;
  std::vector<FamilyFit> fits;
};

FamilyFits families_at(const DiagnosisModel& m, const JointResult& at) {
  const FitPass pass = run_fit_pass(m.recording, at, at.setup);
  const SegmentScores scores(pass.recording, pass.filter, pass.columns, at.reference_temperature_c,
                             m.options.limits.fit);
  FamilyFits all{pass.columns, nameless_families(scores.pieces()), {}};
  all.fits = fit_families(scores, all.families);
  return all;
}

// What the effects of temperature are of; rate and lag of a temperature have names that begin alike.
constexpr std::pair<std::string_view, DisturbedSensor> with_temperature[] = {
    {"gyro_bias_temperature", DisturbedSensor::gyro_bias},
    {"gyro_scale_temperature", DisturbedSensor::gyro_scale},
    {"accel_bias_temperature", DisturbedSensor::accel_bias},
    {"accel_scale_temperature", DisturbedSensor::accel_scale}};

// A temperature coefficient is one of the curves with temperature of the same sensor. Where the effect is one, or cannot be told from one,
// that family is the same answer in another shape: as a rival it must be better, not as good.
bool holds(const Family& family, const DiagnosisModel& m, const Diagnosis& d, const std::string& name) {
  if (family.kind != "temperature curve") return false;
  std::vector<std::string> alike = {name};
  if (const auto aliases = d.aliases.find(name); aliases != d.aliases.end())
    alike.insert(alike.end(), aliases->second.begin(), aliases->second.end());
  for (const std::string& one : alike) {
    const bool same_sensor =
        std::any_of(std::begin(with_temperature), std::end(with_temperature),
                    [&](const auto& row) { return row.second == family.sensor && one.starts_with(row.first); });
    // A component's name begins with the axis of its sensor.
    for (const EffectColumn& c : m.chosen)
      if (same_sensor && c.entry->name == name &&
          c.entry->components[static_cast<std::size_t>(c.component)][0] == "xyz"[family.axis])
        return true;
  }
  return false;
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
  const SelectionLimits& limits = m.options.limits.selection;
  for (const std::string& name : names_of(m.chosen)) {
    std::vector<EffectColumn> without;
    for (const EffectColumn& c : m.chosen)
      if (c.entry->name != name) without.push_back(c);
    const JointResult reduced = m.fit(without, m.current, &m.current.noise);
    const double gain = minus_two_log_likelihood(reduced) - minus_two_log_likelihood(m.current);
    const FamilyFits all = families_at(m, reduced);
    NameCheck check{name, gain, "", 0.0};
    bool rivalled = false;
    for (std::size_t f = 0; f < all.fits.size(); ++f) {
      const FamilyFit& fit = all.fits[f];
      if (fit.gain > check.family_gain) {
        check.family = all.families[f].what;
        check.family_gain = fit.gain;
      }
      const double margin = holds(all.families[f], m, d, name) ? 0.0 : limits.family_margin;
      rivalled = rivalled || fit.gain > gain - margin;
      if (fit.gain < gain - limits.bic_margin || fit.shift.size() == 0) continue;
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
