#include "calib/diagnosis/last_rest.h"

#include <algorithm>
#include <cmath>

#include "calib/diagnosis/lack_of_fit.h"
#include "calib/diagnosis/segment_scores.h"
#include "calib/statistics/distributions.h"

namespace turncal {
namespace {

bool stands_out(const SegmentScores& scores, const std::vector<int>& dims, bool turns_only) {
  const std::vector<Piece>& pieces = scores.pieces();
  double others = 0.0;
  int degrees = 0;
  std::vector<RankedChiSquare> last;
  for (std::size_t k = 0; k < pieces.size(); ++k) {
    if (turns_only && !pieces[k].after_turn) continue;
    const RankedChiSquare ranked = ranked_chi_square(scores.test(k, dims), LackOfFitLimits{}.rank_floor);
    if (pieces[k].segment == pieces.back().segment) last.push_back(ranked);
    if (pieces[k].turn == pieces.back().turn) continue;
    others += ranked.chi_square;
    degrees += ranked.rank;
  }
  const double scatter = std::max(1.0, others / std::max(1, degrees));
  return std::ranges::any_of(last, [&](const RankedChiSquare& one) {
    return one.rank > 0 && chi_square_tail(one.chi_square / scatter, one.rank) < last_rest_limits.probability;
  });
}

}  // namespace

bool last_rest_disagrees(const CompressedRecording& recording, const JointResult& fit) {
  FilterSetup setup = fit.setup;
  setup.noise = fit.noise;
  setup.noise.gyro_bias_instability_radps = setup.noise.accel_bias_instability_mps2 = 0.0;
  const FitPass pass = run_fit_pass(recording, fit, setup);
  const SegmentScores scores(pass.recording, pass.filter, pass.columns, fit.reference_temperature_c, LackOfFitLimits{});
  if (scores.pieces().empty() || scores.pieces().back().turn < last_rest_limits.fewest) return false;
  return stands_out(scores, bias_dims, false) || stands_out(scores, jump_dims, true);
}

}  // namespace turncal
