#include "calib/diagnosis/lack_of_fit.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>

#include "calib/diagnosis/fit_pass.h"
#include "calib/diagnosis/holdout.h"
#include "calib/diagnosis/nameless_families.h"
#include "calib/diagnosis/segment_scores.h"
#include "calib/joint/joined_recordings.h"
#include "calib/joint/motion_step.h"
#include "calib/joint/score_algebra.h"
#include "calib/model/attitude.h"
#include "calib/statistics/distributions.h"
#include "calib/statistics/linear_algebra.h"

namespace turncal {
namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr const char* channels[] = {"gyro x",          "gyro y",          "gyro z",
                                    "accelerometer x", "accelerometer y", "accelerometer z"};

// What a bias of the pieces may go with: `count` functions of a piece.
struct Basis {
  std::string what;
  int count;
  std::function<VectorXd(const Piece&)> at;
};

double log10_chi_square_tail(double value, double degrees) {
  return std::log10(std::max(chi_square_tail(value, degrees), 1e-300));
}

// A quadratic form of normal numbers as a shifted and stretched chi2 with the same mean tr C, variance 2 tr C^2 and third cumulant
// 8 tr C^3 (Buckley and Eagleson, Austral. J. Stat. 30A (1988) 150).
void as_chi_square(double first, double second, double third, LackOfFitTest& test) {
  test.degrees = std::pow(second, 3) / (third * third);
  test.chi_square = test.degrees + (test.chi_square - first) * std::sqrt(test.degrees / second);
}

class Tester {
 public:
  Tester(const CompressedRecording& recording, double accel_pulse_mps, const LackOfFitLimits& limits, LackOfFit& result)
      : recording_(recording), accel_pulse_mps_(accel_pulse_mps), limits_(limits), result_(result) {}

  void pieces(const SegmentScores& scores, const std::string& where);
  void contrasts(const SegmentScores& scores);
  void families(const SegmentScores& scores);
  void innovations(const FilterResult& pass);
  void add(LackOfFitTest test);
  const LackOfFitLimits& limits() const { return limits_; }

 private:
  void sum_and_worst(const std::string& family, const std::string& what, const SegmentScores& scores,
                     const std::vector<int>& dims, bool turns_only);

