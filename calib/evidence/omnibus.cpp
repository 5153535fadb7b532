#include "calib/evidence/omnibus.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include <Eigen/LU>

#include "calib/evidence/holdout.h"
#include "calib/evidence/posterior.h"
#include "calib/joint/linear_motion.h"
#include "calib/statistics/numerics.h"

namespace turncal {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr LackOfFitLimits limits;
// The pulses of an accelerometer beat for seconds: in a shorter piece that looks like a bias.
constexpr double shortest_tested_s = 20.0;

// Does the beat of an accelerometer's pulses exceed `limit` in the variance of the mean velocity? A count close to p / q of a
// pulse per sample leaves a sawtooth of 1 / q of a pulse that lasts for seconds; its variance is at most a twelfth of its square.
bool beats(double counts, int samples, double pulse, double limit) {
  constexpr int finest = 16;
  for (int q = 1; q <= finest && std::pow(pulse / q, 2) > 12.0 * limit; ++q)
    if (quantisation_variance(q * counts, samples, pulse / q) > limit) return true;
  return false;
}

}  // namespace

const OmnibusTest* Omnibus::worst() const {
  const auto least =
      std::ranges::min_element(tests, [](const OmnibusTest& a, const OmnibusTest& b) { return a.log10_p < b.log10_p; });
  return least == tests.end() ? nullptr : &*least;
}

double Omnibus::log10_limit() const {
  return std::log10(limits.family_wise / double(std::max<std::size_t>(1, tests.size())));
}

std::string reason_of(const Omnibus& omnibus) {
  const OmnibusTest& worst = *omnibus.worst();
  return fmt::format("{}: chi-square {:.1f} of {:.0f} ({}), expected by chance once in 10^{:.0f} recordings",
                     worst.what, worst.chi_square, worst.degrees, worst.family, -worst.log10_p);
}

void add_test(OmnibusTest test, Omnibus& result) {
  if (!(test.degrees > 0.0)) return;
  test.log10_p = std::log10(std::max(chi_square_tail(test.chi_square, test.degrees), 1e-300)) + std::log10(test.tries);
  result.tests.push_back(std::move(test));
}

RankedChiSquare ranked_chi_square(const MatrixXd& Q, const VectorXd& s, const VectorXd& before, double floor) {
  const double least = 1e-12 * before.maxCoeff();
  VectorXd scale = VectorXd::Zero(before.size());
  for (Eigen::Index k = 0; k < scale.size(); ++k)
    if (before[k] > least) scale[k] = 1.0 / std::sqrt(before[k]);
  const SymmetricEigen eigen = symmetric_eigen(scale.asDiagonal() * Q * scale.asDiagonal());
  const VectorXd along = eigen.vectors.transpose() * scale.cwiseProduct(s);
  RankedChiSquare result;
  for (Eigen::Index k = 0; k < along.size(); ++k) {
    if (eigen.values[k] < floor) continue;
    result.chi_square += along[k] * along[k] / eigen.values[k];
    ++result.rank;
  }
  return result;
}

void test_pieces(const CompressedRecording& recording, const Pieces& pieces, const UnderNoise& under,
                 const WeighedModel& model, Omnibus& result) {
  const Explained explained = explained_by(under, model);
  struct Look {
    const char *family, *what;
    Eigen::Index first;
    bool turns_only;
  };
  for (const Look& look : {Look{"turn", "jump at the turn that ends", 6, true},
                           Look{"rest", "bias within the rest that begins", 0, false}}) {
    OmnibusTest worst;
    double least = 2.0;
    int tries = 0;
    for (std::size_t k = 0; k < pieces.pieces.size(); ++k) {
      const Piece& piece = pieces.pieces[k];
      if (look.turns_only ? !piece.after_turn : piece.end_s - piece.begin_s < shortest_tested_s) continue;
      const PieceSystem::OfPiece of = under.system->of_piece(k);
      const auto Y = explained.Y.middleRows<6>(piece_dims * Eigen::Index(k) + look.first);
      const MatrixXd Q = of.Q.block<6, 6>(look.first, look.first) - Y * Y.transpose();
      const VectorXd s = of.s.segment<6>(look.first) - Y * explained.w;
      const RankedChiSquare ranked = ranked_chi_square(Q, s, of.before.segment<6>(look.first), limits.rank_floor);
      if (ranked.rank == 0) continue;
      ++tries;
      const double p = chi_square_tail(ranked.chi_square, ranked.rank);
      if (p >= least) continue;
      least = p;
      worst = {
          look.family,
          fmt::format("{} at {:.0f} s (step {})", look.what, piece.begin_s, recording.segments[piece.segment].step),
          ranked.chi_square, double(ranked.rank)};
    }
    worst.tries = tries;
    add_test(std::move(worst), result);
  }
}

