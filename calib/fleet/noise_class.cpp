#include "calib/fleet/noise_class.h"

#include <cmath>

#include "calib/model/limits.h"
#include "calib/statistics/distributions.h"

namespace turncal {
namespace {

const Eigen::Vector3d& walk_of(const NoiseModel& noise, int which) {
  return which == 0 ? noise.angle_random_walk : noise.velocity_random_walk;
}

double log_rms(const Eigen::Vector3d& walk) { return 0.5 * std::log(walk.squaredNorm() / 3.0); }

}  // namespace

std::optional<NoiseClass> noise_class(const std::vector<NoiseModel>& units) {
  if (units.size() < fleet_limits.least_prior_units) return std::nullopt;
  const auto count = static_cast<double>(units.size());
  NoiseClass of_part;
  of_part.units = units.size();
  for (const int which : {0, 1}) {
    double sum = 0.0, squares = 0.0;
    for (const NoiseModel& unit : units) sum += log_rms(walk_of(unit, which));
    const double mean = sum / count;
    for (const NoiseModel& unit : units) squares += std::pow(log_rms(walk_of(unit, which)) - mean, 2);
    of_part.mean[which] = mean;
    of_part.sigma[which] = std::sqrt(squares / (count - 3.0) * (1.0 + 1.0 / count));
  }
  std::vector<double> gyro, accel;
  for (const NoiseModel& unit : units) {
    gyro.push_back(unit.gyro_bias_instability_radps);
    accel.push_back(unit.accel_bias_instability_mps2);
  }
  of_part.gyro_bias_instability_radps = median(gyro);
  of_part.accel_bias_instability_mps2 = median(accel);
  return of_part;
}

NoiseOfClass noise_of_class(const NoiseClass& of_part, const NoiseFit& own, double false_alarm) {
  NoiseOfClass result;
  result.noise = own.noise;
  const double limit = chi_square_1_limit(false_alarm / 2.0);
  for (const int which : {0, 1}) {
    const Eigen::Vector3d& walk = walk_of(own.noise, which);
    const Eigen::Vector3d& sigma = which == 0 ? own.sigma_angle_random_walk : own.sigma_velocity_random_walk;
    // Axes with a value of their own are three measurements.
    const double relative = sigma.norm() / walk.norm() / (own.axes_differ ? std::sqrt(3.0) : 1.0);
    const double apart = of_part.mean[which] - log_rms(walk);
    const double variance = relative * relative + of_part.sigma[which] * of_part.sigma[which];
    if (!(relative > 0.0) || !std::isfinite(apart)) continue;
    result.z[which] = -apart / std::sqrt(variance);
    if (result.z[which] * result.z[which] > limit) {
      result.changed.push_back(which);
      continue;
    }
    result.share[which] = relative * relative / variance;
    (which == 0 ? result.noise.angle_random_walk : result.noise.velocity_random_walk) *=
        std::exp(result.share[which] * apart);
  }
  if (own.noise.gyro_bias_instability_radps == 0.0)
    result.noise.gyro_bias_instability_radps = of_part.gyro_bias_instability_radps;
  if (own.noise.accel_bias_instability_mps2 == 0.0)
    result.noise.accel_bias_instability_mps2 = of_part.accel_bias_instability_mps2;
  return result;
}

JointResult estimate_with_noise(const CompressedRecording& recording, const JointResult& estimate,
                                const NoiseModel& noise) {
  JointOptions options;
  options.start = estimate.parameters;
  options.noise = noise;
  options.faults_of = &estimate;
  JointResult again = joint_estimate(recording, options);
  if (!again.converged) return again;
  // Of both triads together: it stays where only one of them has an instability now.
  const bool both = noise.gyro_bias_instability_radps > 0.0 && noise.accel_bias_instability_mps2 > 0.0;
  if (!both && again.covariance.rows() == estimate.unseen_instability.rows()) {
    again.unseen_instability = estimate.unseen_instability;
    again.covariance += again.unseen_instability;
    for (std::size_t i = 0; i < again.free.size(); ++i) {
      const auto at = static_cast<Eigen::Index>(i);
      again.sigma[again.free[i]] = std::sqrt(again.covariance(at, at));
    }
  }
  again.noise_fit = estimate.noise_fit;
  return again;
}

}  // namespace turncal