  const CompressedRecording& recording_;
  const double accel_pulse_mps_;
  const LackOfFitLimits& limits_;
  LackOfFit& result_;
};

void Tester::add(LackOfFitTest test) {
  test.log10_p = log10_chi_square_tail(test.chi_square / test.inflation, test.degrees) + std::log10(test.tries);
  result_.tests.push_back(std::move(test));
}

void Tester::sum_and_worst(const std::string& family, const std::string& what, const SegmentScores& scores,
                           const std::vector<int>& dims, bool turns_only) {
  LackOfFitTest sum, worst;
  double least = 1.0;
  int tries = 0;
  std::vector<SegmentScores::Whitened> whitened;
  for (std::size_t k = 0; k < scores.pieces().size(); ++k) {
    const Piece& piece = scores.pieces()[k];
    if (turns_only && !piece.after_turn) continue;
    const SegmentScores::Test test = scores.test(k, dims);
    const RankedChiSquare ranked = ranked_chi_square(test, limits_.rank_floor);
    if (ranked.rank == 0) continue;
    ++tries;
    sum.chi_square += ranked.chi_square;
    whitened.push_back({k, ranked.whiten});
    const double p = log10_chi_square_tail(ranked.chi_square, ranked.rank);
    if (p >= least) continue;
    least = p;
    worst.chi_square = ranked.chi_square;
    worst.degrees = ranked.rank;
    char text[160];
    std::snprintf(text, sizeof text, "%s at %.0f s (step %d)", what.c_str(), piece.begin_s,
                  recording_.segments[piece.segment].step);
    worst.what = text;
    worst.shift = test.shift * ranked.estimate;
  }
  if (tries == 0) return;
  sum.family = family + ", all";
  sum.what = what + ", all together";
  // Pieces share the heading and the parameters, so the sum spreads more than chi2 does and its tail is longer.
  const auto [first, second, third] = scores.traces(dims, whitened);
  as_chi_square(first, second, third, sum);
  worst.family = family + ", worst";
  worst.tries = tries;
  add(std::move(sum));
  add(std::move(worst));
}

void Tester::pieces(const SegmentScores& scores, const std::string& where) {
  sum_and_worst(where + "turn", "jump at the turn that ends", scores, jump_dims, true);
  sum_and_worst(where + "rest", "bias within the rest that begins", scores, bias_dims, false);
}

void Tester::contrasts(const SegmentScores& scores) {
  const std::vector<Piece>& pieces = scores.pieces();
  const double length = pieces.empty() ? 1.0 : pieces.back().end_s;
  const auto up_of = [](const Piece& p) -> Vector3d { return p.C_nb.row(1).transpose(); };
  const std::vector<Basis> bases = {{"orientation", 19,
                                     [&](const Piece& p) {
                                       const Vector3d u = up_of(p);
                                       VectorXd v(19);
                                       v << u, u.x() * u.x(), u.y() * u.y(), u.x() * u.y(), u.x() * u.z(),
                                           u.y() * u.z(), u.x() * u.x() * u.x(), u.y() * u.y() * u.y(),
                                           u.z() * u.z() * u.z(), u.x() * u.x() * u.y(), u.x() * u.x() * u.z(),
                                           u.y() * u.y() * u.x(), u.y() * u.y() * u.z(), u.x() * u.y() * u.z(),
                                           p.C_nb.row(0).transpose();
                                       return v;
                                     }},
                                    {"time", 8,
                                     [&](const Piece& p) {
                                       VectorXd v(8);
                                       const double phase = pi * 0.5 * (p.begin_s + p.end_s) / length;
                                       for (int k = 1; k <= 8; ++k) v[k - 1] = std::cos(k * phase);
                                       return v;
                                     }},
                                    {"after turns", 4,
                                     [&](const Piece& p) {
                                       VectorXd v = VectorXd::Zero(4);
                                       if (p.after_turn) v << 1.0, up_of(p);
                                       return v;
                                     }},
                                    {"temperature", 2, [&](const Piece& p) {
                                       VectorXd v(2);
                                       v << p.temperature_c, p.temperature_c * p.temperature_c;
                                       return v;
                                     }}};
  std::vector<LackOfFitTest> contrasts;
  std::vector<Weights> weights;
  const auto contrast = [&](const std::string& family, const std::string& what, int count, auto write) {
    contrasts.emplace_back();
    contrasts.back().family = family;
    contrasts.back().what = what;
    weights.push_back({count, [=](const Piece& p) {
                         Weights::Part part;
                         part.of.setZero(piece_dims, count);
                         write(p, part.of);
                         return part;
                       }});
  };
  using Of = Eigen::Matrix<double, piece_dims, Eigen::Dynamic>;
  for (const Basis& basis : bases)
    for (int channel = 0; channel < 6; ++channel)
      contrast(basis.what, std::string("bias of ") + channels[channel] + " with " + basis.what, basis.count,
               [=](const Piece& p, Of& of) { of.row(channel) = basis.at(p).transpose(); });
  constexpr int waves = 6;
  for (int axis = 0; axis < 3; ++axis) {
    const std::string of = "scale factor of ";
    contrast("scale with time", of + channels[3 + axis] + " with time", waves, [=](const Piece& p, Of& part) {
      for (int k = 0; k < waves; ++k)
        part(3 + axis, k) = up_of(p)[axis] * std::cos((k + 1) * pi * 0.5 * (p.begin_s + p.end_s) / length);
    });
    contrast("scale with time", of + channels[axis] + " with time", waves, [=](const Piece& p, Of& part) {
      for (int k = 0; k < waves; ++k) {
        const double wave = std::cos(pi * (k + 1) * p.begin_s / length);
        part.block<3, 1>(6, k) = p.turned().col(axis) * wave;
        part.block<3, 1>(9, k) = p.fallen().col(axis) * wave;
      }
    });
  }
  const std::vector<SegmentScores::Test> tests = scores.tests(weights);
  for (std::size_t k = 0; k < contrasts.size(); ++k) {
    const RankedChiSquare ranked = ranked_chi_square(tests[k], limits_.rank_floor);
    if (ranked.rank == 0 || !std::isfinite(ranked.chi_square)) continue;
    LackOfFitTest& t = contrasts[k];
    t.chi_square = ranked.chi_square;
    t.degrees = ranked.rank;
    t.shift = tests[k].shift * ranked.estimate;
    add(std::move(t));
  }
}

void Tester::families(const SegmentScores& scores) {
  const std::vector<Family> families = nameless_families(scores.pieces());
  std::vector<FamilyFit> fits = fit_families(scores, families);
  for (std::size_t k = 0; k < families.size(); ++k) {
    FamilyFit& fit = fits[k];
    if (!(fit.weights.size() > 0 && fit.weights.sum() > 0.0)) continue;
    LackOfFitTest test;
    test.family = families[k].kind;
    test.what = families[k].what;
    test.chi_square = fit.statistic;
    as_chi_square(fit.weights.sum(), fit.weights.squaredNorm(), fit.weights.array().cube().sum(), test);
    test.shift = fit.shift;
    add(std::move(test));
  }
}

// Is the variance of the mean velocity by the beat of an accelerometer's pulses above `limit`? A count close to p / q of a pulse a sample
// leaves a sawtooth of 1 / q of a pulse that lasts for seconds; a twelfth of its square is the most that it can be.
bool beats(double counts, int samples, double pulse, double limit) {
  constexpr int finest = 16;
  for (int q = 1; q <= finest && std::pow(pulse / q, 2) > 12.0 * limit; ++q)
    if (quantisation_variance(q * counts, samples, pulse / q) > limit) return true;
  return false;
}

// Correlation of the innovations at lags of 1 .. n seconds, each with variance 1 / pairs. On body axes: seconds in which an
// accelerometer's pulses beat do not take part, for their error is not white.
void Tester::innovations(const FilterResult& pass) {
  const int lags = limits_.lags_s;
  std::vector<Vector3d> u;
  double taking_part = 0.0;
  std::vector<std::size_t> blocks;
  for (const FilterStep& step : pass.steps) {
    if (!step.observed) continue;
    const Matrix3d S = step.S_inverse.inverse();
    const Vector3d variance = (step.C_mid.transpose() * S * step.C_mid).diagonal();
    Vector3d v = (step.C_mid.transpose() * step.nu).cwiseQuotient(variance.cwiseSqrt());
    const Block& block = recording_.blocks[step.block];
    for (int axis = 0; axis < 3; ++axis) {
      v[axis] = std::clamp(v[axis], -noise_limits.outlier, noise_limits.outlier);
      if (beats(block.accel[axis], block.samples, accel_pulse_mps_, limits_.pulse_share * variance[axis]))
        v[axis] = 0.0;
    }
    taking_part += static_cast<double>((v.array() != 0.0).count());
    u.push_back(v);
    blocks.push_back(step.block);
  }
  VectorXd sum = VectorXd::Zero(lags), pairs = VectorXd::Zero(lags);
  for (std::size_t i = 0; i < u.size(); ++i)
    for (std::size_t lag = 1; lag <= static_cast<std::size_t>(lags) && lag <= i; ++lag) {
      if (blocks[i] - blocks[i - lag] != lag) continue;
      const Vector3d product = u[i].cwiseProduct(u[i - lag]);
      const Eigen::Index k = static_cast<Eigen::Index>(lag) - 1;
      sum[k] += product.sum();
      pairs[k] += static_cast<double>((product.array() != 0.0).count());
    }
  double square = 0.0;
  for (const Vector3d& v : u) square += v.squaredNorm();
  square /= std::max(1.0, taking_part);
  for (int k = 0; k < limits_.near_lags_s; ++k)
    if (pairs[k] > limits_.fewest_pairs)
      result_.innovation_correlation = std::max(result_.innovation_correlation, std::abs(sum[k]) / (pairs[k] * square));
  LackOfFitTest test;
  test.family = "innovations";
  test.what = "correlation of the innovations over 6 to 30 s";
  test.inflation = limits_.innovations_inflation;
  for (int k = limits_.near_lags_s; k < lags; ++k)
    if (pairs[k] > limits_.fewest_pairs) {
      test.chi_square += sum[k] * sum[k] / pairs[k];
      ++test.degrees;
    }
  if (test.degrees > 0) add(std::move(test));
}

// How far chi2 falls when it is minimised over the parameters, c' A^-1 c, and along how many directions.
struct Fall {
  double chi_square = 0.0;
  int rank = 0;
};
Fall fall_of(const MatrixXd& A, const VectorXd& c, const LackOfFitLimits& limits) {
  const VectorXd scale = A.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  const SymmetricEigen eigen = symmetric_eigen(scale.asDiagonal() * A * scale.asDiagonal());
  const VectorXd along = eigen.vectors.transpose() * scale.cwiseProduct(c);
  Fall fall;
  for (Eigen::Index k = 0; k < along.size(); ++k) {
    if (eigen.values[k] < limits.open_direction) continue;
    fall.chi_square += along[k] * along[k] / eigen.values[k];
    ++fall.rank;
  }
  return fall;
}

// Of several recordings fitted together: what chi2 falls by when each has all its parameters for itself, as in several_recordings.h.
void test_recordings(const FitPass& pass, const JointResult& fit, Tester& tester) {
  struct Part {
    MatrixXd A;
    VectorXd c;
  };
  const auto n = static_cast<Eigen::Index>(pass.columns.size());
  const Part nothing = {MatrixXd::Zero(n, n), VectorXd::Zero(n)};
  std::vector<Part> parts = {nothing};
  for (const FilterStep& step : pass.filter.steps) {
    if (step.begins_recording) parts.push_back(nothing);
    if (!step.observed) continue;
    const MatrixXd N = step.N(pass.columns, Eigen::all);
    parts.back().A += N * step.S_inverse * N.transpose();
    parts.back().c += N * step.S_inverse * step.nu;
  }
  if (parts.size() < 2) return;
  std::vector<int> own;  // places in pass.columns: one recording alone has its biases, and no turn-on besides
  for (int k = 0; k < n; ++k)
    if (const int column = pass.columns[static_cast<std::size_t>(k)] - parameter_count;
        column < 0 || !is_turn_on(fit.effects[static_cast<std::size_t>(column)].column))
      own.push_back(k);
  Part all = nothing;
  LackOfFitTest test;
  test.family = "recordings, parameters";
  test.what = "parameters of the recordings against each other";
  for (const Part& part : parts) {
    const Fall alone = fall_of(part.A(own, own), part.c(own), tester.limits());
    test.chi_square += alone.chi_square;
    test.degrees += alone.rank;
    all.A += part.A;
    all.c += part.c;
  }
  const Fall together = fall_of(all.A, all.c, tester.limits());
  test.chi_square -= together.chi_square;
  test.degrees -= together.rank;
  if (test.degrees > 0) tester.add(std::move(test));
}

// The holdout with the fit as a prior, its six biases free.
void test_holdout(const CompressedRecording& holdout, const std::string& name, const JointResult& fit,
                  const NoiseModel& noise, const MatrixXd& information, const std::vector<int>& columns,
                  Tester& tester) {
  const FilterSetup setup = holdout_setup(holdout, fit, noise);
  const FitPass pass = run_fit_pass(holdout, fit, setup);
  // Information of the fit on everything but the six biases: they are eliminated from it.
  const int n = static_cast<int>(columns.size());
  std::vector<int> biases, others;
  for (int k = 0; k < n; ++k) {
    const int column = columns[static_cast<std::size_t>(k)];
    const bool own =
        column < 6 || (column >= parameter_count &&
                       fit.effects[static_cast<std::size_t>(column - parameter_count)].column.entry->of_one_run);
    (own ? biases : others).push_back(k);
  }
  MatrixXd prior = MatrixXd::Zero(n, n);
  const MatrixXd cross = information(biases, others);
  const MatrixXd kept =
      information(others, others) - cross.transpose() * solve_symmetric(information(biases, biases), cross);
  prior(others, others) = kept;
  const SegmentScores scores(pass.recording, pass.filter, pass.columns, fit.reference_temperature_c, tester.limits(),
                             prior);
  tester.pieces(scores, name + ", ");
  // What the holdout says of the parameters that it shares with the fit, against what the fit says: what chi2 falls by alone, less what
  // it falls by with what the fit knows added, A + P.
  const MatrixXd A = pass.filter.information(pass.columns, pass.columns);
  const VectorXd c = pass.filter.gradient(pass.columns);
  LackOfFitTest agreement;
  agreement.family = name + ", parameters";
  agreement.what = "parameters of the " + name + " against those of the fit";
  const Fall alone = fall_of(A, c, tester.limits());
  const Fall with_fit = fall_of(A + prior, c, tester.limits());
  agreement.chi_square = alone.chi_square - with_fit.chi_square;
  const auto free = std::count_if(biases.begin(), biases.end(), [&](int k) { return A(k, k) > 0.0; });
  agreement.degrees = alone.rank - static_cast<int>(free);
  if (agreement.degrees > 0) tester.add(std::move(agreement));
  // What is left then. A parameter that the fit leaves wide may be elsewhere in the holdout at no cost.
  LackOfFitTest level;
  level.family = name + ", level";
  level.what = "error on the " + name;
  level.chi_square = pass.filter.chi_square - with_fit.chi_square;
  level.degrees = static_cast<double>(pass.filter.observations) - static_cast<double>(free);
  level.inflation = std::pow(GateLimits{}.highest_error, 2);
  if (level.degrees > 0) tester.add(std::move(level));
}

LackOfFit tests_at(const CompressedRecording& recording, const JointResult& fit, const NoiseModel& noise,
                   const std::vector<const CompressedRecording*>& holdouts, const LackOfFitLimits& limits) {
  LackOfFit result;
  FilterSetup setup = fit.setup;
  setup.noise = noise;
  const FitPass pass = run_fit_pass(recording, fit, setup);
  const SegmentScores scores(pass.recording, pass.filter, pass.columns, fit.reference_temperature_c, limits);
  if (scores.pieces().empty()) return result;
  Tester tester(recording, noise.accel_pulse_mps, limits, result);
  tester.pieces(scores, "");
  tester.contrasts(scores);
  tester.families(scores);
  test_recordings(pass, fit, tester);
  FilterSetup seconds = setup;
  seconds.with_columns = false;
  seconds.keep_steps = true;
  tester.innovations(run_filter(recording, fit.parameters, effect_model_of(fit, recording.info.latitude_deg), seconds));
  for (std::size_t k = 0; k < holdouts.size(); ++k)
    test_holdout(*holdouts[k], holdouts.size() == 1 ? "holdout" : "holdout " + std::to_string(k + 1), fit, noise,
                 pass.filter.information(pass.columns, pass.columns), pass.columns, tester);
  return result;
}

}  // namespace

