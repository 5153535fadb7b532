#include "calib/joint/joined_recordings.h"

#include <algorithm>
#include <cmath>

namespace turncal {
namespace {

const std::vector<EffectEntry>& turn_on_entries() {
  using Out = Eigen::Ref<Eigen::Matrix3Xd>;
  static const std::vector<EffectEntry> entries = {
      {.name = "turn_on_gyro_bias",
       .term = "bias of this recording less that of the first",
       .formula = "c",
       .unit = "deg/h",
       .components = {"x", "y", "z"},
       .si = radps_per_degph,
       .of_one_run = true,
       .seen_by = "",
       .write = [](const BlockState&, const Site&, double, Out g, Out) { g.setIdentity(); }},
      {.name = "turn_on_accel_bias",
       .term = "bias of this recording less that of the first",
       .formula = "c",
       .unit = "g",
       .components = {"x", "y", "z"},
       .si = standard_gravity_mps2,
       .of_one_run = true,
       .seen_by = "",
       .write = [](const BlockState&, const Site&, double, Out, Out a) { a.setIdentity(); }},
  };
  return entries;
}

void append(const CompressedRecording& part, CompressedRecording& data) {
  const std::int64_t later = data.segments.back().end_sample - part.segments.front().start_sample;
  const auto segments = static_cast<std::int32_t>(data.segments.size());
  for (Segment segment : part.segments) {
    segment.start_sample += later;
    segment.end_sample += later;
    data.segments.push_back(segment);
  }
  for (Block block : part.blocks) {
    block.start_sample += later;
    block.segment += segments;
    data.blocks.push_back(block);
  }
  for (DataEvent event : part.events) {
    event.sample += later;
    data.events.push_back(event);
  }
  const double before = static_cast<double>(data.samples), added = static_cast<double>(part.samples);
  data.mean_temperature_c = (before * data.mean_temperature_c + added * part.mean_temperature_c) / (before + added);
  data.samples += part.samples;
  data.info.has_temperature = data.info.has_temperature && part.info.has_temperature;
}

}  // namespace

JoinedRecordings join_recordings(const std::vector<const CompressedRecording*>& parts) {
  JoinedRecordings joined{parts, *parts.front(), {}, {}};
  for (std::size_t k = 1; k < parts.size(); ++k) {
    joined.begins.push_back(joined.data.blocks.size());
    append(*parts[k], joined.data);
    for (const EffectEntry& entry : turn_on_entries())
      for (int axis = 0; axis < 3; ++axis) joined.turn_ons.push_back({&entry, axis, 0.0, static_cast<int>(k)});
  }
  return joined;
}

bool is_turn_on(const EffectColumn& column) {
  const std::vector<EffectEntry>& all = turn_on_entries();
  return std::any_of(all.begin(), all.end(), [&](const EffectEntry& e) { return &e == column.entry; });
}

bool is_gyro_turn_on(const EffectColumn& column) { return column.entry == &turn_on_entries().front(); }

std::optional<SeveralRecordings> contradiction(const JoinedRecordings& recordings, const JointResult& together) {
  if (recordings.parts.size() < 2 || together.whiteness.white) return std::nullopt;
  std::vector<JointResult> alone;
  for (const CompressedRecording* part : recordings.parts) {
    alone.push_back(joint_estimate(*part));
    if (!alone.back().converged || !alone.back().whiteness.white) return std::nullopt;
  }
  SeveralRecordings result = combine_recordings(alone);
  if (result.agree) return std::nullopt;
  return result;
}

OfEachRecording leave_what_is_common(JointResult& e, std::size_t recordings, Eigen::MatrixXd* also) {
  OfEachRecording each;
  const auto n = static_cast<Eigen::Index>(recordings);
  const auto old = static_cast<Eigen::Index>(e.free.size());
  Eigen::MatrixXd unit = Eigen::MatrixXd::Zero(old, old);  // from what was free to what is common
  Eigen::MatrixXd biases = Eigen::MatrixXd::Zero(6 * n, old);
  Eigen::VectorXd values(6 * n);
  for (Eigen::Index k = 0; k < n; ++k) values.segment<6>(6 * k) = to_vector(e.parameters).head<6>();
  std::vector<int> free;
  std::vector<EstimatedEffect> common;
  for (Eigen::Index i = 0; i < old; ++i) {
    const int column = e.free[static_cast<std::size_t>(i)];
    if (column < parameter_count) {
      unit(static_cast<Eigen::Index>(free.size()), i) = 1.0;
      free.push_back(column);
      for (Eigen::Index k = 0; k < n && column < 6; ++k) biases(6 * k + column, i) = 1.0;
      continue;
    }
    const EstimatedEffect& effect = e.effects[static_cast<std::size_t>(column - parameter_count)];
    if (is_turn_on(effect.column)) {
      const int bias = effect.column.component + (is_gyro_turn_on(effect.column) ? 0 : 3);
      const auto row = std::find(free.begin(), free.end(), bias) - free.begin();
      if (row < static_cast<std::ptrdiff_t>(free.size())) unit(row, i) = 1.0 / static_cast<double>(n);
      biases(6 * effect.column.recording + bias, i) = 1.0;
      values[6 * effect.column.recording + bias] += effect.value;
    } else if (effect.column.recording > 0) {
      each.effects.push_back(effect);
    } else {
      unit(static_cast<Eigen::Index>(free.size()), i) = 1.0;
      free.push_back(parameter_count + static_cast<int>(common.size()));
      common.push_back(effect);
    }
  }
  unit.conservativeResize(static_cast<Eigen::Index>(free.size()), old);
  each.turn_ons = turn_ons_of(values, biases * e.covariance * biases.transpose());
  const TurnOns& turn_ons = each.turn_ons;
  const auto of_unit = [&](const Eigen::MatrixXd& covariance) {
    Eigen::MatrixXd result = unit * covariance * unit.transpose();
    for (std::size_t i = 0; i < free.size(); ++i)
      if (free[i] < 6)
        result(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(i)) +=
            std::pow(turn_ons.repeatability[free[i]], 2) / static_cast<double>(n);
    return result;
  };
  for (Eigen::MatrixXd* covariance : {&e.covariance, also})
    if (covariance != nullptr && covariance->rows() == old) *covariance = of_unit(*covariance);
  ParameterVector parameters = to_vector(e.parameters);
  parameters.head<6>() = turn_ons.mean;
  e.parameters = from_vector(parameters);
  e.free = std::move(free);
  e.effects = std::move(common);
  for (std::size_t i = 0; i < e.free.size(); ++i)
    if (e.free[i] < 6 && e.sigma[e.free[i]] > 0.0)
      e.sigma[e.free[i]] = std::sqrt(e.covariance(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(i)));
  return each;
}

}  // namespace turncal
