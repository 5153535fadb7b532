#include "calib/diagnosis/lack_of_fit.h"

#include <algorithm>
#include <cmath>

#include <Eigen/LU>

#include "calib/diagnosis/holdout.h"
#include "calib/diagnosis/lack_of_fit_tests.h"
#include "calib/joint/coarser_recording.h"
#include "calib/joint/linear_motion.h"
#include "calib/statistics/distributions.h"

namespace turncal {
namespace {

// Is the variance of the mean velocity by the beat of an accelerometer's pulses above `limit`? A count close to p / q of a pulse a sample
// leaves a sawtooth of 1 / q of a pulse that lasts for seconds; a twelfth of its square is the most that it can be.
bool beats(double counts, int samples, double pulse, double limit) {
  constexpr int finest = 16;
  for (int q = 1; q <= finest && std::pow(pulse / q, 2) > 12.0 * limit; ++q)
    if (quantisation_variance(q * counts, samples, pulse / q) > limit) return true;
  return false;
}

// Correlation of the innovations over 6 to 30 s, each lag with variance 1 / pairs; and the largest at 1 to 5 s. On body axes: seconds in which
// an accelerometer's pulses beat do not take part, for their error is not white. `pass`: with steps, of every second.
void test_innovations(const CompressedRecording& recording, const FilterResult& pass, double accel_pulse_mps,
                      const LackOfFitLimits& limits, LackOfFit& result) {
  const int lags = limits.lags_s;
  std::vector<Eigen::Vector3d> u;
  double taking_part = 0.0, quiet_square = 0.0;
  std::vector<std::size_t> blocks;
  for (const FilterStep& step : pass.steps) {
    if (!step.observed) continue;
    const Eigen::Matrix3d S = step.S_inverse.inverse();
    const Eigen::Vector3d variance = (step.C_mid.transpose() * S * step.C_mid).diagonal();
    Eigen::Vector3d v = (step.C_mid.transpose() * step.nu).cwiseQuotient(variance.cwiseSqrt());
    const Block& block = recording.blocks[step.block];
    for (int axis = 0; axis < 3; ++axis) {
      if (beats(block.accel[axis], block.samples, accel_pulse_mps, limits.pulse_share * variance[axis])) v[axis] = 0.0;
      quiet_square += v[axis] * v[axis];
      v[axis] = std::clamp(v[axis], -noise_limits.outlier, noise_limits.outlier);
    }
    taking_part += static_cast<double>((v.array() != 0.0).count());
    u.push_back(v);
    blocks.push_back(step.block);
  }
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(lags), pairs = Eigen::VectorXd::Zero(lags);
  for (std::size_t i = 0; i < u.size(); ++i)
    for (std::size_t lag = 1; lag <= static_cast<std::size_t>(lags) && lag <= i; ++lag) {
      if (blocks[i] - blocks[i - lag] != lag) continue;
      const Eigen::Vector3d product = u[i].cwiseProduct(u[i - lag]);
      const Eigen::Index k = static_cast<Eigen::Index>(lag) - 1;
      sum[k] += product.sum();
      pairs[k] += static_cast<double>((product.array() != 0.0).count());
    }
  double square = 0.0;
  for (const Eigen::Vector3d& v : u) square += v.squaredNorm();
  square /= std::max(1.0, taking_part);
  if (!u.empty()) result.beating_part = 1.0 - taking_part / (3.0 * static_cast<double>(u.size()));
  // Fewer pairs reach the limit of the correlation by chance.
  const double enough = std::pow(noise_limits.of_chance / noise_limits.correlation, 2);
  if (taking_part > enough) result.innovation_level = quiet_square / taking_part;
  for (int k = 0; k < limits.near_lags_s; ++k)
    if (pairs[k] > enough)
      result.innovation_correlation = std::max(result.innovation_correlation, std::abs(sum[k]) / (pairs[k] * square));
  LackOfFitTest test;
  test.family = "innovations";
  test.what = "correlation of the innovations over 6 to 30 s";
  test.inflation = limits.innovations_inflation;
  for (int k = limits.near_lags_s; k < lags; ++k)
    if (pairs[k] > limits.fewest_pairs) {
      test.chi_square += sum[k] * sum[k] / pairs[k];
      ++test.degrees;
    }
  add_test(std::move(test), result);
}

LackOfFit tests_at(const CompressedRecording& recording, const JointResult& fit, const NoiseModel& noise,
                   const std::vector<const CompressedRecording*>& holdouts, const LackOfFitLimits& limits) {
  LackOfFit result;
  FilterSetup setup = fit.setup;
  setup.noise = noise;
  const FitPass pass = run_fit_pass(recording, fit, setup);
  const SegmentScores scores(pass.recording, pass.filter, pass.columns, fit.reference_temperature_c, limits);
  if (scores.pieces().empty()) return result;
  test_pieces(scores, recording, "", limits, result);
  test_contrasts(scores, limits, result);
  test_families(scores, result);
  test_recordings(pass, fit.ranges, result);
  FilterSetup seconds = setup;
  seconds.with_columns = false;
  seconds.keep_steps = true;
  test_innovations(recording,
                   run_filter(recording, fit.parameters, effect_model_of(fit, recording.info.latitude_deg), seconds),
                   noise.accel_pulse_mps, limits, result);
  for (std::size_t k = 0; k < holdouts.size(); ++k)
    test_holdout(*holdouts[k], holdouts.size() == 1 ? "holdout" : "holdout " + std::to_string(k + 1), fit, noise, pass,
                 limits, result);
  return result;
}

}  // namespace

FitPass run_fit_pass(const CompressedRecording& recording, const JointResult& fit, const FilterSetup& given) {
  FilterSetup setup = given;
  setup.with_columns = setup.keep_steps = true;
  setup.narrow_columns = 0;
  const EffectModel model = effect_model_of(fit, recording.info.latitude_deg);
  FitPass pass;
  pass.recording = coarser(recording, coarseness_of_scores, setup);
  pass.filter = run_filter(pass.recording, fit.parameters, model, setup);
  for (int k = 0; k < parameter_count; ++k)
    if (parameter_is_free[static_cast<std::size_t>(k)]) pass.columns.push_back(k);
  for (int k = 0; k < model.columns; ++k) pass.columns.push_back(parameter_count + k);
  return pass;
}

void add_test(LackOfFitTest test, LackOfFit& result) {
  if (!(test.degrees > 0.0)) return;
  const double p = chi_square_tail(test.chi_square / test.inflation, test.degrees);
  test.log10_p = std::log10(std::max(p, 1e-300)) + std::log10(test.tries);
  result.tests.push_back(std::move(test));
}

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
