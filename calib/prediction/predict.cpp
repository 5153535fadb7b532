#include "calib/prediction/predict.h"

#include <cmath>
#include <limits>
#include <numeric>

#include "calib/evidence/diagnosis.h"
#include "calib/joint/score_algebra.h"
#include "calib/statistics/numerics.h"

namespace turncal {
namespace {

constexpr SelectionLimits limits;

// Components of one effect with one time constant.
struct Group {
  std::string_view name;
  double tau_s = 0.0;
  std::vector<int> members;  // into the candidates
  std::vector<int> seen;     // those that the base does not absorb
};
std::vector<Group> groups_of(const std::vector<EffectColumn>& columns) {
  std::vector<Group> groups;
  for (int k = 0; k < int(columns.size()); ++k) {
    const EffectColumn& column = columns[k];
    if (groups.empty() || groups.back().name != column.entry->name || groups.back().tau_s != column.tau_s)
      groups.push_back({column.entry->name, column.tau_s, {}, {}});
    groups.back().members.push_back(k);
    groups.back().seen.push_back(k);
  }
  return groups;
}

void predict_effects(const JointResult& estimate, const std::vector<EffectColumn>& columns, Prediction& prediction) {
  std::vector<int> candidates(columns.size());
  std::iota(candidates.begin(), candidates.end(), parameter_count);
  const Scores scores = eliminate(estimate.last.information, estimate.last.gradient, estimate.free, candidates);
  std::vector<Group> groups = groups_of(columns);
  for (Group& group : groups) std::erase_if(group.seen, [&](int k) { return !is_visible(scores, k); });
  const auto imitated = [&](int k, std::vector<int> by) {
    std::erase(by, k);
    return !by.empty() && multiple_correlation(scores, k, by) > limits.alias_correlation;
  };
  for (const Group& own : groups) {
    for (const int k : own.members) {
      PredictedEffect effect;
      effect.column = columns[k];
      effect.sigma = is_visible(scores, k) ? 1.0 / std::sqrt(scores.Q(k, k)) : std::numeric_limits<double>::infinity();
      effect.detectable = limits.caught_at * effect.sigma;
      effect.visible = effect.detectable <= absurd_magnitude(*effect.column.entry);
      if (effect.visible) {
        effect.among_its_own = imitated(k, own.seen);
        for (const Group& other : groups) {
          const bool named = !effect.aliases.empty() && effect.aliases.back() == other.name;
          if (other.name != own.name && !named && imitated(k, other.seen)) effect.aliases.emplace_back(other.name);
        }
      }
      prediction.effects.push_back(std::move(effect));
    }
  }
}

// A prediction estimates no effects: all free columns are of the 24.
ParameterCovariance covariance_of(const Prediction& prediction) {
  ParameterCovariance covariance = ParameterCovariance::Zero();
  covariance(prediction.free, prediction.free) = prediction.covariance;
  return covariance;
}

}  // namespace

Parameters typical_unit(const RecordingInfo& info) {
  Parameters unit = start_parameters(info);
  unit.A0_g = {0.003, -0.002, 0.004};
  return unit;
}

Prediction predict(const RecordingInfo& info, const PlannedMotion& motion, const PredictOptions& options) {
  const Parameters unit = options.unit.value_or(typical_unit(info));
  const CompressedRecording recording = planned_recording(info, motion, unit, options.temperature);
  JointOptions estimate;
  estimate.start = unit;
  estimate.noise = options.noise;
  estimate.noise->gyro_pulse_rad = info.gyro_increment == IncrementKind::pulses ? unit.n(0, 0) * rad_per_arcsec : 0.0;
  estimate.noise->accel_pulse_mps = info.accel_increment == IncrementKind::pulses ? info.accel_pulse_mps : 0.0;
  estimate.look_for_faults = false;
  if (options.effects) estimate.candidates = catalogue_columns(recording.info);
  const JointResult result = joint_estimate(recording, estimate);

  Prediction prediction;
  prediction.message = result.message;
  prediction.valid = result.converged;
  prediction.samples = recording.samples;
  for (const Block& block : recording.blocks)
    if (block.whole_second) prediction.static_s += block.duration_s;
  prediction.sigma = result.sigma;
  prediction.free = result.free;
  prediction.covariance = result.covariance;
  prediction.determined = result.determined;
  prediction.undetermined = result.undetermined;
  if (options.effects) predict_effects(result, estimate.candidates, prediction);
  return prediction;
}

ParameterVector shrunk_by(const PlannedMotion& motion, const JointResult& fit, const RecordingInfo& info) {
  JointOptions options;
  options.start = fit.parameters, options.noise = fit.noise;
  options.look_for_faults = false;
  const CompressedRecording planned = planned_recording(info, motion, fit.parameters);
  const Eigen::MatrixXd known = fit.last.information(fit.free, fit.free),
                        both = known + joint_estimate(planned, options).last.information(fit.free, fit.free);
  ParameterVector shrunk = ParameterVector::Ones();
  shrunk(fit.free) = (balanced_inverse(both).diagonal().array() / balanced_inverse(known).diagonal().array()).sqrt();
  return shrunk;
}

ExpectedDrift predicted_drift(const RecordingInfo& info, const Prediction& prediction, const PredictOptions& options,
                              const DriftPlan& plan) {
  FreeNavigationSetup setup;
  setup.site = {info.latitude_deg * rad_per_deg, info.gravity_mps2};
  setup.noise = options.noise;
  setup.noise.accel_pulse_mps = info.accel_increment == IncrementKind::pulses ? info.accel_pulse_mps : 0.0;
  setup.counts = counts_model(options.unit.value_or(typical_unit(info)), info);
  setup.parameter_covariance = covariance_of(prediction);
  setup.align_s = plan.align_s;
  return expected_drift(setup, plan.heading_rad, plan.free_s, plan.free_s);
}

}  // namespace turncal
