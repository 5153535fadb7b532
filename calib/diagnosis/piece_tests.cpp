#include "calib/diagnosis/lack_of_fit_tests.h"

#include <cmath>
#include <cstdio>
#include <functional>

#include "calib/diagnosis/nameless_families.h"
#include "calib/model/parameters.h"
#include "calib/statistics/data_screen.h"
#include "calib/statistics/distributions.h"

namespace turncal {
namespace {

using Eigen::Vector3d;
using Eigen::VectorXd;

// A quadratic form of normal numbers as a shifted and stretched chi2 with the same mean tr C, variance 2 tr C^2 and third cumulant
// 8 tr C^3 (Buckley and Eagleson, Austral. J. Stat. 30A (1988) 150).
void as_chi_square(double first, double second, double third, LackOfFitTest& test) {
  test.degrees = std::pow(second, 3) / (third * third);
  test.chi_square = test.degrees + (test.chi_square - first) * std::sqrt(test.degrees / second);
}

void sum_and_worst(const std::string& family, const std::string& what, const SegmentScores& scores,
                   const CompressedRecording& recording, const std::vector<int>& dims, bool turns_only,
                   const LackOfFitLimits& limits, LackOfFit& result) {
  LackOfFitTest sum, worst;
  double least = 2.0;
  int tries = 0;
  std::vector<SegmentScores::Whitened> whitened;
  for (std::size_t k = 0; k < scores.pieces().size(); ++k) {
    const Piece& piece = scores.pieces()[k];
    if (turns_only && !piece.after_turn) continue;
    const SegmentScores::Test test = scores.test(k, dims);
    const RankedChiSquare ranked = ranked_chi_square(test, limits.rank_floor);
    if (ranked.rank == 0) continue;
    ++tries;
    sum.chi_square += ranked.chi_square;
    sum.degrees += ranked.rank;
    whitened.push_back({k, ranked.whiten});
    const double p = chi_square_tail(ranked.chi_square, ranked.rank);
    if (p >= least) continue;
    least = p;
    worst.chi_square = ranked.chi_square;
    worst.degrees = ranked.rank;
    char text[160];
    std::snprintf(text, sizeof text, "%s at %.0f s (step %d)", what.c_str(), piece.begin_s,
                  recording.segments[piece.segment].step);
    worst.what = text;
    worst.shift = test.shift * ranked.estimate;
  }
  if (tries == 0) return;
  sum.family = family + ", all";
  sum.what = what + ", all together";
  // Pieces share the heading and the parameters, so the sum spreads more than chi2 does and its tail is longer: as chi2 it looks less
  // likely than it is. Where even that is nothing special it is left at that.
  if (chi_square_tail(sum.chi_square, sum.degrees) < limits.worth_a_look) {
    const auto [first, second, third] = scores.traces(dims, whitened);
    as_chi_square(first, second, third, sum);
  }
  worst.family = family + ", worst";
  worst.tries = tries;
  add_test(std::move(sum), result);
  add_test(std::move(worst), result);
}

Vector3d up_of(const Piece& p) { return p.C_nb.row(1).transpose(); }

// What a bias or a scale factor of one sensor may go with: `count` functions of a piece, and what they do in it.
using Of = Eigen::Matrix<double, piece_dims, Eigen::Dynamic>;
Family contrast(const std::string& kind, const std::string& what, int count,
                std::function<void(const Piece&, Of&)> write) {
  Family family;
  family.kind = kind;
  family.what = what;
  family.weights.columns = count;
  family.weights.at = [count, write = std::move(write)](const Piece& p) {
    Weights::Part part;
    part.of.setZero(piece_dims, count);
    write(p, part.of);
    return part;
  };
  return family;
}

std::vector<Family> biases_with(const std::string& kind, int count, std::function<VectorXd(const Piece&)> at) {
  std::vector<Family> all;
  for (int channel = 0; channel < 6; ++channel)
    all.push_back(contrast(kind,
                           std::string("bias of ") + channel_names[static_cast<std::size_t>(channel)] + " with " + kind,
                           count, [=](const Piece& p, Of& of) { of.row(channel) = at(p).transpose(); }));
  return all;
}

// Of a run so long.
std::vector<Family> contrasts_over(double length_s) {
  std::vector<Family> all = biases_with("orientation", 19, [](const Piece& p) {
    const Vector3d u = up_of(p);
    VectorXd v(19);
    v << u, u.x() * u.x(), u.y() * u.y(), u.x() * u.y(), u.x() * u.z(), u.y() * u.z(), u.x() * u.x() * u.x(),
        u.y() * u.y() * u.y(), u.z() * u.z() * u.z(), u.x() * u.x() * u.y(), u.x() * u.x() * u.z(),
        u.y() * u.y() * u.x(), u.y() * u.y() * u.z(), u.x() * u.y() * u.z(), p.C_nb.row(0).transpose();
    return v;
  });
  const auto add = [&all](std::vector<Family> more) { all.insert(all.end(), more.begin(), more.end()); };
  const auto cosines = [length_s](int count, double at_s) -> VectorXd {
    return (VectorXd::LinSpaced(count, 1.0, count) * (pi * at_s / length_s)).array().cos();
  };
  const auto middle_s = [](const Piece& p) { return 0.5 * (p.begin_s + p.end_s); };
  add(biases_with("time", 8, [=](const Piece& p) { return cosines(8, middle_s(p)); }));
  add(biases_with("after turns", 4, [](const Piece& p) {
    VectorXd v = VectorXd::Zero(4);
    if (p.after_turn) v << 1.0, up_of(p);
    return v;
  }));
  add(biases_with("temperature", 2, [](const Piece& p) -> VectorXd {
    return Eigen::Vector2d(p.temperature_c, p.temperature_c * p.temperature_c);
  }));
  constexpr int waves = 6;
  const std::string kind = "scale with time", of = "scale factor of ";
  for (int axis = 0; axis < 3; ++axis) {
    all.push_back(contrast(kind, of + channel_names[static_cast<std::size_t>(3 + axis)] + " with time", waves,
                           [=](const Piece& p, Of& part) {
                             part.row(3 + axis) = up_of(p)[axis] * cosines(waves, middle_s(p)).transpose();
                           }));
    all.push_back(contrast(kind, of + channel_names[static_cast<std::size_t>(axis)] + " with time", waves,
                           [=](const Piece& p, Of& part) {
                             const VectorXd wave = cosines(waves, p.begin_s);
                             part.middleRows<3>(6) = p.turned().col(axis) * wave.transpose();
                             part.middleRows<3>(9) = p.fallen().col(axis) * wave.transpose();
                           }));
  }
  return all;
}

}  // namespace

void test_pieces(const SegmentScores& scores, const CompressedRecording& recording, const std::string& where,
                 const LackOfFitLimits& limits, LackOfFit& result) {
  sum_and_worst(where + "turn", "jump at the turn that ends", scores, recording, jump_dims, true, limits, result);
  sum_and_worst(where + "rest", "bias within the rest that begins", scores, recording, bias_dims, false, limits,
                result);
}

void test_contrasts(const SegmentScores& scores, const LackOfFitLimits& limits, LackOfFit& result) {
  if (scores.pieces().empty()) return;
  const std::vector<Family> contrasts = contrasts_over(scores.pieces().back().end_s);
  std::vector<Weights> weights;
  for (const Family& c : contrasts) weights.push_back(c.weights);
  const std::vector<SegmentScores::Test> tests = scores.tests(weights);
  for (std::size_t k = 0; k < contrasts.size(); ++k) {
    const RankedChiSquare ranked = ranked_chi_square(tests[k], limits.rank_floor);
    if (ranked.rank == 0 || !std::isfinite(ranked.chi_square)) continue;
    add_test({.family = contrasts[k].kind,
              .what = contrasts[k].what,
              .chi_square = ranked.chi_square,
              .degrees = static_cast<double>(ranked.rank),
              .shift = tests[k].shift * ranked.estimate},
             result);
  }
}

void test_families(const SegmentScores& scores, LackOfFit& result) {
  const std::vector<Family> families = nameless_families(scores.pieces());
  const std::vector<FamilyFit> fits = fit_families(scores, families);
  result.unseen = unseen_scatter(scores, families);
  for (std::size_t k = 0; k < families.size(); ++k) {
    const FamilyFit& fit = fits[k];
    if (!(fit.weights.size() > 0 && fit.weights.sum() > 0.0)) continue;
    LackOfFitTest test = {
        .family = families[k].kind, .what = families[k].what, .chi_square = fit.statistic, .shift = fit.shift};
    as_chi_square(fit.weights.sum(), fit.weights.squaredNorm(), fit.weights.array().cube().sum(), test);
    add_test(std::move(test), result);
  }
}

}  // namespace turncal
