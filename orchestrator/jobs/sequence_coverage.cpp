#include "orchestrator/jobs/sequence_coverage.h"

namespace turncal {

namespace {

constexpr std::size_t most_predicted = 20000;  // items: some 10 s of a core
constexpr double good_arw_deg_per_rt_h = 0.002, good_vrw_ug_per_rt_hz = 8.0;

}  // namespace

PlannedMotion planned_motion(const Sequence& sequence, const Plan& plan) {
  PlannedMotion motion;
  motion.start_deg = sequence.start_deg;
  for (const PlannedItem& item : plan.items) {
    PlannedMotionItem planned;
    planned.kind =
        item.kind == SequenceItem::Kind::move ? PlannedMotionItem::Kind::move : PlannedMotionItem::Kind::dwell;
    planned.step = item.step;
    planned.samples = item.samples;
    planned.dwell_kind = item.dwell_kind;
    planned.axis = item.axis;
    planned.from_deg = item.from_deg;
    planned.to_deg = item.to_deg;
    planned.rate_degps = item.rate_degps;
    planned.acceleration_degps2 = item.acceleration_degps2;
    motion.items.push_back(planned);
  }
  return motion;
}

std::vector<std::string> undetermined_by(const Sequence& sequence, const Plan& plan, const RecordingInfo& info) {
  if (plan.items.size() > most_predicted) return {};
  PredictOptions options;
  options.noise.angle_random_walk.setConstant(good_arw_deg_per_rt_h * radprs_per_degprh);
  options.noise.velocity_random_walk.setConstant(good_vrw_ug_per_rt_hz * mpsprs_per_ugprHz);
  ParameterVector asked;
  for (int k = 0; k < parameter_count; ++k) asked[k] = parameter_is_free[static_cast<std::size_t>(k)] ? 1.0 : 0.0;
  return open_parameters(predict(info, planned_motion(sequence, plan), options), asked);
}

std::vector<std::string> open_parameters(const Prediction& prediction, const ParameterVector& asked) {
  std::vector<std::string> keys;
  for (std::size_t k = 0; k < parameter_keys.size(); ++k) {
    const bool determined = prediction.valid && prediction.determined[k];
    if (asked[static_cast<Eigen::Index>(k)] > 0.0 && !determined) keys.emplace_back(parameter_keys[k]);
  }
  return keys;
}

std::string coverage_text(const std::vector<std::string>& keys) {
  std::string text = "does not determine";
  if (keys.size() == parameter_keys.size() - 3) {
    text += " any parameter";
  } else {
    for (const std::string& key : keys) text += " " + key;
  }
  return text + ": expected steps that do (turncal predict)";
}

}  // namespace turncal
