#include "calib/evidence/diagnosis.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "calib/evidence/evidence.h"
#include "calib/evidence/felt_latitude.h"
#include "calib/evidence/holdout.h"
#include "calib/statistics/unit_slip.h"

namespace turncal {
namespace {

// Are all free parameters determined?
bool whole(const JointResult& fit) {
  return std::ranges::all_of(free_parameters(), [&fit](int k) { return fit.determined[k]; });
}

bool noise_is_of_pulses(const Omnibus& omnibus) {
  return omnibus.innovation_correlation < 0.0 && omnibus.beating_part > 0.5;
}

// Log prior of the velocity steps that a fit has cut out: a knock at one turn in so many, of any size up to its own, in three directions.
constexpr double turns_without_knock = 500.0;
double of_knocks(const JointResult& fit) {
  double sum = 0.0;
  for (const Fault& fault : fit.faults)
    if (fault.step_mps > 0.0) sum -= std::log(turns_without_knock) + 3.0 * (std::log(fault.step_mps) + 0.5);
  return sum;
}
std::ptrdiff_t knocks_of(const JointResult& fit) {
  return std::ranges::count_if(fit.faults, [](const Fault& fault) { return fault.step_mps > 0.0; });
}

// Returns how the innovations contradict the noise model; empty: they are nearly white, or those of pulses and no larger than pulses make.
std::string misfit_of_noise(const JointResult& fit, const Omnibus& omnibus) {
  const Whiteness& whiteness = fit.whiteness;
  const bool of_pulses = noise_is_of_pulses(omnibus);
  if (omnibus.innovation_correlation < 0.0 && !of_pulses) return whiteness.white ? "" : whiteness.message;
  if (omnibus.innovation_correlation >= noise_limits.correlation)
    return "innovations are correlated in time: the noise model does not fit";
  const double high = omnibus.innovation_level < 0.0 ? whiteness.level : omnibus.innovation_level;
  if (whiteness.level <= noise_limits.lowest_level ||
      high >= (of_pulses ? noise_limits.highest_of_pulses : noise_limits.highest_level))
    return "innovations are larger or smaller than the noise model says";
  return "";
}

std::vector<std::string> strongest_first(const JointResult& fit) {
  std::vector<EstimatedEffect> effects = fit.effects;
  std::erase_if(effects, [](const EstimatedEffect& e) { return is_turn_on(e.column); });
  std::ranges::sort(effects, [](const EstimatedEffect& a, const EstimatedEffect& b) {
    return std::abs(a.value) * b.sigma > std::abs(b.value) * a.sigma;
  });
  std::vector<std::string> names;
  for (const EstimatedEffect& e : effects)
    if (std::ranges::find(names, e.column.entry->name) == names.end()) names.emplace_back(e.column.entry->name);
  return names;
}

void collect_residuals(const CompressedRecording& recording, Diagnosis& d) {
  FilterSetup setup = d.extended.setup;
  setup.with_columns = false;
  setup.keep_innovations = true;
  const auto run = [&](const JointResult& r) {
    return run_filter(recording, r.parameters, effect_model_of(r, recording.info.latitude_deg), setup);
  };
  const FilterResult before = run(d.base);
  const FilterResult after = d.effect_names.empty() ? before : run(d.extended);
  const auto rms = [](const FilterResult& r) {
    return std::sqrt(r.chi_square / double(std::max<std::int64_t>(r.observations, 1)));
  };
  d.error_before = rms(before);
  d.error_after = rms(after);
  const SensorModel model = sensor_model(d.extended.parameters, recording.info);
  double rotation_end = -1e9;
  std::size_t next = 0;
  for (std::size_t i = 0; i < before.innovations.size() && i < after.innovations.size(); ++i) {
    const Innovation& b = before.innovations[i];
    const Innovation& a = after.innovations[i];
    for (; next < b.block; ++next)
      if (recording.segments[recording.blocks[next].segment].kind == SegmentKind::rotate)
        rotation_end = recording.middle_s(recording.blocks[next]) + 0.5 * recording.blocks[next].duration_s;
    const Block& block = recording.blocks[b.block];
    d.residuals.push_back({b.block, block.segment, b.time_s, b.normalised, a.normalised, b.free_velocity_mps,
                           a.free_velocity_mps,
                           model.accel_scale * block.accel / block.duration_s - model.accel_bias_mps2,
                           block.temperature_c, b.time_s - rotation_end});
  }
}

// Recordings that contradict each other are not searched for effects: the result is what `turncal calibrate` writes for them.
void say_contradiction(const SeveralRecordings& apart, Diagnosis& d) {
  d.base = apart.unit;
  withdraw(
      fmt::format("the recordings contradict each other: chi-square {:.1f} of {}", apart.disagreement, apart.degrees),
      d);
  d.unexplained_pattern = "parameters of the recordings against each other";
  d.effect_names.clear();
  d.fitted_covariance = apart.unit.covariance;
  d.each.turn_ons = apart.turn_ons;
}

}  // namespace

std::vector<EffectColumn> named_columns(const Evidence& e) {
  // A formula that is said is fitted even if something else seems to be missing: without it the fitted noise is wrong.
  const bool said = std::ranges::any_of(
      e.statements.nodes, [](const auto& node) { return !node.formula.empty() && node.probability >= said_from; });
  if (e.statements.anything < said_from || !(said || e.named.probability >= carried_by_names)) return {};
  return e.named.columns;
}

void withdraw(const std::string& reason, Diagnosis& d) {
  d.verdict = Verdict::unexplained;
  d.unexplained_pattern = words_of(d.statements);
  d.why_not_trusted = d.reason = reason;
  d.extended = d.base;
  d.holdout_after = d.holdout_before;
}

void judge_by(const Statements& s, bool by_name, Diagnosis& d) {
  d.statements = s;
  d.reason = reason_of(s);
  d.verdict = s.anything < said_from ? Verdict::clean : by_name ? Verdict::extended : Verdict::unexplained;
  if (d.verdict == Verdict::unexplained) d.unexplained_pattern = words_of(s);
}

void list_candidates(const Evidence& e, double duration_s, Diagnosis& d) {
  static const UnderNoise none = {nullptr, std::make_shared<TermTable>(), {}};
  const UnderNoise& under = e.at_each_noise.empty() ? none : e.at_each_noise.front();
  const TermTable& table = *under.table;
  for (std::size_t k = 0; k < table.effects.size(); ++k) {
    const EffectColumn& column = table.effects[k];
    const PieceSystem::Block& block = under.blocks[table.basis_of_effect[k]];
    const int at = table.column_of_effect[k];
    CandidateScore c = {.column = column, .visible = false};
    if (is_seen(under, k)) {
      const double Q = block.Q(at, at);
      c.value = block.s[at] / Q;
      c.sigma = 1.0 / std::sqrt(Q);
      c.z = c.value / c.sigma;
      c.detectable = SelectionLimits{}.caught_at * c.sigma;
      c.visible = c.detectable <= absurd_magnitude(*column.entry, duration_s);
    }
    // The best of the variants with different time constants stands for the component.
    const auto known =
        std::ranges::find_if(d.candidates, [&](const CandidateScore& o) { return o.column.key() == column.key(); });
    if (known == d.candidates.end())
      d.candidates.push_back(c);
    else if (c.visible && (!known->visible || std::abs(c.z) > std::abs(known->z)))
      *known = c;
  }
  for (const EffectEntry& entry : effect_catalogue())
    if (std::ranges::none_of(d.candidates,
                             [&](const CandidateScore& c) { return c.column.entry == &entry && c.visible; }))
      d.undetectable.emplace_back(entry.name);
}

void list_names(const Evidence& e, Diagnosis& d) {
  d.effect_names = strongest_first(d.extended);
  for (const std::string& name : d.effect_names) {
    std::vector<std::string>& others = d.aliases[name];
    const auto instead = e.named.instead.find(name);
    if (instead == e.named.instead.end()) continue;
    std::string by;
    for (const auto& [other, probability] : instead->second) {
      if (probability < listed_from) continue;
      others.push_back(other);
      by += (by.empty() ? "" : "; ") + std::string(find_effect(other)->seen_by);
    }
    if (!by.empty()) d.separate_by[name] = by;
  }
}

namespace {

class Diagnosing {
 public:
  Diagnosing(const JoinedRecordings& recordings, const DiagnosisOptions& options)
      : recordings_(recordings), recording_(recordings.data), options_(options) {}

