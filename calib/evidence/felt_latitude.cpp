#include "calib/evidence/felt_latitude.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <Eigen/LU>

#include "calib/joint/score_algebra.h"
#include "calib/model/limits.h"
#include "calib/statistics/unit_slip.h"
#include "calib/types/value_text.h"

namespace turncal {
namespace {

Eigen::Vector2d rate_at(double latitude_rad) {
  return earth_rate_radps / radps_per_degph * Eigen::Vector2d(std::cos(latitude_rad), std::sin(latitude_rad));
}

// The estimated rate of the Earth, north and up, deg/h, and its information.
struct FeltRate {
  Eigen::Vector2d rate;
  Eigen::Matrix2d information;
};

// Estimates the Earth's rate among the unknowns, from one latitude after another: the fit converges from 15 deg off, not always from 40.
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

// Returns the variance of the gyro biases over that at the fitted noise, the largest ratio: at least 1.
double widened_by_unseen_instability(const JointResult& fit) {
  double most = 1.0;
  for (std::size_t i = 0; i < fit.free.size(); ++i) {
    const auto k = Eigen::Index(i);
    if (fit.free[i] < 3)
      most = std::max(most, fit.covariance(k, k) / (fit.covariance(k, k) - fit.unseen_instability(k, k)));
  }
  return most;
}

std::optional<FeltRate> felt_rate(const CompressedRecording& recording, const JointResult& fit) {
  const int north = parameter_count + int(fit.effects.size());
  if (!fit.converged || !fit.undetermined.empty() || fit.last.information.rows() != north + 2)
    return with_free_rate(recording);
  const Scores scores = eliminate(fit.last.information, fit.last.gradient, fit.free, {north, north + 1});
  if (!(scores.Q.determinant() > 0.0)) return {};
  return FeltRate{rate_at(recording.info.latitude_deg * rad_per_deg) + scores.Q.inverse() * scores.s,
                  scores.Q / widened_by_unseen_instability(fit)};
}

}  // namespace

std::vector<EffectColumn> latitude_columns() {
  const EffectEntry* const rate = find_effect("earth_rate");
  return {{.entry = rate, .component = 0}, {.entry = rate, .component = 1}};
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
  const auto misfit = [&](double at) -> double {
    return (felt->rate - rate_at(at)).dot(felt->information * (felt->rate - rate_at(at)));
  };
  const double stated = recording.info.latitude_deg * rad_per_deg, off = std::abs(latitude - stated);
  const double sigma = 1.0 / std::sqrt(weight), gain = std::max(misfit(stated) - misfit(latitude), 1e-12);
  return FeltLatitude{latitude, off > sigma ? std::max(sigma, off / std::sqrt(gain)) : sigma};
}

std::string wrong_latitude(const CompressedRecording& recording, const JointResult& fit) {
  // With gyros connected to other axes nothing converges, and a fit with a free Earth's rate would be wasted.
  if (!fit.converged && !wrong_table_axes(recording, fit.setup.mounting).empty()) return "";
  const std::optional<FeltLatitude> felt = felt_latitude(recording, fit);
  const double stated_deg = recording.info.latitude_deg;
  if (!felt || !felt->speaks_against(stated_deg * rad_per_deg, latitude_limits.least_deg)) return "";
  return fmt::format("the gyros measure the Earth's rate of a latitude of {} deg, the recording says {:.10g}",
                     plus_minus(felt->latitude_rad / rad_per_deg, felt->sigma_rad / rad_per_deg), stated_deg);
}

EffectColumn vertical_earth_rate() { return latitude_columns().back(); }

std::string latitude_of_vertical(double stated_deg, double more_degph, double sigma_degph) {
  const double whole = rate_at(0.5 * pi).y(), stated = rate_at(stated_deg * rad_per_deg).y(), up = stated + more_degph;
  const double sigma_rad = sigma_degph / std::sqrt(whole * whole - up * up);
  const std::string felt =
      std::abs(up) < whole ? fmt::format("a latitude of {} deg",
                                         value_with_sigma(std::asin(up / whole) / rad_per_deg, sigma_rad / rad_per_deg))
                           : "more than the Earth's rate";
  return fmt::format("the gyros measure {}, the recording says {:.10g}{}; about the vertical {} deg/h", felt,
                     stated_deg,
                     up * stated < 0.0 ? " (or the accelerometers read gravity and not specific force)" : "",
                     plus_minus(up, sigma_degph));
}

}  // namespace turncal
