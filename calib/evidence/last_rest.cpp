#include "calib/evidence/last_rest.h"

#include <algorithm>
#include <cmath>

#include "calib/evidence/evidence.h"
#include "calib/statistics/distributions.h"

namespace turncal {
namespace {

// Of the biases within a rest (`first` = 0) or the jumps at turns (6).
bool stands_out(const PiecewiseView& view, Eigen::Index first, bool turns_only) {
  const std::vector<Piece>& pieces = view.pieces.pieces;
  double others = 0.0;
  int degrees = 0;
  std::vector<RankedChiSquare> last;
  for (std::size_t k = 0; k < pieces.size(); ++k) {
    if (turns_only && !pieces[k].after_turn) continue;
    const PieceSystem::OfPiece of = view.system->of_piece(k);
    const RankedChiSquare ranked = ranked_chi_square(of.Q.block<6, 6>(first, first), of.s.segment<6>(first),
                                                     of.before.segment<6>(first), LackOfFitLimits{}.rank_floor);
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
  NoiseModel noise = fit.noise;
  noise.gyro_bias_instability_radps = noise.accel_bias_instability_mps2 = 0.0;
  const PiecewiseView view = view_in_pieces(recording, fit, noise);
  if (!view.system || view.pieces.pieces.back().turn < last_rest_limits.fewest) return false;
  return stands_out(view, 0, false) || stands_out(view, 6, true);
}

}  // namespace turncal
