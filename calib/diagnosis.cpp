#include "calib/diagnosis.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "calib/holdout.h"
#include "calib/score_algebra.h"
#include "calib/unexplained.h"

namespace turncal {
namespace {

// What a nominee has to be better by than one with fewer assumptions, and what counts as "as good" (effects.md).
constexpr double bic_margin = 10.0;
constexpr double alias_correlation = 0.97;
constexpr std::size_t most_rivals = 3;
constexpr double slow_correlation_s = 2400.0;
constexpr double surely = 150.0;     // 2 ln L beyond which no choice of noise matters
constexpr double hiding_gain = 8.0;  // 2 ln L that bias instability must bring before an effect can be hiding in it

double minus_two_log_likelihood(const JointResult& r) { return r.last.chi_square + r.last.log_determinant; }

// A free time constant is one more parameter: ln n of BIC.
double penalty(const EffectColumn& column, std::int64_t observations) {
  return column.entry->taus_s.empty() ? 0.0 : std::log(static_cast<double>(observations));
}

struct Nominee {
  int candidate = -1;      // index into the candidate columns
  double z_square = 0.0;   // after the penalty
};

class Diagnoser {
 public:
  Diagnoser(const CompressedRecording& recording, const DiagnosisOptions& options)
      : recording_(recording), options_(options), catalogue_(catalogue_columns(recording.info)), columns_(catalogue_) {
    const std::vector<EffectColumn> patterns = pattern_columns(recording);
    columns_.insert(columns_.end(), patterns.begin(), patterns.end());
    threshold_ = chi_square_1_limit(options.false_alarm / static_cast<double>(columns_.size()));
  }
  Diagnosis run();

 private:
  JointOptions estimate_options(const std::vector<EffectColumn>& effects, const JointResult* from) const;
  JointResult fit(const std::vector<EffectColumn>& effects, const JointResult& from, const NoiseModel* noise = nullptr) const;
  double misfit_beside_slow_noise(const std::vector<EffectColumn>& model, const JointResult& from) const;
  FilterResult pass(const JointResult& at, const std::vector<EffectColumn>& candidates, bool without_bias_instability) const;
  EffectColumn refine(const EffectColumn& pattern, bool without_bias_instability) const;
  Scores scores(const FilterResult& information, int effects, int candidates) const;
  Nominee best(const Scores& s, bool patterns, std::int64_t n) const;
  std::vector<Nominee> rivals_of(const Nominee& top, const Scores& s, std::int64_t n) const;
  void list_candidates(const Scores& s);
  bool stage();
  void name_aliases(const Scores& s, const EffectColumn& chosen, double z_square, SelectionStage& stage);
  void stop_unexplained(const EffectColumn& pattern, const JointResult& with_pattern);
  bool take_rival(const std::string& name, const std::vector<EffectColumn>& without, double error_without,
                  const HoldoutGate& check);
  void gate();
  void judge();
  void collect_residuals();

