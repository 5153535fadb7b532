#include "orchestrator/jobs/navigation/calibrated_source.h"

namespace turncal {

CalibratedSource::CalibratedSource(RecordingSource& source, const SensorModel& model, EffectTerms effects)
    : RecordingSource(source.path()), source_(source), model_(model), effects_(std::move(effects)) {
  info_ = source.info();
  info_.gyro_increment = info_.accel_increment = IncrementKind::physical;
  info_.accel_pulse_mps = 0.0;
  segments_ = source.segments();
  damage_ = source.damage();
}

Result<std::unique_ptr<CalibratedSource>> CalibratedSource::of(const ParameterFile& file, const std::string& path,
                                                               RecordingSource& source) {
  if (Status status = check_applicable(file, path, source.info()); !status) return status.error();
  Result<EffectTerms> effects = EffectTerms::of(file, path, source);
  if (!effects) return effects.error();
  const SensorModel model = sensor_model(from_vector(file.parameters), source.info());
  return std::unique_ptr<CalibratedSource>(new CalibratedSource(source, model, std::move(*effects)));
}

Status CalibratedSource::stream(const Sink& sink) {
  const double period_s = info_.sample_period_s;
  EffectTerms effects = effects_;  // it goes forward only
  std::vector<ImuSample> calibrated;
  return source_.read([&](std::span<const ImuSample> block) {
    calibrated.assign(block.begin(), block.end());
    for (ImuSample& sample : calibrated) {
      const EffectTerms::Term& effect = effects.at(sample.counter);
      const Eigen::Vector3d dtheta = model_.gyro_scale * Eigen::Vector3d::Map(sample.gyro.data()) -
                                     (model_.gyro_bias_radps + effect.rate_radps) * period_s;
      const Eigen::Vector3d dv = model_.accel_scale * Eigen::Vector3d::Map(sample.accel.data()) -
                                 (model_.accel_bias_mps2 + effect.force_mps2) * period_s;
      Eigen::Vector3d::Map(sample.gyro.data()) = dtheta;
      Eigen::Vector3d::Map(sample.accel.data()) = dv;
    }
    return sink(calibrated);
  });
}

}  // namespace turncal
