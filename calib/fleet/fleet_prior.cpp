#include "calib/fleet/fleet_prior.h"

#include <algorithm>
#include <cmath>
#include <tuple>

#include "calib/joint/several_recordings.h"
#include "calib/model/limits.h"
#include "calib/statistics/numerics.h"

namespace turncal {
namespace {

const Eigen::Vector3d& walk_of(const NoiseModel& noise, int which) {
  return which == 0 ? noise.angle_random_walk : noise.velocity_random_walk;
}

double log_rms(const Eigen::Vector3d& walk) { return 0.5 * std::log(walk.squaredNorm() / 3.0); }

struct Gaussian {
  Eigen::VectorXd mean;
  Eigen::MatrixXd covariance;
};

Gaussian of_fleet(const std::vector<const EarlierCalibration*>& units, const std::vector<int>& free) {
  const Eigen::Index count = units.size(), d = free.size();
  Eigen::MatrixXd values(count, d);
  for (Eigen::Index u = 0; u < count; ++u) values.row(u) = units[u]->value(free).transpose();
  const Eigen::VectorXd mean = values.colwise().mean();
  values.rowwise() -= mean.transpose();
  const double n = double(count);
  Eigen::MatrixXd S = values.transpose() * values / (n - 1.0);
  Eigen::VectorXd errors = Eigen::VectorXd::Zero(d);
  for (const EarlierCalibration* unit : units) errors += Eigen::VectorXd(unit->covariance.diagonal()(free)) / n;
  S.diagonal() = S.diagonal().cwiseMax(errors);  // S includes them
  const bool whole = count >= 3 * d;
  if (!whole) S = Eigen::MatrixXd(S.diagonal().asDiagonal());
  const double estimated = whole ? double(d) : 1.0;
  return {mean, S * (1.0 + 1.0 / n) * (n - 1.0) / (n - estimated - 2.0)};
}

}  // namespace

std::optional<FleetPrior> fleet_prior(std::vector<EarlierCalibration> history, const std::string& unit) {
  std::ranges::stable_sort(history, [](const EarlierCalibration& a, const EarlierCalibration& b) {
    return std::tie(a.unit, a.time_utc) < std::tie(b.unit, b.time_utc);
  });
  const std::vector<int> free = free_parameters();
  std::vector<const EarlierCalibration*> others, own;
  Eigen::VectorXd change = Eigen::VectorXd::Zero(free.size());
  FleetPrior prior;
  std::vector<NoiseModel> noises;
  for (std::size_t i = 0; i < history.size(); ++i) {
    const EarlierCalibration& e = history[i];
    const bool newest = i + 1 == history.size() || history[i + 1].unit != e.unit;
    if (e.unit == unit)
      own.push_back(&e);
    else if (newest)
      others.push_back(&e);
    if (e.unit != unit && newest && e.noise) noises.push_back(*e.noise);
    if (newest) continue;
    const EarlierCalibration& next = history[i + 1];
    const Eigen::VectorXd moved = (next.value - e.value)(free);
    change += moved.cwiseAbs2() - Eigen::VectorXd((e.covariance + next.covariance).diagonal()(free));
    ++prior.pairs;
  }
  if (others.size() < fleet_limits.least_prior_units) return std::nullopt;
  Gaussian now = of_fleet(others, free);
  prior.units = others.size();
  prior.noise = noise_class(noises);
  if (prior.pairs >= fleet_limits.least_prior_pairs)
    for (const EarlierCalibration* e : own) {
      const Eigen::MatrixXd before = balanced_inverse(now.covariance),
                            said = balanced_inverse(Eigen::MatrixXd(e->covariance(free, free)));
      now.covariance = balanced_inverse(before + said);
      now.mean = now.covariance * (before * now.mean + said * Eigen::VectorXd(e->value(free)));
      now.covariance.diagonal() += (change / double(prior.pairs)).cwiseMax(0.0);
      ++prior.own;
    }
  prior.mean(free) = now.mean;
  prior.covariance = Eigen::MatrixXd::Zero(parameter_count, parameter_count);
  prior.covariance(free, free) = now.covariance;
  return prior;
}

PriorEffect use_prior(const FleetPrior& prior, JointResult& e, double false_alarm) {
  PriorEffect effect;
  const Eigen::Index count = e.free.size();
  const ParameterVector at = to_vector(e.parameters);
  const double limit = chi_square_1_limit(false_alarm / double(count));
  for (Eigen::Index i = 0; i < count; ++i) {
    const int k = e.free[i];
    if (!e.determined[k]) continue;
    effect.from_prior[k] = (at[k] - prior.mean[k]) / std::sqrt(e.covariance(i, i) + prior.covariance(k, k));
    if (effect.from_prior[k] * effect.from_prior[k] > limit) effect.changed.push_back(k);
  }
  if (!effect.changed.empty()) return effect;

  // Expanded about the optimum of the data: p = p_0 - Lambda^-1 (c + P^-1 (p_0 - m)).
  const Eigen::MatrixXd P = balanced_inverse(Eigen::MatrixXd(prior.covariance(e.free, e.free)));
  const Eigen::MatrixXd covariance = balanced_inverse(information_of(e) + P);
  const Eigen::VectorXd gradient =
      Eigen::VectorXd(e.last.gradient(e.free)) + P * Eigen::VectorXd((at - prior.mean)(e.free));
  ParameterVector value = at;
  value(e.free) -= covariance * gradient;
  for (Eigen::Index i = 0; i < count; ++i) {
    const int k = e.free[i];
    effect.share[k] = e.determined[k] ? std::max(0.0, 1.0 - covariance(i, i) / e.covariance(i, i)) : 1.0;
    e.sigma[k] = std::sqrt(covariance(i, i));
    e.determined[k] = true;
  }
  e.parameters = from_vector(value);
  e.covariance = covariance;
  e.undetermined.clear();
  return effect;
}

std::optional<NoiseClass> noise_class(const std::vector<NoiseModel>& units) {
  if (units.size() < fleet_limits.least_prior_units) return std::nullopt;
  const auto count = double(units.size());
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
  // The unseen instability is of both triads together: it stays if at most one of them has an instability now.
  const bool both = noise.gyro_bias_instability_radps > 0.0 && noise.accel_bias_instability_mps2 > 0.0;
  if (!both && again.covariance.rows() == estimate.unseen_instability.rows()) {
    again.unseen_instability = estimate.unseen_instability;
    again.covariance += again.unseen_instability;
    for (std::size_t i = 0; i < again.free.size(); ++i) {
      const Eigen::Index at = i;
      again.sigma[again.free[i]] = std::sqrt(again.covariance(at, at));
    }
  }
  again.noise_fit = estimate.noise_fit;
  return again;
}

}  // namespace turncal
