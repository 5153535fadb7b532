// The evidence about a fit: the terms that may be missing, their posterior, the statements made of it, and the averaged parameters.
#pragma once

#include <algorithm>
#include <memory>
#include <string>
#include <vector>

#include "calib/evidence/omnibus.h"
#include "calib/evidence/posterior.h"
#include "calib/joint/joint_estimate.h"

namespace turncal {

// One filter pass at a fit, cut into pieces. The effects of the fit are corrected for in the pass, turn-on columns excepted.
struct PiecewiseView {
  CompressedRecording recording;   // coarser (joint_filter.h)
  std::vector<BlockState> states;  // of its blocks
  Pieces pieces;
  std::vector<int> columns;             // columns of the system, of [24 parameters, effects of the fit]
  std::unique_ptr<PieceSystem> system;  // null: no rest
};
PiecewiseView view_in_pieces(const CompressedRecording& recording, const JointResult& fit, const NoiseModel& noise);

struct Evidence {
  std::vector<int> columns;  // columns of the averages, of [24 parameters, effects of the fit]
  std::vector<PiecewiseView> views;
  // The terms at each noise model, the fit's first; empty: no rest. Held-out data enter the posterior alone.
  std::vector<UnderNoise> at_each_noise;
  Posterior posterior;  // over all noise models together
  Statements statements;
  NamedEffects named;
  Omnibus omnibus;  // of the most probable model
};

// Weighs the evidence about `fit`, made from `recording`, which joins `recordings` of them. Effects of the fit, turn-on columns excepted, are terms
// like all others; everything is linearised about them. A missing effect can hide in a fitted bias instability, and an instability can imitate an
// effect: models are scored with the fitted instability, with none, where a wander is a term (terms.h), and with that of a single sensor, which is
// then reported. `held_out`: recordings that were not fitted. They count in the odds, not in the values. They share terms and parameters with the fit,
// except the six biases and what depends on the time of one run. `something`: names do not account for what is missing: finer time constants.
Evidence weigh_evidence(const CompressedRecording& recording, const JointResult& fit, int recordings = 1,
                        const std::vector<const CompressedRecording*>& held_out = {}, bool something = false);

// Shared with hand-turned data (rest_diagnosis.h). `effects`: those of the fit, turn-on columns excepted.
// Returns what one unit of each column adds to the readings of every cell: the mean over its blocks.
std::vector<Readings> readings_of(const EffectModel& effects, const Pieces& pieces,
                                  const std::vector<BlockState>& states);
// Returns `columns`; if `finer`, with further time constants: closer where a fitted effect acts on the same quantity, dense about its own.
std::vector<EffectColumn> columns_beside(const std::vector<EstimatedEffect>& effects, std::vector<EffectColumn> columns,
                                         bool finer);
// Restores the effects that `system` corrected for: the data then contain them. `held_out`: their values in each held-out recording.
using Values = std::vector<EstimatedEffect>;
void put_back(const Values& effects, const std::vector<Values>& held_out, const TermTable& table, PieceSystem& system);
// Computes the scores of the bases again from `under.system`.
void score_again(UnderNoise& under);
// Draws the statements and names from the posterior of result.at_each_noise.
void conclude(Posterior posterior, const std::vector<EstimatedEffect>& effects, Evidence& result);

// Returns what is missing from a fit without effects, or the omnibus test that it fails; empty: neither.
std::string what_speaks_against(const CompressedRecording& recording, const JointResult& fit);

// Fits with the named effects until the evidence about the fit names the same ones; empty: it never does, or they do
// not account for what is missing. `fit` takes names, fits and weighs the evidence again; false: the fit failed.
template <class Names, class Fit>
std::vector<EffectColumn> fit_by_names(const Evidence& evidence, Names names_of, Fit fit) {
  std::vector<EffectColumn> named, more = names_of(evidence);
  const auto same = [&] { return std::ranges::equal(more, named, {}, &EffectColumn::key, &EffectColumn::key); };
  for (int k = 0; k < 3 && !same() && fit(more); ++k) {  // three rounds: the names hardly change after the second
    named = std::move(more);
    more = names_of(evidence);
  }
  return same() && evidence.named.probability >= carried_by_names ? named : std::vector<EffectColumn>{};
}

// A rest is compared with all others in runs of some hundred rests: one clean run in ten thousand has a rest this far off.
inline constexpr struct LastRestLimits {
  double probability = 1e-6;
  int fewest = 8;  // turns before it
} last_rest_limits;

// Does the last dwell of a recording, or the turn before it, disagree with all the others? If that dwell was repeated in its
// pose, the last take is tested; the other takes in that pose are left out of the comparison.
//
// The fitted noise cannot answer this: a single rest with its own bias inflates the fitted bias instability until nothing stands
// out. So the noise here is the fitted white noise, and the excess scatter of the other rests is taken as common to all:
//   chi2 of the last / max(1, chi2 of the others / their degrees)
// for a bias within the rest and for a jump at the turn before it, with the parameters of the fit eliminated (piece_system.h). An
// effect or a bias instability that all rests share therefore raises no alarm. With fewer turns than LastRestLimits::fewest there
// is nothing to compare with, and the answer is no.
bool last_rest_disagrees(const CompressedRecording& recording, const JointResult& fit);

}  // namespace turncal
