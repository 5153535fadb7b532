#include "calib/diagnosis/felt_latitude.h"

#include <cmath>

#include <Eigen/LU>

namespace turncal {

std::optional<FeltLatitude> felt_latitude(const CompressedRecording& recording, const JointResult& fit) {
  if (!fit.undetermined.empty()) return {};
  const EffectEntry* const rate = find_effect("earth_rate");
  JointOptions options;
  options.start = fit.parameters;
  options.effects = {{.entry = rate, .component = 0}, {.entry = rate, .component = 1}};
  options.noise = fit.noise;
  options.faults_of = &fit;
  const JointResult freed = joint_estimate(recording, options);
  const Eigen::Index n = freed.covariance.rows();
  if (freed.effects.size() != 2 || n < 2 || !(freed.effects[0].sigma > 0.0 && freed.effects[1].sigma > 0.0)) return {};
  const Eigen::Matrix2d information = freed.covariance.bottomRightCorner<2, 2>().inverse();
  const double latitude = recording.info.latitude_deg * rad_per_deg, rate_degph = earth_rate_radps / radps_per_degph;
  const Eigen::Vector2d x(freed.effects[0].value, freed.effects[1].value);
  const Eigen::Vector2d v(-rate_degph * std::sin(latitude), rate_degph * std::cos(latitude));
  const double weight = v.dot(information * v);
  if (!(weight > 0.0) || !std::isfinite(weight)) return {};
  return FeltLatitude{recording.info.latitude_deg + v.dot(information * x) / weight / rad_per_deg,
                      1.0 / std::sqrt(weight) / rad_per_deg};
}

}  // namespace turncal
