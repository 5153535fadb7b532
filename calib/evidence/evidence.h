// What a fit of a recording leaves to be explained: terms, their posterior, what is said of them, and what the parameters are then.
#pragma once

#include <algorithm>
#include <memory>
#include <string>
#include <vector>

#include "calib/evidence/omnibus.h"
#include "calib/evidence/posterior.h"
#include "calib/joint/joint_estimate.h"

namespace turncal {

// One filter pass at a fit, cut into pieces. Effects of the fit other than turn-ons are taken off in the pass.
struct PiecewiseView {
  CompressedRecording recording;   // coarser (joint_filter.h)
  std::vector<BlockState> states;  // of its blocks
  Pieces pieces;
  std::vector<int> columns;             // of [24 parameters, effects of the fit]: those of the system
  std::unique_ptr<PieceSystem> system;  // none: no rest
};
PiecewiseView view_in_pieces(const CompressedRecording& recording, const JointResult& fit, const NoiseModel& noise);

struct Evidence {
  std::vector<int> columns;  // of [24 parameters, effects of the fit]: those of the averages
  std::vector<PiecewiseView> views;
  // Of `views`, the fit's first; empty: no rest. Held-out data are in `posterior` alone.
  std::vector<UnderNoise> at_each_noise;
  Posterior posterior;  // at each noise, together
  Statements statements;
  NamedEffects named;
  Omnibus omnibus;  // of the most probable model
};

// `fit`: of `recording`, which is joined from so many. Effects of the fit other than turn-ons are terms like all others: about them
// everything is linearised. What is missing may hide in a fitted bias instability, and an instability may look like something missing: models
// are weighed with all of it, with none of it, where a wander is a term (terms.h), and with that of one sensor alone, which is then said.
// `held_out`: recordings that the parameters were not fitted to. They have a say in the odds, and none in the values: terms and parameters are
// common, but for the six biases and what goes with the time of one run. `something`: no name carries what is missing: finer time constants.
Evidence weigh_evidence(const CompressedRecording& recording, const JointResult& fit, int recordings = 1,
                        const std::vector<const CompressedRecording*>& held_out = {}, bool something = false);

// For both kinds of recordings (rest_diagnosis.h). `effects`: of the fit, but for those of turn-on.
// What one unit of each column adds to the readings of every cell: the mean over its blocks.
std::vector<Readings> readings_of(const EffectModel& effects, const Pieces& pieces,
                                  const std::vector<BlockState>& states);
// `columns`; `finer`: and time constants between theirs, more for what acts on the quantity of a fitted effect, dense about its own.
std::vector<EffectColumn> columns_beside(const std::vector<EstimatedEffect>& effects, std::vector<EffectColumn> columns,
                                         bool finer);
// The effects were taken off in `system`: from here on they are in the data. Of each recording that is held out, the same with its own values.
using Values = std::vector<EstimatedEffect>;
void put_back(const Values& effects, const std::vector<Values>& held_out, const TermTable& table, PieceSystem& system);
// What is in `under` of it, anew.
void score_again(UnderNoise& under);
// What is said, by the posterior of result.at_each_noise.
void conclude(Posterior posterior, const std::vector<EstimatedEffect>& effects, Evidence& result);

// Of a fit without effects: what is missing from it, or what its omnibus finds; empty: nothing.
std::string what_speaks_against(const CompressedRecording& recording, const JointResult& fit);

// Fits with the names that the evidence has, until it has the same about the fit with them; empty: it never does, or they do not carry what is
// missing. `fit` takes names, fits and weighs anew; false: they cannot be fitted.
template <class Names, class Fit>
std::vector<EffectColumn> fit_by_names(const Evidence& evidence, Names names_of, Fit fit) {
  std::vector<EffectColumn> named, more = names_of(evidence);
  const auto same = [&] { return std::ranges::equal(more, named, {}, &EffectColumn::key, &EffectColumn::key); };
  for (int k = 0; k < 3 && !same() && fit(more); ++k) {  // they hardly change after the second
    named = std::move(more);
    more = names_of(evidence);
  }
  return same() && evidence.named.probability >= carried_by_names ? named : std::vector<EffectColumn>{};
}

// Of a rest that is compared with all the others, in runs of some hundred of them: one clean run in ten thousand has such a one.
struct LastRestLimits {
  double probability = 1e-6;
  int fewest = 8;  // turns before it
};
inline constexpr LastRestLimits last_rest_limits;

// Does the last dwell of a recording, or the turn before it, disagree with all the others? Of one that was repeated in its pose the last
// take is looked at, and the others of that pose are not what it is compared with.
//
// The noise of a fit does not answer that: one rest with a bias of its own makes the fitted bias instability large, and then nothing is
// out of place. Here the noise is white, as the fit has it, and what the other rests scatter more than it is taken for theirs all:
//   chi2 of the last / max(1, chi2 of the others / their degrees)
// for a bias within the rest and for a jump at the turn before it, the parameters of the fit eliminated (piece_system.h).
// An effect that every rest shows is so no reason; nor is bias instability that they all have.
// With fewer turns than LastRestLimits::fewest there is nothing to compare with, and the answer is no.
bool last_rest_disagrees(const CompressedRecording& recording, const JointResult& fit);

}  // namespace turncal
