#include "calib/navigation/alignment.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include <fmt/format.h>

#include "calib/model/attitude.h"

namespace turncal {
namespace {

// Sigma of the level after a coarse alignment, larger than its error, so that the filter finds its own.
constexpr double coarse_level_rad = 0.02;
constexpr double observed_every_s = 1.0;

// Returns the integral from t1 to t2 of the up direction of a fixed point, in non-rotating axes that coincide with n at t = 0.
Eigen::Vector3d up_integral(const Eigen::Vector3d& earth_n, double t1, double t2) {
  const double w = earth_n.norm();
  const Eigen::Vector3d axis = earth_n / w;
  const Eigen::Vector3d up = Eigen::Vector3d::UnitY();
  const Eigen::Vector3d along = axis * axis.dot(up);
  return along * (t2 - t1) + (up - along) * ((std::sin(w * t2) - std::sin(w * t1)) / w) +
         axis.cross(up) * ((std::cos(w * t1) - std::cos(w * t2)) / w);
}

Eigen::Matrix3d triad(const Eigen::Vector3d& first, const Eigen::Vector3d& second) {
  Eigen::Matrix3d m;
  m.col(0) = first.normalized();
  m.col(1) = first.cross(second).normalized();
  m.col(2) = m.col(0).cross(m.col(1));
  return m;
}

double duration_of(std::span<const MotionInterval> window) {
  double t = 0.0;
  for (const MotionInterval& interval : window) t += interval.duration_s;
  return t;
}

}  // namespace

Eigen::Quaterniond coarse_alignment(std::span<const MotionInterval> window, const DriftCovariance::Site& site) {
  const double half = 0.5 * duration_of(window);
  Eigen::Quaterniond q = Eigen::Quaterniond::Identity();  // body now to body at the start
  Eigen::Vector3d early = Eigen::Vector3d::Zero(), late = Eigen::Vector3d::Zero();
  double t = 0.0, middle = 0.0;
  for (const MotionInterval& interval : window) {
    const bool first = t + 0.5 * interval.duration_s < half;
    (first ? early : late) += q * interval.push_mps;
    q = q * interval.turn;
    t += interval.duration_s;
    if (first) middle = t;
  }
  const Eigen::Vector3d earth = earth_rate_n(site.latitude_rad / rad_per_deg);
  const Eigen::Vector3d early_n = up_integral(earth, 0.0, middle), late_n = up_integral(earth, middle, t);
  const Eigen::Matrix3d in_n = triad(early_n + late_n, late_n);
  const Eigen::Matrix3d in_b = triad(early + late, late);
  return Eigen::Quaterniond(Eigen::Matrix3d(in_n * in_b.transpose())).normalized();
}

void begin_alignment(DriftCovariance& drift) { drift.begin(coarse_level_rad, coarse_heading_rad); }

double heading_sigma_of_data(double sigma_rad) {
  const double share = std::pow(sigma_rad / coarse_heading_rad, 2);
  const double nothing_rad = 2.0 * pi / std::sqrt(12.0);
  return share < 1.0 ? std::min(sigma_rad / std::sqrt(1.0 - share), nothing_rad) : nothing_rad;
}

Status check_navigation_latitude(double latitude_deg) {
  if (std::abs(latitude_deg) <= max_navigation_latitude_deg) return {};
  return input_error(
      "latitude_deg = {:.10g}: expected at most {:.10g} deg north or south to tell north by the Earth's rate",
      latitude_deg, max_navigation_latitude_deg);
}

Result<Alignment> align(std::span<const MotionInterval> window, const DriftCovariance::Site& site,
                        DriftCovariance drift) {
  TRY(check_navigation_latitude(site.latitude_rad / rad_per_deg));
  double rest_s = 0.0;
  for (const MotionInterval& interval : window) rest_s += interval.at_rest ? interval.duration_s : 0.0;
  if (rest_s < align_min_rest_s - 1e-6)
    return input_error("alignment: {} s at rest, expected at least {:.0f} s", std::lround(rest_s), align_min_rest_s);
  NavigationState start;
  start.q_nb = coarse_alignment(window, site);
  start.latitude_rad = site.latitude_rad;
  Navigator navigator(start, site.gravity_mps2, true);
  begin_alignment(drift);
  double since_s = 0.0;
  for (const MotionInterval& interval : window) {
    const Eigen::Quaterniond before = navigator.state().q_nb;
    navigator.advance(interval);
    drift.advance(before.slerp(0.5, navigator.state().q_nb).toRotationMatrix(), interval);
    since_s += interval.duration_s;
    if (!interval.at_rest || since_s < observed_every_s - 1e-9) continue;
    since_s = 0.0;
    const Eigen::Vector3d v = navigator.state().velocity_n_mps;
    const DriftVector error = drift.observe_rest({v[0], v[2]});
    navigator.correct(error.head<3>(), {error[3], 0.0, error[4]});
    navigator.set_position(site.latitude_rad, 0.0, 0.0);
  }
  drift.begin_navigation();
  return Alignment{navigator.state(), std::move(drift), rest_s};
}

std::array<double, 3> angle_sigmas(const Eigen::Matrix3d& of_phi, const Eigen::Quaterniond& q_nb) {
  const Eigen::Matrix3d C_nb = q_nb.toRotationMatrix();
  const Eigen::Vector3d x = C_nb.col(0);
  constexpr double least_level = 1e-12;  // x vertical to rounding: any direction serves as north
  const double level = std::hypot(x[0], x[2]);
  const double north = level > least_level ? x[0] / level : 1.0, east = level > least_level ? x[2] / level : 0.0;
  const double slope = x[1] / std::max(level, least_level);
  const Eigen::Vector3d of_heading(-slope * north, 1.0, -slope * east);
  const Eigen::Matrix3d of_body = C_nb.transpose() * of_phi * C_nb;
  const double heading = std::sqrt(std::max(0.0, of_heading.dot(of_phi * of_heading)));
  return {std::min(heading, 2.0 * std::numbers::pi / std::sqrt(12.0)), std::sqrt(std::max(0.0, of_body(0, 0))),
          std::sqrt(std::max(0.0, of_body(2, 2)))};
}

bool FeltSite::weighs_against(double of_record_mps2) const {
  constexpr double far_mps2 = 0.01;
  return gravity_mps2 > 0.0 && std::abs(gravity_mps2 - of_record_mps2) > far_mps2;
}

FeltSite felt_site(std::span<const MotionInterval> intervals, const NoiseModel& noise,
                   const ParameterCovariance& parameters) {
  double turned_rad = 0.0, seconds = 0.0, pushed_mps = 0.0;
  Eigen::Vector3d up = Eigen::Vector3d::Zero();  // time integral, in body axes
  double walk = 0.0;
  for (const MotionInterval& interval : intervals) {
    if (!interval.at_rest) continue;
    const Eigen::Vector3d direction = interval.push_mps.normalized();
    turned_rad += direction.dot(interval.gyro_rad);
    pushed_mps += interval.push_mps.norm();
    up += interval.duration_s * direction;
    walk += interval.duration_s * direction.cwiseProduct(noise.angle_random_walk).squaredNorm();
    seconds += interval.duration_s;
  }
  if (seconds <= 0.0) return {{0.0, std::numeric_limits<double>::infinity()}, 0.0};
  const double sine = std::clamp(turned_rad / seconds / earth_rate_radps, -1.0, 1.0);
  up /= seconds;
  const Eigen::Matrix3d of_bias = radps_per_degph * radps_per_degph * parameters.topLeftCorner<3, 3>();
  const double variance = walk / (seconds * seconds) + up.dot(of_bias * up);
  const double cosine = std::max(0.05, std::sqrt(1.0 - sine * sine));
  return {{std::asin(sine), std::sqrt(std::max(0.0, variance)) / earth_rate_radps / cosine}, pushed_mps / seconds};
}

}  // namespace turncal
