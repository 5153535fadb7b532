#include "calib/diagnosis/felt_latitude.h"

#include <algorithm>
#include <cmath>

#include <Eigen/LU>

#include "calib/joint/score_algebra.h"

namespace turncal {
namespace {

// Error of the earth's rate north and up, deg/h, and its information.
struct RateError {
  Eigen::Vector2d x;
  Eigen::Matrix2d information;
};

std::optional<RateError> rate_error(const CompressedRecording& recording, const JointResult& fit) {
  if (fit.undetermined.empty()) {
    const int north = parameter_count + static_cast<int>(fit.effects.size());
    if (fit.last.information.rows() != north + 2) return {};
    const Scores scores = eliminate(fit.last.information, fit.last.gradient, fit.free, {north, north + 1});
    const Eigen::Matrix2d information = scores.Q;
    if (!(information.determinant() > 0.0)) return {};
    return RateError{information.inverse() * scores.s, information};
  }
  JointOptions free;
  free.effects = latitude_columns();
  const JointResult other = joint_estimate(recording, free);
  if (!other.converged || !other.undetermined.empty()) return {};
  const Eigen::Matrix2d covariance = other.covariance.bottomRightCorner<2, 2>();
  return RateError{{other.effects[0].value, other.effects[1].value}, covariance.inverse()};
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
  const std::optional<RateError> error = rate_error(recording, fit);
  if (!error) return {};
  const auto rate = [](double latitude) -> Eigen::Vector2d {
    return earth_rate_radps / radps_per_degph * Eigen::Vector2d(std::cos(latitude), std::sin(latitude));
  };
  const Eigen::Vector2d felt = error->x + rate(recording.info.latitude_deg * rad_per_deg);
  double latitude = recording.info.latitude_deg * rad_per_deg, weight = 0.0;
  for (int iteration = 0; iteration < 8; ++iteration) {
    const Eigen::Vector2d v = rate(latitude + 0.5 * pi);
    weight = v.dot(error->information * v);
    if (!(weight > 0.0) || !std::isfinite(weight)) return {};
    latitude += v.dot(error->information * (felt - rate(latitude))) / weight;
  }
  if (!(std::abs(latitude) <= 0.5 * pi)) return {};
  return FeltLatitude{latitude / rad_per_deg, 1.0 / std::sqrt(weight) / rad_per_deg};
}

}  // namespace turncal
