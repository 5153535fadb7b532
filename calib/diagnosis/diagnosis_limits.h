// Every threshold of the diagnosis, with its derivation or its calibration (docs/diagnosis.md, "Limits").
#pragma once

#include <map>
#include <string>

namespace turncal {

struct LackOfFitLimits {
  // All tests together; each gets an equal share (Bonferroni).
  double family_wise = 0.005;
  // A direction of which the model imitates all but this is not tested: rounding and linearisation are larger than what is left.
  double rank_floor = 1e-3;
  // chi2 is divided by these before it is judged: what clean recordings have beyond the theory; 1 where none is given.
  // innovations: the pulses of an accelerometer that counts close to a whole number a sample beat, and their error is not white.
  std::map<std::string, double> inflation = {{"innovations", 2.0}};
  // Share of pulses in the variance of a second's mean velocity beyond which that axis and second are left out of the innovations'
  // correlation. Calibrated: with these seconds chi2 a degree of clean runs came to 37, without them to 2.5 at most (96 runs).
  double pulse_share = 0.02;
  int lags_s = 30;
  // Where a dwell is cut: what comes with a turn and fades, and what wanders.
  double first_piece_s = 25.0, longest_piece_s = 120.0;
  // Flicker noise wanders on every scale, and a process of some minutes cannot follow it: where there is bias instability, a test must
  // fire beside a slow one, too (a third of a two-hour run), and an effect be better than it.
  double slow_correlation_s = 2400.0;
  double inflation_of(const std::string& family) const;
};

struct SelectionLimits {
  // 2 ln L by which an effect is better than another with as many parameters: "very strong" in the scale of Kass and Raftery, J. Am.
  // Stat. Assoc. 90 (1995) 773.
  double bic_margin = 10.0;
  // A component whose columns' multiple correlation with another effect is above this is its alias: 4 sigma of one are then 1 sigma
  // of the difference (1 / sqrt(1 - 0.97^2) = 4.1).
  double alias_correlation = 0.97;
  // Of what the columns hold, the part that the model does not imitate must be above rounding.
  double visible_part = 1e-9;
  // 2 ln L that bias instability must bring before an effect can be hiding in it: chi2 of two variances, 2 %.
  double hiding_gain = 8.0;
  // 2 ln L beyond which no choice of noise matters: eight times the family-wise limit.
  double surely = 150.0;
  // Other effects within bic_margin of the best that are fitted: more only cost time.
  int most_rivals = 3;
  // 2 ln L by which an effect must be better than every family without a name to be named: "positive" in the scale of Kass and Raftery.
  // Of 50 effects of the catalogue at twice the detectable magnitude three are better by 4.7 to 5.9 only (docs/diagnosis-study.md).
  double family_margin = 4.0;
  // What comes nearer to its limit than this family-wise probability is not claimed, but what it would do to the parameters goes into
  // their sigmas: at the limit an effect has moved a bias by up to ten sigma. One clean run in ten has such a sigma.
  double near_family_wise = 0.1;
  // A pattern is fitted when its score is this part of the best effect's (its time or period is not yet the right one).
  double pattern_part = 0.6;
};

struct GateLimits {
  // The gain of held-out chi2 must exceed this many of its standard errors.
  double standard_errors = 1.0;
  // A second recording contradicts an effect when its error rises with it, and the gain is this many standard errors below what the
  // effect promises there: less than one in 160 of those that are real.
  double contradiction = 2.5;
  // Held-out data where the gain to be expected is below three standard errors cannot decide alone: the gain on the dwells left
  // out of the fitted recording is added. (|d|^2 < 3 * 2 |d|.)
  double expected_gain = 36.0;
  // Normalised error of held-out data beyond which no model is trusted, whatever was gained on the way: clean recordings come to 0.95
  // with a scatter of 0.02 (docs/diagnosis-study.md), so this is ten times it.
  double highest_error = 1.2;
};

// Of hand-turned data (rest_diagnosis.h).
struct RestLimits {
  // Correlation of what two effects explain: one class from 0.9 on (of 4.5 sigma of one 2 are left of the difference), and kindred from
  // 0.7 on (half of the variance in common).
  double class_correlation = 0.9, kindred_correlation = 0.7;
  // Length of a column that is left after projection: below this it is rounding and linearisation.
  double unseen_part = 1e-5;
  // Kinds of observation that hold less than this share of a column do not count among its degrees of freedom.
  double touched_share = 0.01;
  // Directions of a set of slow curves flatter than this are noise.
  double nuisance_floor = 0.03;
};
inline constexpr RestLimits rest_limits;

struct NoiseLimits {
  // Beyond these the noise model is wrong as a whole and nothing else means anything. A correlation of r makes means (1 + r) / (1 - r)
  // as uncertain: 0.15 is a sixth of sigma. Innovations larger than the model says by 1.25 are an eighth of sigma; smaller ones only
  // make sigmas too large: clean runs with a small velocity random walk came to 0.76 to 0.78 (3 of 120); 0.64 is a quarter of sigma.
  double correlation = 0.15;
  double lowest_level = 0.64, highest_level = 1.25;
};

struct DiagnosisLimits {
  NoiseLimits noise;
  LackOfFitLimits fit;
  SelectionLimits selection;
  GateLimits gate;
};

}  // namespace turncal
