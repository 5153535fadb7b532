#include "calib/diagnosis/diagnosis.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "calib/diagnosis/curve_of_two.h"
#include "calib/diagnosis/diagnosis_model.h"
#include "calib/diagnosis/effect_gate.h"
#include "calib/diagnosis/effect_selection.h"
#include "calib/diagnosis/felt_latitude.h"
#include "calib/diagnosis/holdout.h"
#include "calib/diagnosis/lack_of_fit.h"
#include "calib/diagnosis/lack_of_fit_tests.h"
#include "calib/diagnosis/name_check.h"
#include "calib/diagnosis/time_constant.h"
#include "calib/statistics/unit_slip.h"

namespace turncal {
namespace {

// Adds to the covariance what the free parameters and effects may be off by.
void widen(JointResult& r, const std::vector<Eigen::VectorXd>& shifts, double factor) {
  r.covariance *= factor;
  for (const Eigen::VectorXd& shift : shifts)
    if (shift.size() == r.covariance.rows() && shift.allFinite()) r.covariance += shift * shift.transpose();
  for (std::size_t i = 0; i < r.free.size(); ++i) {
    const Eigen::Index k = static_cast<Eigen::Index>(i);
    const double sigma = std::sqrt(r.covariance(k, k));
    if (r.free[i] < parameter_count) {
      if (r.sigma[r.free[i]] > 0.0) r.sigma[r.free[i]] = sigma;
    } else {
      r.effects[static_cast<std::size_t>(r.free[i] - parameter_count)].sigma = sigma;
    }
  }
}

// How far the free parameters go when another of its alias class stands in the place of a chosen effect. One pass, then linear.
std::vector<Eigen::VectorXd> alias_shifts(const DiagnosisModel& m, const Diagnosis& d) {
  std::vector<Eigen::VectorXd> shifts;
  std::vector<EffectColumn> others;
  std::vector<int> instead_of;  // index into m.current.effects
  for (std::size_t k = 0; k < m.current.effects.size(); ++k)
    for (const SelectionStage& stage : d.stages) {
      if (!stage.accepted || stage.chosen.key() != m.current.effects[k].column.key()) continue;
      for (const EffectColumn& other : stage.alias_columns) {
        others.push_back(other);
        instead_of.push_back(static_cast<int>(k));
      }
    }
  if (others.empty()) return shifts;
  const EffectModel model = effect_model_of(m.current, m.recording.info.latitude_deg, others);
  FilterSetup setup = m.current.setup;
  setup.narrow_columns = 0;
  const FilterResult pass = run_filter(m.recording, m.current.parameters, model, setup);
  Eigen::VectorXd ranges(parameter_count + model.columns);
  ranges.head(m.current.ranges.size()) = m.current.ranges;
  for (std::size_t k = 0; k < others.size(); ++k)
    ranges[m.current.ranges.size() + static_cast<Eigen::Index>(k)] = absurd_magnitude(*others[k].entry);
  for (std::size_t i = 0; i < others.size(); ++i) {
    const int out = parameter_count + instead_of[i];
    const int in = parameter_count + static_cast<int>(m.current.effects.size() + i);
    std::vector<int> subset = m.current.free;
    std::replace(subset.begin(), subset.end(), out, in);
    const double value = model.values[out - parameter_count];
    const Eigen::VectorXd gradient = pass.gradient - value * pass.information.col(out);
    const SubsetSolution solution = solve_subset(pass.information, gradient, subset, ranges);
    Eigen::VectorXd shift = solution.step;
    for (std::size_t k = 0; k < subset.size(); ++k)
      if (subset[k] == in || solution.lost[k]) shift[static_cast<Eigen::Index>(k)] = 0.0;
    shifts.push_back(shift);
  }
  return shifts;
}

// From a fit to other parameters, along its free ones; its effects stay.
Eigen::VectorXd shift_to(const Parameters& other, const JointResult& from) {
  const ParameterVector change = to_vector(other) - to_vector(from.parameters);
  Eigen::VectorXd shift = Eigen::VectorXd::Zero(from.covariance.rows());
  for (Eigen::Index i = 0; i < shift.size(); ++i)
    if (const int k = from.free[static_cast<std::size_t>(i)]; k < parameter_count) shift[i] = change[k];
  return shift;
}

// How far the free parameters of a trusted model go by what may be the truth as well: others of an alias class, families and effects
// that came near.
std::vector<Eigen::VectorXd> what_may_be(const DiagnosisModel& m, const Diagnosis& d) {
  std::vector<Eigen::VectorXd> shifts = alias_shifts(m, d);
  for (const Parameters& beside : m.beside) shifts.push_back(shift_to(beside, m.current));
  // A wrong clock is the accelerometers' common scale factor, which gravity has taken up: docs/diagnosis.md.
  for (const EstimatedEffect& e : m.current.effects)
    if (e.column.entry->name == "sample_period") {
      Parameters other = m.current.parameters;
      other.a *= 1.0 + e.column.entry->si * std::hypot(e.value, e.sigma);
      shifts.push_back(shift_to(other, m.current));
    }
  const std::vector<LackOfFitTest>& tests = d.lack_of_fit.tests;
  const double near = std::log10(m.options.limits.selection.near_family_wise /
                                 static_cast<double>(std::max<std::size_t>(tests.size(), 1)));
  // Tests of one thing look at it from several sides: the strongest of a family stands for all.
  std::map<std::string, const LackOfFitTest*> strongest;
  for (const LackOfFitTest& test : tests) {
    if (test.log10_p > near || test.shift.size() != m.current.covariance.rows()) continue;
    const LackOfFitTest*& one = strongest[test.family];
    if (one == nullptr || test.log10_p < one->log10_p) one = &test;
  }
  for (const auto& [family, test] : strongest) shifts.push_back(test->shift);
  shifts.insert(shifts.end(), d.lack_of_fit.unseen.begin(), d.lack_of_fit.unseen.end());
  return shifts;
}

// Parameters that one of the shifts moves by more than their sigma.
std::vector<std::string> moved_by(const JointResult& r, const std::vector<Eigen::VectorXd>& shifts) {
  std::vector<std::string> moved;
  for (std::size_t i = 0; i < r.free.size(); ++i) {
    if (r.free[i] >= parameter_count) continue;
    const double sigma = r.sigma[r.free[i]];
    const bool far = std::any_of(shifts.begin(), shifts.end(), [&](const Eigen::VectorXd& s) {
      return s.size() == r.covariance.rows() && sigma > 0.0 && std::abs(s[static_cast<Eigen::Index>(i)]) > sigma;
    });
    if (far) moved.emplace_back(parameter_keys[static_cast<std::size_t>(r.free[i])]);
  }
  return moved;
}

// Nothing is named: what was found is a candidate, the base model is handed out with sigmas that hold what was left unexplained.
void leave_unexplained(DiagnosisModel& m, Diagnosis& d) {
  d.verdict = Verdict::unexplained;
  d.candidate_names = names_of(m.chosen);
  for (const std::string& name : d.gated_out)
    if (std::find(d.candidate_names.begin(), d.candidate_names.end(), name) == d.candidate_names.end())
      d.candidate_names.push_back(name);
  const Eigen::Index base_rows = d.base.covariance.rows();
  std::vector<Eigen::VectorXd> shifts;
  double factor = 1.0;
  for (const LackOfFitTest& test : d.lack_of_fit.tests) {
    if (test.log10_p >= d.lack_of_fit.log10_limit) continue;
    if (test.shift.size() >= base_rows) shifts.push_back(test.shift.head(base_rows));
    if (test.tries == 1.0 && test.degrees > 0.0) factor = std::max(factor, test.chi_square / test.degrees);
  }
  if (!m.chosen.empty()) shifts.push_back(shift_to(m.current.parameters, d.base));
  for (const Parameters& beside : m.beside) shifts.push_back(shift_to(beside, d.base));
  d.moved = moved_by(d.base, shifts);
  m.current = d.base;
  m.chosen.clear();
  d.fitted_covariance = m.current.covariance;
  widen(m.current, shifts, factor);
  d.holdout_after = d.holdout_before;
  d.aliases.clear();
  d.separate_by.clear();
}

CurveOfTwo curve_of_two(const JointResult& fit) {
  std::vector<EffectColumn> columns;
  std::vector<double> values;
  std::vector<Eigen::Index> rows;
  for (std::size_t i = 0; i < fit.free.size(); ++i) {
    if (fit.free[i] < parameter_count) continue;
    const EstimatedEffect& effect = fit.effects[static_cast<std::size_t>(fit.free[i] - parameter_count)];
    if (is_turn_on(effect.column)) continue;
    columns.push_back(effect.column);
    values.push_back(effect.value);
    rows.push_back(static_cast<Eigen::Index>(i));
  }
  const auto count = static_cast<Eigen::Index>(values.size());
  return curve_of_two(columns, Eigen::VectorXd::Map(values.data(), count), [&](int a, int b) {
    const Eigen::Index i = rows[static_cast<std::size_t>(a)], j = rows[static_cast<std::size_t>(b)];
    Eigen::Matrix2d covariance;
    covariance << fit.covariance(i, i), fit.covariance(i, j), fit.covariance(j, i), fit.covariance(j, j);
    return Eigen::Matrix2d(covariance.inverse());
  });
}

// Are all parameters determined that are estimated at all?
bool whole(const JointResult& fit) {
  for (std::size_t k = 0; k < parameter_count; ++k)
    if (parameter_is_free[k] && !fit.determined[k]) return false;
  return true;
}

// The accelerometers' pulses beat nearly always, and their innovations are those of the pulses.
bool noise_is_of_pulses(const LackOfFit& fit) { return fit.innovation_correlation < 0.0 && fit.beating_part > 0.5; }

// Empty where the innovations are about white, or are those of pulses and no larger than pulses make them.
std::string misfit_of_noise(const DiagnosisModel& m, const LackOfFit& fit) {
  const NoiseLimits& limits = m.options.limits.noise;
  const Whiteness& whiteness = m.current.whiteness;
  const bool of_pulses = noise_is_of_pulses(fit);
  if (fit.innovation_correlation < 0.0 && !of_pulses) return whiteness.white ? "" : whiteness.message;
  if (fit.innovation_correlation >= limits.correlation)
    return "innovations are correlated in time: the noise model does not fit";
  const double high = fit.innovation_level < 0.0 ? whiteness.level : fit.innovation_level;
  if (whiteness.level <= limits.lowest_level || high >= (of_pulses ? limits.highest_of_pulses : limits.highest_level))
    return "innovations are larger or smaller than the noise model says";
  return "";
}

void judge(DiagnosisModel& m, Diagnosis& d) {
  char text[320];
  const bool noise_given = m.options.estimate.noise.has_value();
  d.trusted = false;
  d.lack_of_fit = test_lack_of_fit(m.recording, m.current, m.options.holdouts, m.options.limits.fit);
  // Where even the noise does not fit, neither names nor patterns mean anything.
  const std::string noise_misfit = misfit_of_noise(m, d.lack_of_fit);
  if (!noise_misfit.empty()) {
    d.verdict = Verdict::noise_model;
    d.reason = noise_misfit + (noise_given ? " (the noise was given, not measured)" : "") + ": no claim on effects";
    m.chosen.clear();
    d.aliases.clear();
    d.separate_by.clear();
    d.unexplained_pattern.clear();
    m.current = d.base;
    d.holdout_after = d.holdout_before;
    return;
  }
  const LackOfFitTest& worst = d.lack_of_fit.worst;
  if (d.verdict == Verdict::unexplained) {
    d.reason = "a residual beyond noise that no catalogue effect explains; it looks like: " + d.unexplained_pattern;
    leave_unexplained(m, d);
    return;
  }
  if (!d.lack_of_fit.passed) {
    std::snprintf(text, sizeof text, "%s: chi-square %.1f of %.0f (%s), which noise does once in 1e%.0f recordings",
                  worst.what.c_str(), worst.chi_square, worst.degrees, worst.family.c_str(), -worst.log10_p);
    d.unexplained_pattern = looks_like(m, d.base);
    if (d.unexplained_pattern.empty()) d.unexplained_pattern = worst.what;
    d.reason = text;
    leave_unexplained(m, d);
    return;
  }
  if (!d.gated_out.empty()) {
    d.reason = "an effect was found that held-out data do not confirm";
    d.unexplained_pattern = looks_like(m, d.base);
    leave_unexplained(m, d);
    return;
  }
  if (!d.rivalled.empty()) {
    const NameCheck& check = *std::find_if(d.name_checks.begin(), d.name_checks.end(),
                                           [&](const NameCheck& c) { return c.name == d.rivalled.front(); });
    std::snprintf(text, sizeof text, "%s (2 ln L %.1f) explains it as well as %s (%.1f)", check.family.c_str(),
                  check.family_gain, check.name.c_str(), check.gain);
    d.reason = text;
    d.unexplained_pattern = check.family;
    leave_unexplained(m, d);
    return;
  }
  if (const CurveOfTwo curve = curve_of_two(m.current); curve.found()) {
    d.reason = curve.why;
    d.unexplained_pattern = curve.what;
    leave_unexplained(m, d);
    return;
  }
  if (!whole(m.current)) {
    d.verdict = Verdict::not_tested;
    d.reason = "the recording does not determine all of the parameters";
    return;
  }
  d.trusted = true;
  d.fitted_covariance = m.current.covariance;
  std::vector<Eigen::VectorXd> shifts = what_may_be(m, d);
  const std::vector<OpenTime> times = open_times(m);
  for (const OpenTime& time : times) shifts.insert(shifts.end(), time.shifts.begin(), time.shifts.end());
  widen(m.current, shifts, 1.0);
  if (m.chosen.empty()) {
    d.verdict = Verdict::clean;
    d.reason = "the base model explains the data";
    if (noise_is_of_pulses(d.lack_of_fit)) d.reason += "; the accelerometers' pulses hide whether their noise is white";
    return;
  }
  if (const std::string name = lost_in_its_class(m.current.effects); !name.empty()) {
    d.trusted = false;
    d.reason = name + " is no larger than what its alias class leaves open";
    d.unexplained_pattern = looks_like(m, d.base);
    leave_unexplained(m, d);
    return;
  }
  d.verdict = Verdict::extended;
  std::snprintf(text, sizeof text, "held-out error %.4f before, %.4f after", d.holdout_before.normalised_rms,
                d.holdout_after.normalised_rms);
  d.reason = text;
  for (const OpenTime& time : times) {
    std::snprintf(text, sizeof text, "; %s with %s = %.4g, %.4g to %.4g", time.name.c_str(),
                  std::string(find_effect(time.name)->variant).c_str(), time.tau_s,
                  time.tau_s * std::exp(-time.log_sigma), time.tau_s * std::exp(time.log_sigma));
    d.reason += text;
  }
}

void collect_residuals(const DiagnosisModel& m, Diagnosis& d) {
  FilterSetup setup = m.current.setup;
  setup.with_columns = false;
  setup.keep_innovations = true;
  const auto run = [&](const JointResult& r) {
    return run_filter(m.recording, r.parameters, effect_model_of(r, m.recording.info.latitude_deg), setup);
  };
  const FilterResult before = run(d.base);
  const FilterResult after = m.chosen.empty() ? before : run(m.current);
  const auto rms = [](const FilterResult& r) {
    return std::sqrt(r.chi_square / static_cast<double>(std::max<std::int64_t>(r.observations, 1)));
  };
  d.error_before = rms(before);
  d.error_after = rms(after);
  const SensorModel model = sensor_model(m.current.parameters, m.recording.info);
  double rotation_end = -1e9;
  std::size_t next = 0;
  for (std::size_t i = 0; i < before.innovations.size() && i < after.innovations.size(); ++i) {
    const Innovation& b = before.innovations[i];
    const Innovation& a = after.innovations[i];
    for (; next < b.block; ++next)
      if (m.recording.segments[m.recording.blocks[next].segment].kind == SegmentKind::rotate)
        rotation_end =
            static_cast<double>(m.recording.blocks[next].start_sample - m.recording.blocks.front().start_sample) *
                m.recording.info.sample_period_s +
            m.recording.blocks[next].duration_s;
    const Block& block = m.recording.blocks[b.block];
    d.residuals.push_back({b.block, block.segment, b.time_s, b.normalised, a.normalised, b.free_velocity_mps,
                           a.free_velocity_mps,
                           model.accel_scale * block.accel / block.duration_s - model.accel_bias_mps2,
                           block.temperature_c, b.time_s - rotation_end});
  }
}

// No effect is looked for where they are of two units: what `turncal calibrate` writes of them is handed out.
void say_contradiction(const SeveralRecordings& apart, Diagnosis& d) {
  d.verdict = Verdict::unexplained;
  LackOfFit fit;
  add_test({.family = "recordings, parameters",
            .what = "parameters of the recordings against each other",
            .chi_square = apart.disagreement,
            .degrees = static_cast<double>(apart.degrees),
            .shift = {}},
           fit);
  d.lack_of_fit.worst = fit.tests.front();
  d.unexplained_pattern = d.lack_of_fit.worst.what;
  char text[120];
  std::snprintf(text, sizeof text, "the recordings contradict each other: chi-square %.1f of %d", apart.disagreement,
                apart.degrees);
  d.reason = text;
  d.base = d.extended = apart.unit;
  d.fitted_covariance = apart.unit.covariance;
  d.each.turn_ons = apart.turn_ons;
}

std::vector<std::string> strongest_first(const JointResult& fit) {
  std::vector<EstimatedEffect> effects = fit.effects;
  std::erase_if(effects, [](const EstimatedEffect& e) { return is_turn_on(e.column); });
  std::sort(effects.begin(), effects.end(), [](const EstimatedEffect& a, const EstimatedEffect& b) {
    return std::abs(a.value) * b.sigma > std::abs(b.value) * a.sigma;
  });
  std::vector<EffectColumn> columns;
  for (const EstimatedEffect& e : effects) columns.push_back(e.column);
  return names_of(columns);
}

}  // namespace

const char* to_string(Verdict verdict) {
  switch (verdict) {
    case Verdict::clean: return "clean";
    case Verdict::extended: return "extended";
    case Verdict::unexplained: return "unexplained";
    case Verdict::noise_model: return "noise_model";
    case Verdict::not_tested: return "not_tested";
  }
  return "?";
}

Diagnosis diagnose(const CompressedRecording& recording, const DiagnosisOptions& options) {
  return diagnose(join_recordings({&recording}), options);
}

Diagnosis diagnose(const JoinedRecordings& recordings, const DiagnosisOptions& options) {
  DiagnosisModel m(recordings, options);
  Diagnosis d;
  d.base = options.base ? *options.base : joint_estimate(m.recording, m.estimate_options({}, nullptr));
  m.current = d.base;
  const bool nothing = std::none_of(d.base.determined.begin(), d.base.determined.end(), [](bool b) { return b; });
  if (!d.base.converged || nothing) {
    d.verdict = Verdict::not_tested;
    d.reason = nothing && d.base.converged ? "the recording determines none of the parameters"
                                           : "the base model could not be fitted: " + d.base.message;
    d.extended = d.base;
    return d;
  }
  for (const CompressedRecording* holdout : options.holdouts) {
    if (const std::string wrong = wrong_table_units(*holdout); !wrong.empty()) {
      d.verdict = Verdict::not_tested;
      d.reason = "the holdout: " + wrong;
      d.extended = d.base;
      return d;
    }
  }
  for (const CompressedRecording* holdout : options.holdouts)
    d.holdout_own_noise = std::max(d.holdout_own_noise, own_noise_of(*holdout, d.base).maxCoeff());
  d.verdict = Verdict::clean;
  const std::optional<SeveralRecordings> apart = contradiction(recordings, d.base);
  if (!apart) select_effects(m, d);
  find_time_constants(m);
  // Of data that fit nothing even the start may not be found again: then the trial that chose them stands.
  if (!m.chosen.empty())
    if (JointResult again = joint_estimate(m.recording, m.estimate_options(m.chosen, &m.current)); again.converged)
      m.current = std::move(again);
  gate_effects(m, d);
  check_names(m, d);
  judge(m, d);
  collect_residuals(m, d);
  d.effect_names = strongest_first(m.current);
  // A latitude that is far off goes into the noise, and the gyros' biases stay open; or it is a rate of the earth that is another.
  const bool of_latitude =
      (!d.trusted && !d.base.undetermined.empty()) ||
      std::find(d.effect_names.begin(), d.effect_names.end(), "earth_rate") != d.effect_names.end();
  if (of_latitude && recordings.parts.size() == 1)
    if (const std::string wrong = wrong_latitude(m.recording, d.base); !wrong.empty())
      d.reason = wrong + "; " + d.reason;
  d.extended = m.current;
  if (apart) {
    say_contradiction(*apart, d);
  } else if (recordings.parts.size() > 1) {
    leave_what_is_common(d.base, recordings.parts.size());
    d.each = leave_what_is_common(d.extended, recordings.parts.size(), &d.fitted_covariance);
  }
  return d;
}

}  // namespace turncal