  Diagnosis run() {
    d_.base = options_.base ? *options_.base : joint_estimate(recording_, estimate_options({}, nullptr));
    d_.extended = d_.base;
    if (not_to_be_judged()) return std::move(d_);
    for (const CompressedRecording* holdout : options_.holdouts)
      d_.holdout_own_noise = std::max(d_.holdout_own_noise, own_noise_of(*holdout, d_.base).maxCoeff());
    Evidence evidence = weigh(d_.base);
    if (knocks_of(d_.base) > 1) weigh_without_knocks(evidence);
    JointResult fit = d_.base;
    list_candidates(evidence, 3600.0, d_);
    const bool by_name = !fit_by_names(evidence, named_columns, [&](const auto& more) {
                            JointResult again = fit_with(more, d_.base);
                            if (!again.converged || (whole(d_.base) && !whole(again))) return false;
                            fit = std::move(again);
                            evidence = {};  // only one in memory at a time
                            evidence = weigh(fit);
                            return true;
                          }).empty();
    const std::optional<SeveralRecordings> apart = contradiction(recordings_, d_.base);
    judge(evidence, fit, by_name);
    ask_held_out_data(fit);
    list_names(evidence, d_);
    collect_residuals(recording_, d_);
    look_at_latitude();
    if (apart) {
      say_contradiction(*apart, d_);
    } else if (recordings_.parts.size() > 1) {
      leave_what_is_common(d_.base, recordings_.parts.size());
      d_.each = leave_what_is_common(d_.extended, recordings_.parts.size(), &d_.fitted_covariance);
    }
    return std::move(d_);
  }

