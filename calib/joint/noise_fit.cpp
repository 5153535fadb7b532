#include "calib/joint/noise_fit.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Dense>

#include "calib/joint/joint_estimate.h"
#include "calib/joint/velocity_likelihood.h"

namespace turncal {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// Variances that move together: one index, or the three axes of a triad.
using Group = std::vector<int>;

// Fisher scoring of the groups' variances, in place; -2 log L and the last information matrix come back.
struct Scoring {
  double value = 0.0;
  bool converged = false;
  int evaluations = 0;
  Eigen::MatrixXd information;
};
Scoring score(const VelocityLikelihood& likelihood, const std::vector<Group>& groups, double tau, int max_iterations,
              bool restricted, NoiseVariances& s) {
  const std::size_t n = groups.size();
  // A bias instability that would move psi as much as the random walk does in tau_b: its natural unit.
  NoiseVariances unit = s;
  unit[6] = s.segment<3>(0).mean() / tau;
  unit[7] = s.segment<3>(3).mean() / tau;
  Scoring result;
  VelocityLikelihood::Run now = likelihood.run(s, tau, restricted);
  ++result.evaluations;
  const auto moved_by = [&](const Group& group, double delta, NoiseVariances& t) {
    for (const int k : group) t[k] = std::max(t[k] + delta, k < 6 ? 0.05 * t[k] : 0.0);
  };
  for (int iteration = 0; iteration < max_iterations && n > 0; ++iteration) {
    std::vector<VelocityLikelihood::Run> moved;
    std::vector<double> step;
    for (const Group& group : groups) {
      NoiseVariances t = s;
      step.push_back(0.01 * std::max(s[group[0]], unit[group[0]]));
      moved_by(group, step.back(), t);
      moved.push_back(likelihood.run(t, tau, restricted));
      ++result.evaluations;
    }
    Eigen::VectorXd gradient = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(n));
    Eigen::MatrixXd information = Eigen::MatrixXd::Zero(gradient.size(), gradient.size());
    for (std::size_t k = 0; k < n; ++k)  // what the parameters take with them
      gradient[static_cast<Eigen::Index>(k)] = 0.5 * (moved[k].log_det_information - now.log_det_information) / step[k];
    std::vector<Matrix3d> A(n);
    std::vector<Vector3d> d(n);
    for (std::size_t i = 0; i < now.nu.size(); ++i) {
      const Matrix3d inverse = now.S[i].inverse();
      const Vector3d w = inverse * now.nu[i];
      for (std::size_t k = 0; k < n; ++k) {
        A[k] = inverse * ((moved[k].S[i] - now.S[i]) / step[k]);
        d[k] = (moved[k].nu[i] - now.nu[i]) / step[k];
        gradient[static_cast<Eigen::Index>(k)] += 0.5 * (A[k].trace() - now.nu[i].dot(A[k] * w)) + d[k].dot(w);
        for (std::size_t l = 0; l <= k; ++l) {
          const double term = 0.5 * (A[k].cwiseProduct(A[l].transpose())).sum() + d[k].dot(inverse * d[l]);
          information(static_cast<Eigen::Index>(k), static_cast<Eigen::Index>(l)) += term;
        }
      }
    }
    information = Eigen::MatrixXd(information.selfadjointView<Eigen::Lower>());
    result.information = information;
    // Variances that stand at zero and want to fall are held there.
    std::vector<Eigen::Index> moving;
    for (std::size_t k = 0; k < n; ++k)
      if (s[groups[k][0]] > 0.0 || gradient[static_cast<Eigen::Index>(k)] < 0.0)
        moving.push_back(static_cast<Eigen::Index>(k));
    const Eigen::MatrixXd part = information(moving, moving);
    const Eigen::VectorXd full = part.ldlt().solve(-gradient(moving));
    VelocityLikelihood::Run next;
    NoiseVariances t = s;
    bool better = false;
    double shrink = 1.0;
    for (int attempt = 0; attempt < 4 && !better; ++attempt, shrink *= 0.4) {
      t = s;
      for (std::size_t k = 0; k < moving.size(); ++k)
        moved_by(groups[static_cast<std::size_t>(moving[k])], shrink * full[static_cast<Eigen::Index>(k)], t);
      next = likelihood.run(t, tau, restricted);
      ++result.evaluations;
      better = next.value < now.value + 1e-6;
    }
    if (!better) break;
    const double gained = now.value - next.value;
    s = t;
    now = std::move(next);
    if (gained < 0.05) {
      result.converged = true;
      break;
    }
  }
  result.value = now.value;
  return result;
}

}  // namespace

