#include "calib/diagnosis/felt_latitude.h"

#include <algorithm>
#include <cmath>

#include <Eigen/LU>

#include "calib/joint/score_algebra.h"

namespace turncal {
namespace {

Eigen::Vector2d rate_at(double latitude_rad) {
  return earth_rate_radps / radps_per_degph * Eigen::Vector2d(std::cos(latitude_rad), std::sin(latitude_rad));
}

// The earth's rate north and up, deg/h, and its information.
struct FeltRate {
  Eigen::Vector2d rate;
  Eigen::Matrix2d information;
};

// With the earth's rate among the unknowns, from that of a latitude that may be far off. It is found from 15 deg off, not always from 40.
std::optional<FeltRate> with_free_rate(CompressedRecording recording) {
  JointOptions free;
  free.effects = latitude_columns();
  for (const double from_deg : {recording.info.latitude_deg, 15.0, -15.0, 45.0, -45.0, 75.0, -75.0}) {
    recording.info.latitude_deg = from_deg;
    const JointResult fit = joint_estimate(recording, free);
    if (!fit.converged || !fit.undetermined.empty()) continue;
    const Eigen::Matrix2d covariance = fit.covariance.bottomRightCorner<2, 2>();
    const Eigen::Vector2d error(fit.effects[0].value, fit.effects[1].value);
    return FeltRate{rate_at(from_deg * rad_per_deg) + error, covariance.inverse()};
  }
  return {};
}

std::optional<FeltRate> felt_rate(const CompressedRecording& recording, const JointResult& fit) {
  if (!fit.converged || !fit.undetermined.empty()) return with_free_rate(recording);
  const int north = parameter_count + static_cast<int>(fit.effects.size());
  if (fit.last.information.rows() != north + 2) return {};
  const Scores scores = eliminate(fit.last.information, fit.last.gradient, fit.free, {north, north + 1});
  const Eigen::Matrix2d information = scores.Q;
  if (!(information.determinant() > 0.0)) return {};
  return FeltRate{rate_at(recording.info.latitude_deg * rad_per_deg) + information.inverse() * scores.s, information};
}

}  // namespace

std::vector<EffectColumn> latitude_columns() {
  const EffectEntry* const rate = find_effect("earth_rate");
  return {{.entry = rate, .component = 0}, {.entry = rate, .component = 1}};
}

bool FeltLatitude::speaks_against(double stated_deg) const {
  constexpr double sigmas = 5.0, least_deg = 0.03;
  return std::abs(latitude_deg - stated_deg) > std::max(sigmas * sigma_deg, least_deg);
}

std::optional<FeltLatitude> felt_latitude(const CompressedRecording& recording, const JointResult& fit) {
  const std::optional<FeltRate> felt = felt_rate(recording, fit);
  if (!felt) return {};
  double latitude = std::atan2(felt->rate.y(), felt->rate.x()), weight = 0.0;
  for (int iteration = 0; iteration < 8; ++iteration) {
    const Eigen::Vector2d v = rate_at(latitude + 0.5 * pi);
    weight = v.dot(felt->information * v);
    if (!(weight > 0.0) || !std::isfinite(weight)) return {};
    latitude += v.dot(felt->information * (felt->rate - rate_at(latitude))) / weight;
  }
  if (!(std::abs(latitude) <= 0.5 * pi)) return {};
  return FeltLatitude{latitude / rad_per_deg, 1.0 / std::sqrt(weight) / rad_per_deg};
}

}  // namespace turncal