 private:
  bool not_to_be_judged() {
    const bool nothing = std::ranges::none_of(d_.base.determined, std::identity{});
    std::string wrong;
    for (const CompressedRecording* holdout : options_.holdouts)
      if (wrong.empty()) wrong = wrong_table_units(*holdout);
    if (!d_.base.converged || nothing)
      d_.reason = nothing && d_.base.converged ? "the recording determines none of the parameters"
                                               : "the base model could not be fitted: " + d_.base.message;
    else if (!wrong.empty())
      d_.reason = "the holdout: " + wrong;
    else
      return false;
    d_.why_not_trusted = d_.reason;
    d_.verdict = Verdict::not_tested;
    return true;
  }

  // Steps at several turns may come from an effect that shows there alone, so the evidence is also weighed with the steps left in.
  void weigh_without_knocks(Evidence& evidence) {
    JointOptions o = estimate_options({}, nullptr);
    o.look_for_faults = false;
    JointResult left_in = joint_estimate(recording_, o);
    if (!left_in.converged) return;
    Evidence other = weigh(left_in);
    double log_evidence = other.posterior.log_evidence;
    if (const std::vector<EffectColumn> named = named_columns(other); !named.empty()) {
      const JointResult by_name = fit_with(named, left_in);  // with the noise that the effects leave
      if (!by_name.converged) return;
      log_evidence = weigh(by_name).posterior.log_evidence;
    }
    if (!(log_evidence > evidence.posterior.log_evidence + of_knocks(d_.base))) return;
    d_.base = d_.extended = std::move(left_in);
    evidence = std::move(other);
  }

  Evidence weigh(const JointResult& fit) const {
    return weigh_evidence(recording_, fit, int(recordings_.parts.size()), options_.holdouts);
  }

  // Returns options for a fit of `effects` beside the turn-on columns, whose values start where `from` has them.
  JointOptions estimate_options(const std::vector<EffectColumn>& effects, const JointResult* from) const {
    JointOptions o = options_.estimate;
    o.effects = recordings_.turn_ons;
    o.effects.insert(o.effects.end(), effects.begin(), effects.end());
    o.begins = recordings_.begins;
    o.candidates.clear();
    if (from == nullptr) return o;
    o.start = from->parameters;
    o.start_noise = from->noise;
    o.start_effects.setZero(Eigen::Index(o.effects.size()));
    for (std::size_t k = 0; k < recordings_.turn_ons.size(); ++k)
      o.start_effects[Eigen::Index(k)] = from->effects[k].value;
    return o;
  }
  JointResult fit_with(const std::vector<EffectColumn>& effects, const JointResult& from) const {
    JointOptions o = estimate_options(effects, &from);
    o.faults_of = &from;
    return joint_estimate(recording_, o);
  }