NoiseFit fit_noise(const CompressedRecording& recording, const Parameters& parameters, const EffectModel& effects,
                   const FilterSetup& setup, const NoiseFitOptions& options) {
  const VelocityLikelihood likelihood(recording, parameters, effects, setup, plausible_ranges(recording.info),
                                      options.seconds_together);
  const double tau = setup.noise.bias_correlation_s;
  NoiseVariances s;
  s << setup.noise.angle_random_walk.cwiseAbs2(), setup.noise.velocity_random_walk.cwiseAbs2(),
      std::pow(setup.noise.gyro_bias_instability_radps, 2), std::pow(setup.noise.accel_bias_instability_mps2, 2);
  NoiseFit fit;

  // One value a triad first: three sensors of a kind. Axes get values of their own where they demonstrably differ.
  const std::vector<Group> triads = {{0, 1, 2}, {3, 4, 5}};
  const std::vector<Group> axes = {{0}, {1}, {2}, {3}, {4}, {5}};
  const bool apart_already = options.near_start && (s.segment<3>(0).maxCoeff() > s.segment<3>(0).minCoeff() ||
                                                    s.segment<3>(3).maxCoeff() > s.segment<3>(3).minCoeff());
  std::vector<Group> walks;
  if (options.random_walks && apart_already) {
    walks = axes;
  } else if (options.random_walks) {
    s.segment<3>(0).setConstant(s.segment<3>(0).mean());
    s.segment<3>(3).setConstant(s.segment<3>(3).mean());
    walks = triads;
  }
  std::vector<Group> groups = walks;
  if (options.bias_instability) groups.insert(groups.end(), {{6}, {7}});
  Scoring scoring;
  if (!options.near_start) {
    scoring = score(likelihood, groups, tau, options.max_iterations, false, s);
    fit.evaluations = scoring.evaluations;
  }
  if (options.random_walks && !options.near_start) {
    // One scoring step with six values shows whether that would say more than chance (4 more degrees of freedom).
    NoiseVariances apart = s;
    const Scoring six = score(likelihood, axes, tau, 1, false, apart);
    fit.evaluations += six.evaluations;
    constexpr double chi_square_4_one_in_1e4 = 23.5;
    if (scoring.value - six.value > chi_square_4_one_in_1e4) {
      fit.axes_differ = true;
      walks = axes;
      groups = walks;
      if (options.bias_instability) groups.insert(groups.end(), {{6}, {7}});
      s = apart;
    }
  }
  // From there the restricted likelihood, which is near and costs more.
  scoring = score(likelihood, groups, tau, options.max_iterations, true, s);
  fit.evaluations += scoring.evaluations;
  for (const int k : {6, 7}) {
    if (s[k] <= 0.0) continue;
    NoiseVariances without = s;
    without[k] = 0.0;
    (k == 6 ? fit.gyro_bias_instability_gain : fit.accel_bias_instability_gain) =
        likelihood.run(without, tau, true).value - scoring.value;
    ++fit.evaluations;
  }
  if (options.random_walks) {  // sigma of a root: half the relative sigma of the variance
    const Eigen::MatrixXd covariance = scoring.information.inverse();
    for (std::size_t g = 0; g < walks.size(); ++g)
      for (const int k : walks[g]) {
        const double sigma =
            0.5 * std::sqrt(covariance(static_cast<Eigen::Index>(g), static_cast<Eigen::Index>(g)) / s[k]);
        (k < 3 ? fit.sigma_angle_random_walk[k] : fit.sigma_velocity_random_walk[k - 3]) = sigma;
      }
  }
  fit.converged = scoring.converged;
  fit.noise = setup.noise;
  fit.noise.angle_random_walk = s.segment<3>(0).cwiseSqrt();
  fit.noise.velocity_random_walk = s.segment<3>(3).cwiseSqrt();
  fit.noise.gyro_bias_instability_radps = std::sqrt(s[6]);
  fit.noise.accel_bias_instability_mps2 = std::sqrt(s[7]);
  return fit;
}

}  // namespace turncal
