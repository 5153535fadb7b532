#include "calib/prediction/predicted_drift.h"

namespace turncal {
namespace {

ParameterCovariance covariance_of(const Prediction& prediction) {
  ParameterCovariance covariance = ParameterCovariance::Zero();
  for (std::size_t i = 0; i < prediction.free.size(); ++i)
    for (std::size_t j = 0; j < prediction.free.size(); ++j) {
      const int row = prediction.free[i], column = prediction.free[j];
      if (row < parameter_count && column < parameter_count)
        covariance(row, column) = prediction.covariance(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j));
    }
  return covariance;
}

}  // namespace

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
