#include "orchestrator/devices/earth_rate_check.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include <Eigen/LU>

#include "calib/model/attitude.h"
#include "calib/model/parameters.h"

namespace turncal {

std::string EarthRateCheck::add_rest(const Eigen::Vector3d& rate_radps, double sigma_radps, const Eigen::Matrix3d& C_nb,
                                     const Eigen::Vector3d& up) {
  if (contradictory_) return {};
  if (rests_ == 0) {
    const double strange = limits_.strange_bias * std::abs(rate_radps.norm() - earth_rate_radps);
    const double bias = std::max(limits_.least_bias_degph * radps_per_degph, strange);
    P_.topLeftCorner<3, 3>().diagonal().setConstant(bias * bias);
    P_.bottomRightCorner<3, 3>().diagonal().setConstant(100.0 * earth_rate_radps * earth_rate_radps);
  }
  const Eigen::Matrix3d C_bn = level(C_nb, up).transpose();
  Eigen::Matrix<double, 3, 6> H;
  H << Eigen::Matrix3d::Identity(), C_bn;
  const double noise = std::hypot(sigma_radps, limits_.misalignment_rad * rate_radps.norm());
  const Eigen::Matrix3d S = H * P_ * H.transpose() + Eigen::Matrix3d::Identity() * (noise * noise);
  const Eigen::Matrix3d S_inverse = S.inverse();
  const Eigen::Vector3d innovation = rate_radps - H * x_;
  if (rests_ > 0 && innovation.dot(S_inverse * innovation) > limits_.contradiction) {
    contradictory_ = true;
    return {};
  }
  const Eigen::Matrix<double, 6, 3> K = P_ * H.transpose() * S_inverse;
  x_ += K * innovation;
  P_ = (P_ - K * H * P_).eval();
  P_ = (0.5 * (P_ + P_.transpose())).eval();
  ++rests_;

  const Eigen::Vector3d earth = x_.tail<3>();
  const double size = earth.norm();
  if (size < limits_.smallest * earth_rate_radps || size > limits_.largest * earth_rate_radps) return {};
  const double sine = earth.y() / size;
  const Eigen::Vector3d slope = (Eigen::Vector3d::UnitY() - sine * earth / size) / size;
  const double sigma = std::sqrt(slope.dot(P_.bottomRightCorner<3, 3>() * slope));
  const double difference = sine - std::sin(latitude_deg_ * rad_per_deg);
  if (std::abs(difference) <= std::max(limits_.sigmas * sigma, limits_.least_difference)) return {};
  const double latitude_deg = std::asin(sine) / rad_per_deg;
  // Of the latitude; near a pole its sine tells little.
  const double sigma_deg = sigma / std::max(std::sqrt(1.0 - sine * sine), std::sqrt(sigma)) / rad_per_deg;
  char text[400];
  std::snprintf(text, sizeof text,
                "at rest the gyros feel the earth turn about the vertical at %+.2f deg/h of %.2f, as at a latitude of "
                "%.1f +- %.1f deg: site.latitude_deg is %.10g (north is positive), or axes and signs of the gyros",
                earth.y() / radps_per_degph, size / radps_per_degph, latitude_deg, sigma_deg, latitude_deg_);
  return text;
}

}  // namespace turncal
