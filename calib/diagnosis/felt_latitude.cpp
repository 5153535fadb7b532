#include "calib/diagnosis/felt_latitude.h"

#include <cmath>

#include <Eigen/LU>

#include "calib/joint/score_algebra.h"

namespace turncal {

std::vector<EffectColumn> latitude_columns() {
  const EffectEntry* const rate = find_effect("earth_rate");
  return {{.entry = rate, .component = 0}, {.entry = rate, .component = 1}};
}

std::optional<FeltLatitude> felt_latitude(const RecordingInfo& info, const JointResult& fit) {
  const int north = parameter_count + static_cast<int>(fit.effects.size());
  if (!fit.undetermined.empty() || fit.last.information.rows() != north + 2) return {};
  const Scores scores = eliminate(fit.last.information, fit.last.gradient, fit.free, {north, north + 1});
  const Eigen::Matrix2d information = scores.Q;
  if (!(information.determinant() > 0.0)) return {};
  const double latitude = info.latitude_deg * rad_per_deg, rate_degph = earth_rate_radps / radps_per_degph;
  const Eigen::Vector2d v(-rate_degph * std::sin(latitude), rate_degph * std::cos(latitude));
  const double weight = v.dot(information * v);
  if (!(weight > 0.0) || !std::isfinite(weight)) return {};
  return FeltLatitude{info.latitude_deg + v.dot(scores.s) / weight / rad_per_deg,
                      1.0 / std::sqrt(weight) / rad_per_deg};
}

}  // namespace turncal