LackOfFit test_lack_of_fit(const CompressedRecording& recording, const JointResult& fit,
                           const std::vector<const CompressedRecording*>& holdouts, const LackOfFitLimits& limits) {
  LackOfFit result = tests_at(recording, fit, fit.noise, holdouts, limits);
  if (result.tests.empty()) return result;
  const double tests = static_cast<double>(result.tests.size());
  const double near = std::log10(SelectionLimits{}.near_family_wise / tests);
  const bool any_near = std::any_of(result.tests.begin(), result.tests.end(),
                                    [near](const LackOfFitTest& t) { return t.log10_p < near; });
  // A slow noise can only take from what a test says: where none is near its limit there is nothing to take.
  if (any_near && fit.noise.has_bias_instability()) {
    NoiseModel slow = fit.noise;
    slow.bias_correlation_s = limits.slow_correlation_s;
    LackOfFit with_slow = tests_at(recording, fit, slow, holdouts, limits);
    for (LackOfFitTest& beside : with_slow.tests) {
      const auto same = std::find_if(result.tests.begin(), result.tests.end(), [&](const LackOfFitTest& t) {
        return t.family == beside.family && (t.tries > 1.0 || t.what == beside.what);
      });
      if (same != result.tests.end() && beside.log10_p > same->log10_p) *same = std::move(beside);
    }
  }
  for (const LackOfFitTest& test : result.tests)
    if (result.worst.family.empty() || test.log10_p < result.worst.log10_p) result.worst = test;
  result.log10_limit = std::log10(limits.family_wise / tests);
  result.passed = result.worst.log10_p > result.log10_limit;
  return result;
}

}  // namespace turncal
