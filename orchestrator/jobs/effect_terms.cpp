#include "orchestrator/jobs/effect_terms.h"

#include <algorithm>
#include <cmath>

#include "calib/joint/joint_estimate.h"
#include "calib/model/effects.h"
#include "calib/statistics/segmentation.h"
#include "orchestrator/jobs/loaded_recording.h"

namespace turncal {
namespace {

bool needs_attitude(const std::string& name) { return name == "earth_rate" || name == "gyro_magnetic"; }

Result<std::vector<EffectColumn>> columns_of(const ParameterFile& file, const std::string& file_name,
                                             const RecordingInfo& info, bool has_attitude, Eigen::VectorXd& values) {
  std::vector<EffectColumn> columns;
  std::vector<double> found;
  for (const EffectValue& effect : file.effects) {
    const std::string key = "effect." + effect.name + "." + effect.component;
    const EffectEntry* entry = find_effect(effect.name);
    if (entry == nullptr) return input_error(file_name + ": '" + key + "' is not an effect of the catalogue");
    if (effect.component == entry->variant) continue;
    const auto at = std::find(entry->components.begin(), entry->components.end(), effect.component);
    if (at == entry->components.end())
      return input_error(file_name + ": '" + key + "' is not a component of " + effect.name);
    if (entry->needs_temperature && !info.has_temperature)
      return input_error(file_name + ": '" + key + "' depends on temperature, which the recording does not have");
    if (needs_attitude(effect.name) && !has_attitude)
      return input_error(file_name + ": '" + key +
                         "' depends on the attitude, which a recording without table angles does not tell");
    EffectColumn column{entry, static_cast<int>(at - entry->components.begin()), 0.0};
    if (!entry->taus_s.empty()) {
      const auto tau = std::find_if(file.effects.begin(), file.effects.end(), [&](const EffectValue& e) {
        return e.name == effect.name && e.component == entry->variant;
      });
      if (tau == file.effects.end())
        return input_error(file_name + ": missing key 'effect." + effect.name + "." + std::string(entry->variant) +
                           "'");
      column.tau_s = tau->value;
    }
    columns.push_back(column);
    found.push_back(effect.value);
  }
  values = Eigen::Map<Eigen::VectorXd>(found.data(), static_cast<Eigen::Index>(found.size()));
  return columns;
}

}  // namespace

Result<EffectTerms> EffectTerms::of(const ParameterFile& file, const std::string& file_name, RecordingSource& source) {
  EffectTerms terms;
  if (file.effects.empty()) return terms;
  const bool by_hand = without_table_angles(source.segments());
  Eigen::VectorXd values;
  const std::vector<EffectColumn> columns = TRY(columns_of(file, file_name, source.info(), !by_hand, values));
  const auto nowhere = [&] {
    return input_error(source.path() + ": has no segments, expected some to evaluate effects over");
  };
  EffectModel model =
      make_effect_model(columns, {source.info().latitude_deg}, file.reference_temperature_c.value_or(0.0));
  model.values = values;
  if (source.segments().empty()) {
    TRY(terms.of_motion_alone(source, file, model));
    return terms;
  }
  const LoadedRecording loaded = TRY(load_recording(source));
  const CompressedRecording& recording = loaded.data;
  if (recording.blocks.empty()) return nowhere();

  FilterSetup setup;
  setup.with_columns = false;
  setup.keep_taken_off = true;
  setup.noise.accel_pulse_mps =
      recording.info.accel_increment == IncrementKind::pulses ? recording.info.accel_pulse_mps : 0.0;
  faults_from_events(recording, setup.breaks);
  const FilterResult result = run_filter(recording, from_vector(file.parameters), model, setup);
  for (std::size_t k = 0; k < recording.blocks.size(); ++k) {
    const double t = recording.blocks[k].duration_s;
    terms.starts_.push_back(recording.blocks[k].start_sample);
    terms.terms_.push_back({result.taken_off[k].turn_rad / t, result.taken_off[k].push_mps / t});
  }
  return terms;
}

Status EffectTerms::of_motion_alone(RecordingSource& source, const ParameterFile& file, EffectModel model) {
  Compressor compressor(source.info());
  Segment whole;
  whole.kind = SegmentKind::rotate;
  compressor.begin_segment(whole);
  const Status status = source.read([&](std::span<const ImuSample> samples) {
    compressor.add(samples);
    return Status{};
  });
  if (!status) return status;
  const CompressedRecording recording = compressor.take();
  const SensorModel sensors = sensor_model(from_vector(file.parameters), recording.info);
  const std::vector<Block>& blocks = recording.blocks;
  const auto rate = [&](const Block& b) -> Eigen::Vector3d {
    return sensors.gyro_scale * b.gyro / b.duration_s - sensors.gyro_bias_radps;
  };
  const auto middle_s = [&](const Block& b) {
    return static_cast<double>(b.start_sample - blocks.front().start_sample) * recording.info.sample_period_s +
           0.5 * b.duration_s;
  };
  EffectRegressors regressors;
  for (std::size_t k = 0; k < blocks.size(); ++k) {
    const Block& block = blocks[k];
    const Block& before = blocks[k > 0 ? k - 1 : k];
    const Block& after = blocks[std::min(k + 1, blocks.size() - 1)];
    BlockState s;
    s.f_b = sensors.accel_scale * block.accel / block.duration_s - sensors.accel_bias_mps2;
    s.w_b = rate(block);
    s.w_dot_b.setZero();
    if (&before != &after) s.w_dot_b = (rate(after) - rate(before)) / (middle_s(after) - middle_s(before));
    s.C_nb.setIdentity();  // what needs it was refused
    s.duration_s = block.duration_s;
    s.time_s = middle_s(block);
    s.since_rotation_s = 1e9;
    s.temperature_c = std::isnan(block.temperature_c)
                          ? 0.0
                          : static_cast<double>(block.temperature_c) - model.reference_temperature_c;
    regressors.gyro.setZero(3, model.columns);
    regressors.accel.setZero(3, model.columns);
    model.regressors(s, regressors);
    starts_.push_back(block.start_sample);
    terms_.push_back({regressors.gyro * model.values, regressors.accel * model.values});
  }
  return {};
}

const EffectTerms::Term& EffectTerms::at(std::int64_t counter) {
  static const Term none;
  if (terms_.empty()) return none;
  while (index_ + 1 < starts_.size() && counter >= starts_[index_ + 1]) ++index_;
  return terms_[index_];
}

}  // namespace turncal