  void judge(const Evidence& e, const JointResult& fit, bool by_name) {
    d_.statements = e.statements;
    d_.omnibus = e.omnibus;
    test_innovations(recording_, fit, d_.omnibus);
    const std::string misfit = misfit_of_noise(fit, d_.omnibus);
    // A missing effect inflates and correlates the fitted noise; then the effect is reported and not the noise.
    if (!misfit.empty() && (options_.estimate.noise || e.statements.anything < said_from)) {
      d_.verdict = Verdict::noise_model;
      d_.why_not_trusted = d_.reason =
          misfit + (options_.estimate.noise ? " (the noise was given, not measured)" : "") + ": no claim on effects";
      d_.statements.nodes.clear();
      return;
    }
    judge_by(e.statements, by_name && misfit.empty(), d_);
    if (!misfit.empty()) d_.reason += "; " + misfit;
    if (noise_is_of_pulses(d_.omnibus)) d_.reason += "; the accelerometers' pulses hide whether their noise is white";
    if (!d_.omnibus.passed()) {
      d_.verdict = Verdict::unexplained;
      d_.reason = reason_of(d_.omnibus);
      d_.unexplained_pattern = d_.omnibus.worst()->what;
      d_.statements.nodes.clear();  // probabilities cover the known terms, and something else is missing
    }
    d_.why_not_trusted = d_.verdict == Verdict::unexplained ? d_.reason : "";
    d_.extended = by_name ? fit : d_.base;
    d_.fitted_covariance = d_.extended.covariance;
    hand_out(e, by_name, fit);
    if (whole(d_.extended)) return;
    d_.distrust("the recording does not determine all of the parameters");
    if (d_.verdict != Verdict::clean) return;
    d_.verdict = Verdict::not_tested;
    d_.reason = d_.why_not_trusted;
  }

  // Replaces the values of the extended model by the averages about `fit`, unless a direction is undetermined.
  void hand_out(const Evidence& e, bool by_name, const JointResult& fit) {
    if (e.at_each_noise.empty()) return;
    const AveragedEstimate average =
        average_over_models(e.at_each_noise, e.posterior, by_name ? e.named.columns : std::vector<EffectColumn>{});
    JointResult& r = d_.extended;
    const ParameterVector about = to_vector(fit.parameters);
    ParameterVector values = to_vector(r.parameters);
    if (r.free.size() != std::size_t(average.shift.size()) || !r.undetermined.empty()) return;
    std::vector<Eigen::Index> place;  // place of each r.free in the average
    const auto p = Eigen::Index(e.columns.size());
    for (const int column : r.free) {
      place.push_back(std::ranges::find(e.columns, column) - e.columns.begin());
      if (place.back() < p) continue;
      const std::string key = r.effects[std::size_t(column - parameter_count)].column.key();
      place.back() += std::ranges::find(e.named.columns, key, &EffectColumn::key) - e.named.columns.begin();
      if (place.back() == average.shift.size()) return;
    }
    r.covariance = Eigen::MatrixXd(average.covariance(place, place)) + r.unseen_instability;
    d_.distrust(hangs_on_a_name(average, e.columns));
    for (std::size_t i = 0; i < r.free.size(); ++i) {
      const int column = r.free[i];
      const auto k = Eigen::Index(i);
      const double sigma = std::sqrt(r.covariance(k, k)), shift = average.shift[place[i]];
      if (column < parameter_count) {
        values[column] = about[column] + shift;
        if (r.sigma[column] > 0.0) r.sigma[column] = sigma;
        continue;
      }
      EstimatedEffect& effect = r.effects[std::size_t(column - parameter_count)];
      effect.value = place[i] < p ? effect.value + shift : shift;
      effect.sigma = sigma;
      if (place[i] >= p) effect.column.tau_s = e.named.columns[std::size_t(place[i] - p)].tau_s;
    }
    r.parameters = from_vector(values);
    if (!by_name || recordings_.parts.size() > 1) return;
    for (Eigen::Index i = 0; i < p; ++i) {
      const int column = e.columns[std::size_t(i)];
      if (column < parameter_count && std::abs(average.taken_up[i]) > r.sigma[column] && r.sigma[column] > 0.0)
        d_.without_effects[column] = values[column] + average.taken_up[i];
    }
  }

