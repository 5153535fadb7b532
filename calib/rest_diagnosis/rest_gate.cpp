#include "calib/rest_diagnosis/rest_gate.h"

#include <array>
#include <cmath>

namespace turncal {

using Eigen::VectorXd;

namespace {

// The same on the second recording: positive when its error falls.
double holdout_gain(const RestDiagnosisModel& m, const RestModelFit& before, const RestModelFit& after) {
  const auto system = [&](const RestModelFit& one) {
    return make_rest_system(*m.options.holdout, one.fit.parameters, m.effect_model(one), false);
  };
  const RestSystem a = system(before);
  const RestSystem b = system(after);
  const VectorXd weights = rest_weights(a, before.fit.floors);
  std::array<double, rest_kind_count> was{}, is{}, rows{};
  for (Eigen::Index k = 0; k < a.residual.size(); ++k) {
    const auto kind = static_cast<std::size_t>(a.kind[static_cast<std::size_t>(k)]);
    was[kind] += std::pow(a.residual[k] * weights[k], 2);
    is[kind] += std::pow(b.residual[k] * weights[k], 2);
    rows[kind] += 1.0;
  }
  double gain = 0.0;
  for (std::size_t k = 0; k < rest_kind_count; ++k)
    if (was[k] > 0.0 && is[k] > 0.0) gain += rows[k] * std::log(was[k] / is[k]);
  return gain;
}

}  // namespace

double mean_square(const VectorXd& residual, const VectorXd& weights) {
  double sum = 0.0;
  double count = 0.0;
  for (Eigen::Index k = 0; k < residual.size(); ++k) {
    if (std::isnan(residual[k])) continue;
    sum += std::pow(residual[k] * weights[k], 2);
    count += 1.0;
  }
  return count > 0.0 ? sum / count : 0.0;
}

bool passes_gate(const RestDiagnosisModel& m, const RestModelFit& before, const RestModelFit& after, bool first) {
  const RestSystem a = make_rest_system(m.data, before.fit.parameters, m.effect_model(before), true);
  const RestSystem b = make_rest_system(m.data, after.fit.parameters, m.effect_model(after), true);
  const VectorXd yardstick = rest_weights(a, before.fit.floors);
  VectorXd error_before = left_out_residual(a, yardstick);
  VectorXd error_after = left_out_residual(b, rest_weights(b, after.fit.floors));
  // Kind by kind, as the likelihood has it: one kind's large errors must not drown another's.
  double gain = 0.0;
  double counted = 0.0;
  for (const RestKind kind : {RestKind::norm, RestKind::direction, RestKind::gyro}) {
    VectorXd x = error_before;
    VectorXd y = error_after;
    double count = 0.0;
    for (Eigen::Index k = 0; k < x.size(); ++k) {
      const bool use = a.kind[static_cast<std::size_t>(k)] == kind && !std::isnan(x[k]) && !std::isnan(y[k]);
      if (!use) x[k] = y[k] = NAN;
      count += use ? 1.0 : 0.0;
    }
    const double was = mean_square(x, yardstick);
    const double is = mean_square(y, yardstick);
    if (count < 1.0 || !(was > 0.0) || !(is > 0.0)) continue;
    gain += count * std::log(was / is);
    counted += count;
  }
  // gain / counted: logarithm of the mean square over all kinds
  if (!(gain > (first ? 2.0 * m.options.gate_gain * counted : 0.0))) return false;
  return m.options.holdout == nullptr || !first || holdout_gain(m, before, after) > 0.0;
}

}  // namespace turncal
