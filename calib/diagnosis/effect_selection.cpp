#include "calib/diagnosis/effect_selection.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "calib/diagnosis/candidate_list.h"
#include "calib/diagnosis/unexplained.h"

namespace turncal {

namespace {

// A free time constant is one more parameter: ln n of BIC.
double penalty(const EffectColumn& column, std::int64_t observations) {
  return column.entry->taus_s.empty() ? 0.0 : std::log(static_cast<double>(observations));
}

struct Nominee {
  int candidate = -1;     // index into the columns
  double z_square = 0.0;  // after the penalty
};

// A nominee with the model fitted again.
struct Trial {
  Nominee nominee;
  const Scores* scores = nullptr;
  EffectColumn column;
  JointResult fit;
  double gain = 0.0;        // the smaller one where the noise may be slow (of the best ones): what is accepted or not
  double plain_gain = 0.0;  // at the fitted noise: what decides between an effect and a pattern
  double price = 0.0;       // the penalty: a time constant that nobody knows makes a name dear, and a doubt not
};

// `paid`: with the penalty.
Nominee best(const DiagnosisModel& m, const Scores& s, bool patterns, bool paid = true) {
  Nominee top;
  for (int k = 0; k < static_cast<int>(m.columns.size()); ++k) {
    const EffectColumn& column = m.columns[static_cast<std::size_t>(k)];
    if (is_pattern(column) != patterns || !visible(s, k)) continue;
    if (m.has_chosen(column)) continue;
    const double z_square = s.s[k] * s.s[k] / s.Q(k, k) - (paid ? penalty(column, m.current.last.observations) : 0.0);
    if (z_square > top.z_square) top = {k, z_square};
  }
  return top;
}

// The best component of each other effect that comes within 10 of the best: the likelihood decides between them.
std::vector<Nominee> rivals_of(const DiagnosisModel& m, const Nominee& top, const Scores& s) {
  std::vector<Nominee> rivals;
  const EffectEntry* winner = m.columns[static_cast<std::size_t>(top.candidate)].entry;
  for (const EffectEntry& entry : effect_catalogue()) {
    Nominee rival;
    for (int k = 0; k < static_cast<int>(m.catalogue.size()) && &entry != winner; ++k) {
      const EffectColumn& column = m.catalogue[static_cast<std::size_t>(k)];
      if (column.entry != &entry || !visible(s, k) || m.has_chosen(column)) continue;
      const double z_square = s.s[k] * s.s[k] / s.Q(k, k) - penalty(column, m.current.last.observations);
      if (z_square > rival.z_square) rival = {k, z_square};
    }
    if (rival.candidate >= 0 && rival.z_square > top.z_square - m.options.limits.selection.bic_margin)
      rivals.push_back(rival);
  }
  std::sort(rivals.begin(), rivals.end(), [](const Nominee& a, const Nominee& b) { return a.z_square > b.z_square; });
  const std::size_t most = static_cast<std::size_t>(m.options.limits.selection.most_rivals);
  if (rivals.size() > most) rivals.resize(most);
  return rivals;
}

// What is worth a fit. `bare`: the scores without bias instability, in which slow effects hide; the same object as `fitted` where
// there is none.
std::vector<Trial> nominate(const DiagnosisModel& m, const Scores& fitted, const Scores& bare) {
  std::vector<Trial> trials;
  for (const bool patterns : {false, true})
    for (const Scores* s : {&fitted, &bare}) {
      const Nominee nominee = best(m, *s, patterns);
      // A pattern matters only where it may beat the best effect; its time or period is not yet the right one.
      if (patterns && nominee.z_square < m.options.limits.selection.pattern_part * best(m, *s, false).z_square)
        continue;
      std::vector<Nominee> nominees;
      if (nominee.z_square >= m.near) nominees.push_back(nominee);
      if (!patterns && !nominees.empty()) {
        const std::vector<Nominee> rivals = rivals_of(m, nominee, *s);
        nominees.insert(nominees.end(), rivals.begin(), rivals.end());
      }
      // And what is doubted the most.
      if (const Nominee doubted = best(m, *s, patterns, false); doubted.z_square > m.near) nominees.push_back(doubted);
      for (const Nominee& one : nominees)
        if (std::none_of(trials.begin(), trials.end(),
                         [&](const Trial& t) { return t.nominee.candidate == one.candidate; }))
          trials.push_back({one, s, m.columns[static_cast<std::size_t>(one.candidate)], {}, 0.0, 0.0});
      if (s == &bare || &fitted == &bare) break;
    }
  return trials;
}

// The time of a step or the period of a wave that fits best, on a finer grid.
EffectColumn refine(const DiagnosisModel& m, const EffectColumn& pattern, bool without_bias_instability) {
  const std::vector<EffectColumn> finer = refined(pattern, m.recordings.parts);
  if (finer.empty()) return pattern;
  const Scores s =
      std::move(m.scores(finer, {without_bias_instability ? m.bare_noise() : m.current.setup.noise}).front());
  EffectColumn top = pattern;
  double best_square = 0.0;
  for (int k = 0; k < static_cast<int>(finer.size()); ++k) {
    const double z_square = visible(s, k) ? s.s[k] * s.s[k] / s.Q(k, k) : 0.0;
    if (z_square <= best_square) continue;
    best_square = z_square;
    top = finer[static_cast<std::size_t>(k)];
  }
  return top;
}

std::vector<EffectColumn> with(const DiagnosisModel& m, const EffectColumn& column) {
  std::vector<EffectColumn> model = m.chosen;
  model.push_back(column);
  return model;
}

// What is gained is gained over the present model fitted in the same way, noise included: a percent of the random walks, as a fit from longer
// intervals finds them, is tens of 2 ln L. An effect whose own noise fit missed the place that the model without it found is fitted there.
void fit_trials(const DiagnosisModel& m, const Scores& bare, std::vector<Trial>& trials) {
  if (trials.empty()) return;
  const JointResult again = m.fit(m.chosen, m.current);
  const double without = minus_two_log_likelihood(again);
  for (Trial& trial : trials) {
    const bool pattern = is_pattern(trial.column);
    if (pattern) trial.column = refine(m, trial.column, trial.scores == &bare);
    // Rivals imitate their nominee, so its noise is theirs as well.
    const NoiseModel* noise = nullptr;
    for (const Trial& earlier : trials) {
      if (pattern || &earlier == &trial) break;
      if (earlier.scores != trial.scores || is_pattern(earlier.column)) continue;
      noise = &earlier.fit.noise;
      break;
    }
    trial.fit = m.fit(with(m, trial.column), m.current, noise);
    if (without - minus_two_log_likelihood(trial.fit) < 0.5 * trial.nominee.z_square) {
      JointResult other = m.fit(with(m, trial.column), m.current, &again.noise);
      if (minus_two_log_likelihood(other) < minus_two_log_likelihood(trial.fit)) trial.fit = std::move(other);
    }
    trial.price = penalty(trial.column, m.current.last.observations);
    trial.plain_gain = without - minus_two_log_likelihood(trial.fit) - trial.price;
    trial.gain = trial.plain_gain;
  }
}

// `paid`: this part of the price is not asked.
Trial* best_of(std::vector<Trial>& trials, bool patterns, double paid = 0.0) {
  Trial* top = nullptr;
  const auto gain = [paid](const Trial& t) { return t.plain_gain + paid * t.price; };
  for (Trial& trial : trials)
    if (is_pattern(trial.column) == patterns && (!top || gain(trial) > gain(*top))) top = &trial;
  return top;
}

// Where a g-sensitivity and a drift of the gyros explain the same (in a sequence whose positions come in the order of time), the drift
// is tried: every gyro has one.
Trial* time_before_g(std::vector<Trial>& trials, Trial* top, double margin) {
  if (top == nullptr || top->column.entry->name != "gyro_g_sensitivity") return top;
  Trial* time = nullptr;
  for (Trial& trial : trials)
    if (!is_pattern(trial.column) && trial.column.entry->of_one_run &&
        trial.column.entry->name.starts_with("gyro_bias") && trial.plain_gain > top->plain_gain - margin &&
        (!time || trial.plain_gain > time->plain_gain))
      time = &trial;
  return time ? time : top;
}

// Only the best ones are judged, so only they have to hold beside slow noise.
void hold_beside_slow_noise(const DiagnosisModel& m, std::initializer_list<Trial*> judged) {
  std::optional<double> without;
  for (Trial* trial : judged) {
    if (!trial || trial->gain + trial->price <= m.near || trial->gain >= m.options.limits.selection.surely) continue;
    if (!without) without = m.misfit_beside_slow_noise(m.chosen, m.current);
    const double slow = m.misfit_beside_slow_noise(with(m, trial->column), trial->fit);
    trial->gain = std::min(trial->gain, *without - slow - trial->price);
  }
}

// A gain with the noise fitted again may be the noise's: what is claimed is worth as much by its own sigma, and where its time or period
// was looked for besides, more.
bool stands_out(const DiagnosisModel& m, const Trial& trial) {
  const bool timed = is_pattern(trial.column) && depends_on_time_only(trial.column);
  const double threshold = timed ? m.threshold_of_times : m.threshold;
  if (trial.gain < threshold) return false;
  const auto of_trial = [&trial](const EstimatedEffect& e) { return e.column.key() == trial.column.key(); };
  const auto& effects = trial.fit.effects;
  const auto e = std::find_if(effects.begin(), effects.end(), of_trial);
  return e != effects.end() && e->value * e->value > threshold * e->sigma * e->sigma &&
         std::abs(e->value) <= absurd_magnitude(*e->column.entry);
}

// A pattern without a name explains the residual best. Effects already found keep their names only if they stand beside it.
void stop_unexplained(DiagnosisModel& m, Diagnosis& d, const Trial& pattern) {
  d.verdict = Verdict::unexplained;
  d.unexplained_pattern = describe_pattern(pattern.column);
  m.beside.push_back(pattern.fit.parameters);
  std::vector<EffectColumn> kept;
  for (const EstimatedEffect& e : pattern.fit.effects)
    if (!is_pattern(e.column) && !is_turn_on(e.column) && e.value * e.value > m.threshold * e.sigma * e.sigma)
      kept.push_back(e.column);
  if (kept.size() == m.chosen.size()) return;
  m.chosen = kept;
  m.current = m.fit(m.chosen, d.base);
}

// One stage; false when nothing more is to be added.
bool select_one(DiagnosisModel& m, Diagnosis& d) {
  const std::optional<NoiseFit>& noise = m.current.noise_fit;
  const bool has_instability = noise && noise->gyro_bias_instability_gain + noise->accel_bias_instability_gain >
                                            m.options.limits.selection.hiding_gain;
  // Slow effects hide in the fitted bias instability: they are looked for without it, and judged with the noise fitted again.
  std::vector<NoiseModel> noises = {m.current.setup.noise};
  if (has_instability) noises.push_back(m.bare_noise());
  const std::vector<Scores> scores = m.scores(m.columns, noises);
  const Scores &fitted = scores.front(), &bare = scores.back();
  if (d.candidates.empty()) list_candidates(m, fitted, d);

  std::vector<Trial> trials = nominate(m, fitted, bare);
  fit_trials(m, bare, trials);
  Trial* effect = time_before_g(trials, best_of(trials, false), m.options.limits.selection.bic_margin);
  Trial* pattern = best_of(trials, true);
  if (!effect && !pattern) return false;
  Trial* doubted = best_of(trials, false, 1.0);
  if (doubted == effect) doubted = nullptr;
  if (has_instability) hold_beside_slow_noise(m, {effect, pattern, doubted});

  SelectionStage stage;
  Trial& winner = effect ? *effect : *pattern;
  const int k = winner.nominee.candidate;
  stage.chosen = winner.column;
  stage.z = winner.scores->s[k] / std::sqrt(winner.scores->Q(k, k));
  stage.gain = winner.gain;
  stage.threshold = m.threshold;
  const double margin = pattern && depends_on_time_only(pattern->column) ? 0.0 : m.options.limits.selection.bic_margin;
  const bool claimed = effect && stands_out(m, *effect);
  const bool better =
      pattern && pattern->gain > m.threshold && pattern->plain_gain > (effect ? effect->plain_gain : 0.0) + margin;
  if (better && (claimed || stands_out(m, *pattern))) {
    stage.chosen = pattern->column;
    stage.gain = pattern->gain;
    stage.note =
        "a pattern without a name in the catalogue explains the residual better: " + describe_pattern(stage.chosen);
    d.stages.push_back(stage);
    stop_unexplained(m, d, *pattern);
    return false;
  }
  if (!claimed) {
    stage.note = "not accepted: the likelihood gains less than the threshold, or the effect is fewer of its sigmas";
    for (const Trial* trial : {effect, pattern, doubted})
      if (trial && trial->gain + trial->price > m.near) m.beside.push_back(trial->fit.parameters);
    d.stages.push_back(stage);
    return false;
  }
  stage.accepted = true;
  stage.note = "accepted";
  name_aliases(m, *winner.scores, stage.chosen, stage.z * stage.z, stage, d);
  d.stages.push_back(stage);
  m.chosen.push_back(stage.chosen);
  const bool with_noise_of_another = !winner.fit.noise_fit && !m.options.estimate.noise;
  m.current = with_noise_of_another ? m.fit(m.chosen, winner.fit) : std::move(winner.fit);
  return static_cast<int>(m.chosen.size()) < m.options.max_components;
}

}  // namespace

void select_effects(DiagnosisModel& m, Diagnosis& d) {
  while (select_one(m, d)) {
  }
}

}  // namespace turncal