  const CompressedRecording& recording_;
  const DiagnosisOptions& options_;
  const std::vector<EffectColumn> catalogue_;
  std::vector<EffectColumn> columns_;   // catalogue, then patterns
  double threshold_ = 0.0;
  std::vector<EffectColumn> chosen_;
  JointResult current_;
  Diagnosis d_;
};

JointOptions Diagnoser::estimate_options(const std::vector<EffectColumn>& effects, const JointResult* from) const {
  JointOptions o = options_.estimate;
  o.effects = effects;
  o.candidates.clear();
  if (from) {
    o.start = from->parameters;
    o.start_noise = from->noise;
  }
  return o;
}

// A trial beside a finished fit: its faults are known, and its noise is a good start; or `noise` is taken for its own.
JointResult Diagnoser::fit(const std::vector<EffectColumn>& effects, const JointResult& from, const NoiseModel* noise) const {
  JointOptions o = estimate_options(effects, &from);
  o.faults_of = &from;
  if (noise) o.noise = *noise;
  return joint_estimate(recording_, o);
}

// -2 log L when the bias instability is as slow as a third of a run. Flicker noise wanders on every time scale, and what
// a process of ten minutes cannot follow must not be taken for a drift: what an effect gains must hold here too.
double Diagnoser::misfit_beside_slow_noise(const std::vector<EffectColumn>& model, const JointResult& from) const {
  JointOptions o = estimate_options(model, &from);
  o.faults_of = &from;
  o.start_noise = current_.noise;
  o.start_noise->bias_correlation_s = slow_correlation_s;
  return minus_two_log_likelihood(joint_estimate(recording_, o));
}

// One filter pass at a fitted model with all candidates behind its effects.
FilterResult Diagnoser::pass(const JointResult& at, const std::vector<EffectColumn>& candidates,
                             bool without_bias_instability) const {
  std::vector<EffectColumn> all;
  for (const EstimatedEffect& e : at.effects) all.push_back(e.column);
  all.insert(all.end(), candidates.begin(), candidates.end());
  EffectModel model = make_effect_model(all, {recording_.info.latitude_deg}, at.reference_temperature_c);
  for (std::size_t k = 0; k < at.effects.size(); ++k) model.values[static_cast<Eigen::Index>(k)] = at.effects[k].value;
  FilterSetup setup = at.setup;
  if (without_bias_instability)
    setup.noise.gyro_bias_instability_radps = setup.noise.accel_bias_instability_mps2 = 0.0;
  setup.narrow_columns = static_cast<int>(std::count_if(candidates.begin(), candidates.end(), is_pattern));
  setup.narrow_against = parameter_count + static_cast<int>(at.effects.size());
  return run_filter(recording_, at.parameters, model, setup);
}

Scores Diagnoser::scores(const FilterResult& information, int effects, int count) const {
  std::vector<int> base;
  for (int k = 0; k < parameter_count; ++k)
    if (parameter_is_free[static_cast<std::size_t>(k)]) base.push_back(k);
  for (int k = 0; k < effects; ++k) base.push_back(parameter_count + k);
  std::vector<int> candidates;
  for (int k = 0; k < count; ++k) candidates.push_back(parameter_count + effects + k);
  return eliminate(information.information, information.gradient, base, candidates);
}

// A column of which the model already imitates all but a billionth says nothing.
bool visible(const Scores& s, int k) { return s.kept[k] > 1e-9 && s.Q(k, k) > 0.0; }

Nominee Diagnoser::best(const Scores& s, bool patterns, std::int64_t n) const {
  Nominee top;
  for (int k = 0; k < static_cast<int>(columns_.size()); ++k) {
    const EffectColumn& column = columns_[static_cast<std::size_t>(k)];
    if (is_pattern(column) != patterns || !visible(s, k)) continue;
    const bool taken = std::any_of(chosen_.begin(), chosen_.end(), [&](const EffectColumn& c) { return c.key() == column.key(); });
    if (taken && !patterns) continue;
    const double z_square = s.s[k] * s.s[k] / s.Q(k, k) - penalty(column, n);
    if (z_square > top.z_square) top = {k, z_square};
  }
  return top;
}

// The best component of each other effect that comes within 10 of the best: the likelihood decides between them.
std::vector<Nominee> Diagnoser::rivals_of(const Nominee& top, const Scores& s, std::int64_t n) const {
  std::vector<Nominee> rivals;
  const EffectEntry* winner = columns_[static_cast<std::size_t>(top.candidate)].entry;
  for (const EffectEntry& entry : effect_catalogue()) {
    Nominee rival;
    for (int k = 0; k < static_cast<int>(catalogue_.size()) && &entry != winner; ++k) {
      const EffectColumn& column = catalogue_[static_cast<std::size_t>(k)];
      if (column.entry != &entry || !visible(s, k)) continue;
      const double z_square = s.s[k] * s.s[k] / s.Q(k, k) - penalty(column, n);
      if (z_square > rival.z_square) rival = {k, z_square};
    }
    if (rival.candidate >= 0 && rival.z_square > top.z_square - bic_margin) rivals.push_back(rival);
  }
  std::sort(rivals.begin(), rivals.end(), [](const Nominee& a, const Nominee& b) { return a.z_square > b.z_square; });
  if (rivals.size() > most_rivals) rivals.resize(most_rivals);
  return rivals;
}

void Diagnoser::list_candidates(const Scores& s) {
  for (int k = 0; k < static_cast<int>(catalogue_.size()); ++k) {
    CandidateScore c;
    c.column = catalogue_[static_cast<std::size_t>(k)];
    c.visible = visible(s, k);
    if (c.visible) {
      c.value = s.s[k] / s.Q(k, k);
      c.sigma = 1.0 / std::sqrt(s.Q(k, k));
      c.z = c.value / c.sigma;
      c.detectable = 5.0 * c.sigma;
      if (c.detectable > absurd_magnitude(*c.column.entry)) c.visible = false;
    }
    // Of variants with different time constants the best one stands for the component.
    const auto same = std::find_if(d_.candidates.begin(), d_.candidates.end(),
                                   [&](const CandidateScore& o) { return o.column.key() == c.column.key(); });
    if (same == d_.candidates.end()) d_.candidates.push_back(c);
    else if (c.visible && (!same->visible || std::abs(c.z) > std::abs(same->z))) *same = c;
  }
  for (const EffectEntry& entry : effect_catalogue()) {
    const bool any = std::any_of(d_.candidates.begin(), d_.candidates.end(),
                                 [&](const CandidateScore& c) { return c.column.entry == &entry && c.visible; });
    if (!any) d_.undetectable.emplace_back(entry.name);
    std::vector<double> taus = entry.taus_s.empty() ? std::vector<double>{0.0} : entry.taus_s;
    GroupScore group;
    group.name = entry.name;
    for (const double tau : taus) {
      std::vector<int> members;
      for (int k = 0; k < static_cast<int>(catalogue_.size()); ++k)
        if (catalogue_[static_cast<std::size_t>(k)].entry == &entry && catalogue_[static_cast<std::size_t>(k)].tau_s == tau &&
            visible(s, k))
          members.push_back(k);
      if (members.empty()) continue;
      const GroupTest test = group_test(s, members);
      if (test.chi_square >= group.chi_square)
        group = {group.name, test.chi_square, test.rank, static_cast<int>(members.size()),
                 chi_square_tail(test.chi_square, test.rank)};
    }
    if (any) d_.groups.push_back(group);
  }
}

// Effects that would have done as well, or that can imitate what was chosen.
void Diagnoser::name_aliases(const Scores& s, const EffectColumn& chosen, double chosen_z_square, SelectionStage& stage) {
  int chosen_index = 0;
  for (int k = 0; k < static_cast<int>(catalogue_.size()); ++k)
    if (catalogue_[static_cast<std::size_t>(k)].key() == chosen.key() && catalogue_[static_cast<std::size_t>(k)].tau_s == chosen.tau_s)
      chosen_index = k;
  std::vector<std::string>& names = d_.aliases[std::string(chosen.entry->name)];
  for (const EffectEntry& entry : effect_catalogue()) {
    if (&entry == chosen.entry) continue;
    double rival = 0.0;
    EffectColumn rival_column;
    bool imitates = false;
    const std::vector<double> taus = entry.taus_s.empty() ? std::vector<double>{0.0} : entry.taus_s;
    for (const double tau : taus) {
      std::vector<int> members;
      for (int k = 0; k < static_cast<int>(catalogue_.size()); ++k)
        if (catalogue_[static_cast<std::size_t>(k)].entry == &entry && catalogue_[static_cast<std::size_t>(k)].tau_s == tau &&
            visible(s, k)) {
          members.push_back(k);
          const double z_square = s.s[k] * s.s[k] / s.Q(k, k);
          if (z_square > rival) {
            rival = z_square;
            rival_column = catalogue_[static_cast<std::size_t>(k)];
          }
        }
      if (!members.empty() && multiple_correlation(s, chosen_index, members) > alias_correlation) imitates = true;
    }
    if (rival > chosen_z_square - bic_margin) {
      stage.rivals.emplace_back(std::string(entry.name), rival);
      stage.rival_columns.push_back(rival_column);
    }
    if ((rival > chosen_z_square - bic_margin || imitates) && std::find(names.begin(), names.end(), entry.name) == names.end()) {
      names.emplace_back(entry.name);
      std::string& how = d_.separate_by[std::string(chosen.entry->name)];
      how += (how.empty() ? "" : "; ") + std::string(entry.name) + ": " + std::string(entry.seen_by);
    }
  }
}

// A pattern without a name explains the residual best. Effects already found keep their names only if they stand beside it.
void Diagnoser::stop_unexplained(const EffectColumn& pattern, const JointResult& with_pattern) {
  d_.verdict = Verdict::unexplained;
  d_.unexplained_pattern = describe_pattern(pattern);
  std::vector<EffectColumn> kept;
  for (const EstimatedEffect& e : with_pattern.effects)
    if (!is_pattern(e.column) && e.value * e.value > threshold_ * e.sigma * e.sigma) kept.push_back(e.column);
  if (kept.size() != chosen_.size()) {
    chosen_ = kept;
    current_ = fit(chosen_, d_.base);
  }
}

// The time of a step or the period of a wave that fits best, on a finer grid.
EffectColumn Diagnoser::refine(const EffectColumn& pattern, bool without_bias_instability) const {
  const std::vector<EffectColumn> finer = refined(pattern, recording_);
  if (finer.empty()) return pattern;
  const Scores s = scores(pass(current_, finer, without_bias_instability), static_cast<int>(chosen_.size()),
                          static_cast<int>(finer.size()));
  EffectColumn top = pattern;
  double best_square = 0.0;
  for (int k = 0; k < static_cast<int>(finer.size()); ++k) {
    const double z_square = visible(s, k) ? s.s[k] * s.s[k] / s.Q(k, k) : 0.0;
    if (z_square > best_square) {
      best_square = z_square;
      top = finer[static_cast<std::size_t>(k)];
    }
  }
  return top;
}

// One stage of the forward selection; false when nothing more is to be added.
bool Diagnoser::stage() {
  const int effects = static_cast<int>(chosen_.size());
  const bool has_instability =
      current_.noise_fit && current_.noise_fit->gyro_bias_instability_gain + current_.noise_fit->accel_bias_instability_gain > hiding_gain;
  const int count = static_cast<int>(columns_.size());
  const Scores fitted = scores(pass(current_, columns_, false), effects, count);
  if (d_.stages.empty() && d_.candidates.empty()) list_candidates(fitted);
  // Slow effects hide in the fitted bias instability: they are looked for without it, and judged with the noise fitted again.
  const Scores bare = has_instability ? scores(pass(current_, columns_, true), effects, count) : fitted;
  const std::int64_t n = current_.last.observations;
  struct Trial {
    Nominee nominee;
    const Scores* scores;
    EffectColumn column;
    JointResult fit;
    double gain = 0.0;        // the smaller one where the noise may be slow (of the best ones): what is accepted or not
    double plain_gain = 0.0;  // at the fitted noise: what decides between an effect and a pattern
  };
  std::vector<Trial> trials;
  for (const bool patterns : {false, true})
    for (const Scores* s : {&fitted, &bare}) {
      const Nominee nominee = best(*s, patterns, n);
      if (nominee.candidate < 0 || nominee.z_square < threshold_) continue;
      // A pattern matters only where it may beat the best effect; its time or period is not yet the right one.
      if (patterns && nominee.z_square < 0.6 * best(*s, false, n).z_square) continue;
      std::vector<Nominee> nominees = {nominee};
      if (!patterns) {
        const std::vector<Nominee> rivals = rivals_of(nominee, *s, n);
        nominees.insert(nominees.end(), rivals.begin(), rivals.end());
      }
      for (const Nominee& one : nominees)
        if (std::none_of(trials.begin(), trials.end(), [&](const Trial& t) { return t.nominee.candidate == one.candidate; }))
          trials.push_back({one, s, {}, {}, 0.0, 0.0});
      if (s == &bare || &fitted == &bare) break;
    }
  Trial* best_effect = nullptr;
  Trial* best_pattern = nullptr;
  for (Trial& trial : trials) {
    EffectColumn& column = trial.column;
    column = columns_[static_cast<std::size_t>(trial.nominee.candidate)];
    if (is_pattern(column)) column = refine(column, trial.scores == &bare);
    std::vector<EffectColumn> model = chosen_;
    model.push_back(column);
    // Rivals imitate their nominee, so its noise is theirs as well.
    const Trial* like = nullptr;
    if (!is_pattern(column))
      for (const Trial& earlier : trials)
        if (&earlier < &trial && earlier.scores == trial.scores && !is_pattern(earlier.column)) {
          like = &earlier;
          break;
        }
    trial.fit = fit(model, current_, like ? &like->fit.noise : nullptr);
    trial.gain = minus_two_log_likelihood(current_) - minus_two_log_likelihood(trial.fit) - penalty(column, n);
    trial.plain_gain = trial.gain;
    Trial*& top = is_pattern(column) ? best_pattern : best_effect;
    if (!top || trial.plain_gain > top->plain_gain) top = &trial;
  }
  if (!best_effect && !best_pattern) return false;
  // Only the best ones are judged, so only they have to hold beside slow noise.
  std::optional<double> without;
  for (Trial* trial : {best_effect, best_pattern}) {
    if (!trial || !has_instability || trial->gain <= threshold_ || trial->gain >= surely) continue;
    std::vector<EffectColumn> model = chosen_;
    model.push_back(trial->column);
    if (!without) without = misfit_beside_slow_noise(chosen_, current_);
    trial->gain =
        std::min(trial->gain, *without - misfit_beside_slow_noise(model, trial->fit) - penalty(trial->column, n));
  }
  Trial& winner = best_effect ? *best_effect : *best_pattern;
  SelectionStage stage;
  stage.chosen = winner.column;
  const int k = winner.nominee.candidate;
  stage.z = winner.scores->s[k] / std::sqrt(winner.scores->Q(k, k));
  stage.gain = winner.gain;
  stage.threshold = threshold_;
  const double effect_gain = best_effect ? best_effect->gain : 0.0;
  if (best_pattern && best_pattern->gain > threshold_ &&
      best_pattern->plain_gain > (best_effect ? best_effect->plain_gain : 0.0) +
                                     (depends_on_time_only(best_pattern->column) ? 0.0 : bic_margin)) {
    stage.chosen = best_pattern->column;
    stage.gain = best_pattern->gain;
    stage.note = "a pattern without a name in the catalogue explains the residual better: " + describe_pattern(stage.chosen);
    d_.stages.push_back(stage);
    stop_unexplained(stage.chosen, best_pattern->fit);
    return false;
  }
  if (effect_gain < threshold_) {
    stage.note = "not accepted: the likelihood gains less than the threshold";
    d_.stages.push_back(stage);
    return false;
  }
  stage.accepted = true;
  stage.note = "accepted";
  name_aliases(*winner.scores, stage.chosen, stage.z * stage.z, stage);
  d_.stages.push_back(stage);
  chosen_.push_back(stage.chosen);
  const bool with_noise_of_another = !winner.fit.noise_fit && !options_.estimate.noise;
  current_ = with_noise_of_another ? fit(chosen_, winner.fit) : std::move(winner.fit);
  return static_cast<int>(chosen_.size()) < options_.max_components;
}

// The effect of `name` did not help on held-out data; does another of its alias class, in its place?
bool Diagnoser::take_rival(const std::string& name, const std::vector<EffectColumn>& without, double error_without,
                           const HoldoutGate& check) {
  for (SelectionStage& stage : d_.stages) {
    if (!stage.accepted || stage.chosen.entry->name != name) continue;
    for (const EffectColumn& rival : stage.rival_columns) {
      const std::string rival_name(rival.entry->name);
      if (std::find(d_.gated_out.begin(), d_.gated_out.end(), rival_name) != d_.gated_out.end()) continue;
      std::vector<EffectColumn> model = without;
      model.push_back(rival);
      JointResult other = fit(model, current_);
      if (check.error(other, current_.noise).chi_square >= error_without) continue;
      std::vector<std::string> names = d_.aliases[name];
      std::replace(names.begin(), names.end(), rival_name, name);
      d_.aliases.erase(name);
      d_.aliases[rival_name] = names;
      d_.separate_by[rival_name] = d_.separate_by[name];
      d_.separate_by.erase(name);
      stage.note += "; held-out data prefer " + rival.key() + " of the same alias class";
      d_.gated_out.push_back(name);
      chosen_ = model;
      current_ = std::move(other);
      return true;
    }
  }
  return false;
}

// An effect stays only if the error of data not used in the fit is lower with it than without it.
void Diagnoser::gate() {
  const HoldoutGate check(recording_, options_.holdout, [this](const std::vector<EffectColumn>& effects, const JointResult& from,
                                                               const std::vector<char>& unobserved) {
    JointOptions o = estimate_options(effects, &from);
    o.unobserved = unobserved;
    o.noise = current_.noise;
    o.faults_of = &from;
    o.one_step = true;  // a quarter of the dwells moves no parameter by more than a few sigma: the problem is linear there
    return joint_estimate(recording_, o);
  });
  d_.holdout_source = check.source();
  std::optional<HoldoutError> of_current, of_base;  // at the noise of current_
  for (bool removed = true; removed && !chosen_.empty();) {
    removed = false;
    of_base.reset();
    of_current = check.error(current_);
    const HoldoutError& with = *of_current;
    std::vector<std::string> names;
    for (const EffectColumn& c : chosen_)
      if (std::find(names.begin(), names.end(), c.entry->name) == names.end()) names.emplace_back(c.entry->name);
    for (const std::string& name : names) {
      std::vector<EffectColumn> without;
      for (const EffectColumn& c : chosen_)
        if (c.entry->name != name) without.push_back(c);
      // Judged at the noise of current_, so it is fitted at that, too.
      JointOptions at_noise = estimate_options(without, &current_);
      at_noise.noise = current_.noise;
      at_noise.faults_of = &current_;
      const JointResult reduced = without.empty() ? d_.base : joint_estimate(recording_, at_noise);
      const HoldoutError of_reduced = check.error(reduced, current_.noise);
      if (without.empty()) of_base = of_reduced;
      const double error_without = of_reduced.chi_square;
      if (error_without > with.chi_square) continue;
      if (take_rival(name, without, error_without, check)) {
        removed = true;
        break;
      }
      d_.gated_out.push_back(name);
      d_.aliases.erase(name);
      d_.separate_by.erase(name);
      chosen_ = without;
      current_ = fit(chosen_, d_.base);
      removed = true;
      break;
    }
  }
  d_.holdout_before = of_base && !chosen_.empty() ? *of_base : check.error(d_.base, current_.noise);
  d_.holdout_after = chosen_.empty() ? d_.holdout_before : *of_current;
}

void Diagnoser::judge() {
  char text[256];
  const bool noise_given = options_.estimate.noise.has_value();
  // Where even the noise does not fit, neither names nor patterns mean anything.
  if (!current_.whiteness.white) {
    d_.verdict = Verdict::noise_model;
    d_.reason = current_.whiteness.message + (noise_given ? " (the noise was given, not measured)" : "") + ": no claim on effects";
    chosen_.clear();
    d_.aliases.clear();
    d_.separate_by.clear();
    d_.unexplained_pattern.clear();
    current_ = d_.base;
    d_.holdout_after = d_.holdout_before;
    return;
  }
  if (d_.verdict == Verdict::unexplained) {
    d_.reason = "a residual beyond noise that no catalogue effect explains; it looks like: " + d_.unexplained_pattern;
    return;
  }
  if (chosen_.empty()) {
    d_.verdict = Verdict::clean;
    d_.reason = d_.gated_out.empty() ? "the base model explains the data"
                                     : "the base model explains the data; what was found on them did not help on held-out data";
    return;
  }
  d_.verdict = Verdict::extended;
  std::snprintf(text, sizeof text, "held-out error %.4f before, %.4f after", d_.holdout_before.normalised_rms,
                d_.holdout_after.normalised_rms);
  d_.reason = text;
}

void Diagnoser::collect_residuals() {
  FilterSetup setup = current_.setup;
  setup.with_columns = false;
  setup.keep_innovations = true;
  const auto run = [&](const JointResult& r) {
    return run_filter(recording_, r.parameters, effect_model_of(r, recording_.info.latitude_deg), setup);
  };
  const FilterResult before = run(d_.base);
  const FilterResult after = chosen_.empty() ? before : run(current_);
  const auto rms = [](const FilterResult& r) {
    return std::sqrt(r.chi_square / static_cast<double>(std::max<std::int64_t>(r.observations, 1)));
  };
  d_.error_before = rms(before);
  d_.error_after = rms(after);
  const SensorModel model = sensor_model(current_.parameters, recording_.info);
  double rotation_end = -1e9;
  std::size_t next = 0;
  for (std::size_t i = 0; i < before.innovations.size() && i < after.innovations.size(); ++i) {
    const Innovation& b = before.innovations[i];
    const Innovation& a = after.innovations[i];
    for (; next < b.block; ++next)
      if (recording_.segments[recording_.blocks[next].segment].kind == SegmentKind::rotate)
        rotation_end = static_cast<double>(recording_.blocks[next].start_sample - recording_.blocks.front().start_sample) *
                           recording_.info.sample_period_s + recording_.blocks[next].duration_s;
    const Block& block = recording_.blocks[b.block];
    d_.residuals.push_back({b.block, block.segment, b.time_s, b.normalised, a.normalised, b.free_velocity_mps,
                            a.free_velocity_mps, model.accel_scale * block.accel / block.duration_s - model.accel_bias_mps2,
                            block.temperature_c, b.time_s - rotation_end});
  }
}

Diagnosis Diagnoser::run() {
  d_.base = joint_estimate(recording_, estimate_options({}, nullptr));
  current_ = d_.base;
  if (!d_.base.converged) {
    d_.reason = "the base model could not be fitted: " + d_.base.message;
    d_.extended = d_.base;
    return d_;
  }
  d_.verdict = Verdict::clean;
  while (stage()) {
  }
  if (!chosen_.empty()) current_ = joint_estimate(recording_, estimate_options(chosen_, &current_));
  gate();
  judge();
  collect_residuals();
  // Strongest first.
  std::vector<EstimatedEffect> order = current_.effects;
  std::sort(order.begin(), order.end(), [](const EstimatedEffect& a, const EstimatedEffect& b) {
    return std::abs(a.value) * b.sigma > std::abs(b.value) * a.sigma;
  });
  for (const EstimatedEffect& e : order)
    if (std::find(d_.effect_names.begin(), d_.effect_names.end(), e.column.entry->name) == d_.effect_names.end())
      d_.effect_names.emplace_back(e.column.entry->name);
  d_.extended = current_;
  return d_;
}

}  // namespace

const char* to_string(Verdict verdict) {
  switch (verdict) {
    case Verdict::clean: return "clean";
    case Verdict::extended: return "extended";
    case Verdict::unexplained: return "unexplained";
    case Verdict::noise_model: return "noise_model";
  }
  return "?";
}

Diagnosis diagnose(const CompressedRecording& recording, const DiagnosisOptions& options) {
  return Diagnoser(recording, options).run();
}

}  // namespace turncal