  HoldoutGate gate() const {
    if (!options_.holdouts.empty()) return HoldoutGate::holdouts(options_.holdouts);
    const auto refit = [this](const JointResult& from, const std::vector<char>& unobserved) {
      std::vector<EffectColumn> columns;
      for (const EstimatedEffect& effect : from.effects)
        if (!is_turn_on(effect.column)) columns.push_back(effect.column);
      JointOptions o = estimate_options(columns, &from);
      o.unobserved = unobserved;
      o.noise = d_.extended.noise;
      o.faults_of = &from;
      // A quarter of the dwells moves no parameter by more than a few sigma: the problem is linear there.
      o.one_step = true;
      return joint_estimate(recording_, o);
    };
    return recordings_.parts.size() > 1 ? HoldoutGate::recordings_in_turn(recordings_, refit)
                                        : HoldoutGate::dwells_in_turn(recording_, refit);
  }

  void ask_held_out_data(const JointResult& fit) {
    const HoldoutGate held_out = gate();
    d_.holdout_source = held_out.source();
    const bool extended = d_.verdict == Verdict::extended;
    const NoiseModel& noise = extended ? fit.noise : d_.base.noise;
    d_.holdout_before = held_out.error(d_.base, noise);
    d_.holdout_after = extended ? held_out.error(fit, noise) : d_.holdout_before;
    if (options_.holdouts.empty()) return;
    const auto too_large = [&](const CompressedRecording* holdout) {
      return error_beyond_sigmas(*holdout, d_.extended, noise) > GateLimits{}.highest_error;
    };
    if (!d_.trusted() || std::ranges::none_of(options_.holdouts, too_large)) return;
    withdraw("the error on held-out data is larger than noise and the sigmas explain", d_);
  }

  // A stated latitude that is far off inflates the noise and leaves the gyro biases open, or it shows as the effect earth_rate.
  void look_at_latitude() {
    const bool of_latitude = (!d_.trusted() && !d_.base.undetermined.empty()) ||
                             std::ranges::find(d_.effect_names, "earth_rate") != d_.effect_names.end();
    if (!of_latitude || recordings_.parts.size() != 1) return;
    if (d_.latitude = wrong_latitude(recording_, d_.base); d_.latitude.empty()) return;
    d_.reason = d_.latitude + "; " + d_.reason;
    if (!d_.trusted()) d_.why_not_trusted = d_.latitude + "; " + d_.why_not_trusted;
  }

  const JoinedRecordings& recordings_;
  const CompressedRecording& recording_;
  const DiagnosisOptions& options_;
  Diagnosis d_;
};

}  // namespace

const char* to_string(Verdict verdict) {
  constexpr std::array words = {"clean", "extended", "unexplained", "noise_model", "not_tested"};
  return words[std::size_t(verdict)];
}

std::string words_of(const Doubt& doubt) {
  return fmt::format("{} or {}", doubt.name, fmt::join(doubt.others, " or "));
}

std::optional<Doubt> doubt_of(const Diagnosis& d) {
  if (d.verdict == Verdict::extended)
    for (const std::string& name : d.effect_names)
      if (const auto others = d.aliases.find(name); others != d.aliases.end() && !others->second.empty())
        return Doubt{name, others->second};
  if (d.verdict != Verdict::unexplained) return std::nullopt;
  for (const Statement& said : d.statements.said()) {
    if (!said.formula.empty()) continue;
    std::vector<Statement> formulas;
    for (const Statement& node : d.statements.nodes)
      if (!node.formula.empty() && is_below(said, node)) formulas.push_back(node);
    std::ranges::stable_sort(formulas, std::greater{}, &Statement::probability);
    if (formulas.size() < 2) continue;
    Doubt doubt{formulas.front().formula, {}};
    for (std::size_t k = 1; k < formulas.size(); ++k) doubt.others.push_back(formulas[k].formula);
    return doubt;
  }
  return std::nullopt;
}

Diagnosis diagnose(const CompressedRecording& recording, const DiagnosisOptions& options) {
  return diagnose(join_recordings({&recording}), options);
}

Diagnosis diagnose(const JoinedRecordings& recordings, const DiagnosisOptions& options) {
  return Diagnosing(recordings, options).run();
}

}  // namespace turncal