void test_innovations(const CompressedRecording& recording, const JointResult& fit, Omnibus& result) {
  FilterSetup setup = fit.setup;
  setup.noise = fit.noise;
  setup.with_columns = false;
  setup.keep_steps = true;
  const auto pass = run_filter(recording, fit.parameters, effect_model_of(fit, recording.info.latitude_deg), setup);
  const int lags = limits.lags_s;
  std::vector<Vector3d> u;
  double taking_part = 0.0, quiet_square = 0.0, square = 0.0;
  std::vector<std::size_t> blocks;
  for (const FilterStep& step : pass.steps) {
    if (!step.observed) continue;
    const Eigen::Matrix3d S = step.S_inverse.inverse();
    const Vector3d variance = (step.C_mid.transpose() * S * step.C_mid).diagonal();
    Vector3d v = (step.C_mid.transpose() * step.nu).cwiseQuotient(variance.cwiseSqrt());
    const Block& block = recording.blocks[step.block];
    for (int axis = 0; axis < 3; ++axis) {
      if (beats(block.accel[axis], block.samples, fit.noise.accel_pulse_mps, limits.pulse_share * variance[axis]))
        v[axis] = 0.0;
      quiet_square += v[axis] * v[axis];
      v[axis] = std::clamp(v[axis], -noise_limits.outlier, noise_limits.outlier);
    }
    taking_part += double((v.array() != 0.0).count());
    square += v.squaredNorm();
    u.push_back(v);
    blocks.push_back(step.block);
  }
  VectorXd sum = VectorXd::Zero(lags), pairs = VectorXd::Zero(lags);
  for (std::size_t i = 0; i < u.size(); ++i)
    for (std::size_t lag = 1; lag <= std::size_t(lags) && lag <= i; ++lag) {
      if (blocks[i] - blocks[i - lag] != lag) continue;
      const Vector3d product = u[i].cwiseProduct(u[i - lag]);
      const Eigen::Index k = Eigen::Index(lag) - 1;
      sum[k] += product.sum();
      pairs[k] += double((product.array() != 0.0).count());
    }
  square /= std::max(1.0, taking_part);
  if (!u.empty()) result.beating_part = 1.0 - taking_part / (3.0 * double(u.size()));
  // With fewer pairs chance alone reaches the limit of the correlation.
  const double enough = std::pow(noise_limits.of_chance / noise_limits.correlation, 2);
  if (taking_part > enough) result.innovation_level = quiet_square / taking_part;
  for (int k = 0; k < limits.near_lags_s; ++k)
    if (pairs[k] > enough)
      result.innovation_correlation = std::max(result.innovation_correlation, std::abs(sum[k]) / (pairs[k] * square));
  OmnibusTest test;
  test.family = "innovations";
  test.what = "correlation of the innovations over 6 to 30 s";
  for (int k = limits.near_lags_s; k < lags; ++k)
    if (pairs[k] > limits.fewest_pairs) {
      test.chi_square += sum[k] * sum[k] / pairs[k] / limits.innovations_inflation;
      ++test.degrees;
    }
  add_test(std::move(test), result);
}

}  // namespace turncal
