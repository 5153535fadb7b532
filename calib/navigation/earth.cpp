#include "calib/navigation/earth.h"

#include <algorithm>
#include <cmath>

#include "calib/model/limits.h"
#include "calib/model/parameters.h"

namespace turncal {
namespace {

constexpr double eccentricity2 = wgs84_flattening * (2.0 - wgs84_flattening);
constexpr double equator_gravity_mps2 = 9.7803253359;
constexpr double somigliana_k = 0.00193185265241;
constexpr double m_ratio = 0.00344978650684;  // W^2 a^2 b / GM

}  // namespace

double normal_gravity_mps2(double latitude_rad, double height_m) {
  const double s2 = std::sin(latitude_rad) * std::sin(latitude_rad);
  const double surface = equator_gravity_mps2 * (1.0 + somigliana_k * s2) / std::sqrt(1.0 - eccentricity2 * s2);
  const double x = height_m / wgs84_semi_major_m;
  return surface * (1.0 - 2.0 * x * (1.0 + wgs84_flattening + m_ratio - 2.0 * wgs84_flattening * s2) + 3.0 * x * x);
}

RadiiOfCurvature radii_of_curvature(double latitude_rad) {
  const double s = std::sin(latitude_rad);
  const double w2 = 1.0 - eccentricity2 * s * s;
  const double east = wgs84_semi_major_m / std::sqrt(w2);
  return {east * (1.0 - eccentricity2) / w2, east};
}

FrameRates frame_rates(double latitude_rad, double height_m, const Eigen::Vector3d& velocity_n_mps) {
  const double s = std::sin(latitude_rad);
  const double c = std::cos(latitude_rad);
  const RadiiOfCurvature radii = radii_of_curvature(latitude_rad);
  const double eastward = velocity_n_mps[2] / (radii.east_m + height_m);
  return {{earth_rate_radps * c, earth_rate_radps * s, 0.0},
          {eastward, eastward * s / c, -velocity_n_mps[0] / (radii.north_m + height_m)}};
}

bool FeltLatitude::speaks_against(double of_record_rad, double least_deg) const {
  return std::abs(latitude_rad - of_record_rad) > std::max(least_deg * rad_per_deg, latitude_limits.sigmas * sigma_rad);
}

}  // namespace turncal
