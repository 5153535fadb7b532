#include "calib/joint/noise_fit.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "calib/joint/linear_motion.h"
#include "calib/model/limits.h"
#include "calib/statistics/linear_algebra.h"

namespace turncal {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr int walks = 6;    // variances of ARW x y z, VRW x y z
constexpr int sources = 8;  // and of gyro and accelerometer bias instability
using Variances = Eigen::Matrix<double, sources, 1>;

// Variances that move together: one index, or the three axes of a triad.
using Group = std::vector<int>;

// The recording made linear once, and how likely it is under one noise model after another.
class RestrictedLikelihood {
 public:
  struct Run {
    double value = std::numeric_limits<double>::infinity();  // -2 log L_R
    double log_det_information = 0.0;
    std::vector<Innovation> nu;
    std::vector<Matrix3d> S;
    Eigen::MatrixXd covariance;  // of the free parameters
    Eigen::VectorXd estimate;    // of them, from where the recording was made linear
  };

  RestrictedLikelihood(const CompressedRecording& recording, const Parameters& parameters, const EffectModel& effects,
                       const FilterSetup& setup, const std::vector<int>& free, const Eigen::VectorXd& ranges)
      : setup_(setup), free_(free), ranges_(Eigen::VectorXd(ranges(free))) {
    LinearMotion::Options options;
    for (int k = 0; k < walks; ++k) {
      WalkNoise unit;
      (k < 3 ? unit.gyro : unit.accel)[k % 3] = 1.0;
      options.sources.push_back(unit);
    }
    LinearMotion motion(recording, parameters, effects, setup_, options);
    intervals_.reserve(recording.blocks.size());
    for (LinearInterval interval; motion.next(interval);) intervals_.push_back(interval);
    setup_.keep_innovations = true;
  }

  Run operator()(const Variances& s) {
    ++evaluations;
    set(s, setup_.noise);
    const std::vector<double> weights(s.data(), s.data() + walks);
    FilterResult pass = run_filter(intervals_, setup_, weights);
    Run run;
    const Eigen::MatrixXd A =
        ranges_.asDiagonal() * Eigen::MatrixXd(pass.information(free_, free_)) * ranges_.asDiagonal();
    const Eigen::VectorXd c = ranges_.cwiseProduct(Eigen::VectorXd(pass.gradient(free_)));
    const Eigen::MatrixXd with_prior = A + Eigen::MatrixXd::Identity(A.rows(), A.cols());
    const Eigen::VectorXd step = solve_symmetric(with_prior, c, run.log_det_information);
    run.value = pass.chi_square + pass.log_determinant - c.dot(step) + run.log_det_information;
    run.covariance = ranges_.asDiagonal() * solve_symmetric(with_prior, Eigen::MatrixXd(ranges_.asDiagonal()));
    run.estimate = -ranges_.cwiseProduct(step);
    run.nu = std::move(pass.innovations);
    run.S = std::move(pass.covariances);
    return run;
  }

  static void set(const Variances& s, NoiseModel& noise) {
    noise.angle_random_walk = s.segment<3>(0).cwiseSqrt();
    noise.velocity_random_walk = s.segment<3>(3).cwiseSqrt();
    noise.gyro_bias_instability_radps = std::sqrt(s[6]);
    noise.accel_bias_instability_mps2 = std::sqrt(s[7]);
  }

  int evaluations = 0;

 private:
  FilterSetup setup_;
  const std::vector<int> free_;
  const Eigen::VectorXd ranges_;
  std::vector<LinearInterval> intervals_;
};

struct Scoring {
  double value = 0.0;
  bool converged = false;
  Eigen::MatrixXd information;
};

// Fisher scoring of the groups' variances, in place.
Scoring score(RestrictedLikelihood& likelihood, const std::vector<Group>& groups, double tau, int max_iterations,
              Variances& s) {
  const Eigen::Index n = static_cast<Eigen::Index>(groups.size());
  // A bias instability that would move psi as much as the random walk does in tau_b: its natural unit.
  Variances unit = s;
  unit[6] = s.segment<3>(0).mean() / tau;
  unit[7] = s.segment<3>(3).mean() / tau;
  Scoring result;
  RestrictedLikelihood::Run now = likelihood(s);
  const auto moved_by = [&](const Group& group, double delta, Variances& t) {
    for (const int k : group) t[k] = std::max(t[k] + delta, k < walks ? 0.05 * t[k] : 0.0);
  };
  for (int iteration = 0; iteration < max_iterations && n > 0; ++iteration) {
    std::vector<RestrictedLikelihood::Run> moved;
    std::vector<double> step;
    for (const Group& group : groups) {
      Variances t = s;
      step.push_back(0.01 * std::max(s[group[0]], unit[group[0]]));
      moved_by(group, step.back(), t);
      moved.push_back(likelihood(t));
    }
    Eigen::VectorXd gradient = Eigen::VectorXd::Zero(n);
    Eigen::MatrixXd information = Eigen::MatrixXd::Zero(n, n);
    for (Eigen::Index k = 0; k < n; ++k)  // what the parameters take with them
      gradient[k] = 0.5 * (moved[static_cast<std::size_t>(k)].log_det_information - now.log_det_information) /
                    step[static_cast<std::size_t>(k)];
    std::vector<Matrix3d> A(groups.size());
    std::vector<Vector3d> d(groups.size());
    for (std::size_t i = 0; i < now.nu.size(); ++i) {
      const Matrix3d inverse = now.S[i].inverse();
      const Vector3d nu = now.nu[i].velocity_mps;
      const Vector3d w = inverse * nu;
      for (std::size_t k = 0; k < groups.size(); ++k) {
        A[k] = inverse * ((moved[k].S[i] - now.S[i]) / step[k]);
        d[k] = (moved[k].nu[i].velocity_mps - nu) / step[k];
        gradient[static_cast<Eigen::Index>(k)] += 0.5 * (A[k].trace() - nu.dot(A[k] * w)) + d[k].dot(w);
        for (std::size_t l = 0; l <= k; ++l)
          information(static_cast<Eigen::Index>(k), static_cast<Eigen::Index>(l)) +=
              0.5 * (A[k].cwiseProduct(A[l].transpose())).sum() + d[k].dot(inverse * d[l]);
      }
    }
    information = Eigen::MatrixXd(information.selfadjointView<Eigen::Lower>());
    result.information = information;
    // Variances that stand at zero and want to fall are held there.
    std::vector<Eigen::Index> moving;
    for (Eigen::Index k = 0; k < n; ++k)
      if (s[groups[static_cast<std::size_t>(k)][0]] > 0.0 || gradient[k] < 0.0) moving.push_back(k);
    const Eigen::MatrixXd part = information(moving, moving);
    const Eigen::VectorXd full = solve_symmetric(part, Eigen::VectorXd(-gradient(moving)));
    RestrictedLikelihood::Run next;
    Variances t = s;
    bool better = false;
    double shrink = 1.0;
    for (int attempt = 0; attempt < 4 && !better; ++attempt, shrink *= 0.4) {
      t = s;
      for (std::size_t k = 0; k < moving.size(); ++k)
        moved_by(groups[static_cast<std::size_t>(moving[k])], shrink * full[static_cast<Eigen::Index>(k)], t);
      next = likelihood(t);
      better = next.value < now.value + 1e-6;
    }
    if (!better) {  // there already, when scoring did not expect to gain anything to speak of
      result.converged = -gradient(moving).dot(full) < 0.5;
      break;
    }
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

// What an instability that was not kept adds to the covariance all the same: the mean over what it may be, weighed by
// likelihood and prior, less the covariance without it.
Eigen::MatrixXd unseen_instability(RestrictedLikelihood& likelihood, const RestrictedLikelihood::Run& without,
                                   const Variances& s, int triad, double tau) {
  const double usual = triad == 0 ? noise_limits.usual_gyro : noise_limits.usual_accel;
  constexpr std::array sizes = {0.8, 1.6, 2.6, 4.0, 6.0};  // of the usual one
  const double unit = usual * usual * s.segment<3>(3 * triad).mean() / tau;
  double sum = 0.5 * sizes[0];  // of the weights, with none: the first of the trapezoids' corners
  Eigen::MatrixXd more = Eigen::MatrixXd::Zero(without.covariance.rows(), without.covariance.cols());
  for (std::size_t k = 0; k < sizes.size(); ++k) {
    Variances t = s;
    t[6 + triad] = sizes[k] * sizes[k] * unit;
    const RestrictedLikelihood::Run run = likelihood(t);
    const double width = 0.5 * (sizes[std::min(k + 1, sizes.size() - 1)] - (k == 0 ? 0.0 : sizes[k - 1]));
    const double weight = width * std::exp(0.5 * (without.value - run.value)) / (1.0 + sizes[k] * sizes[k]);
    const Eigen::VectorXd moved = run.estimate - without.estimate;
    more += weight * (run.covariance - without.covariance + moved * moved.transpose());
    sum += weight;
  }
  return more / sum;
}

bool differ(const Vector3d& values) { return values.maxCoeff() > values.minCoeff(); }

}  // namespace

NoiseFit fit_noise(const CompressedRecording& recording, const Parameters& parameters, const EffectModel& effects,
                   const FilterSetup& setup, const std::vector<int>& free, const Eigen::VectorXd& ranges,
                   const NoiseFitOptions& options) {
  RestrictedLikelihood likelihood(recording, parameters, effects, setup, free, ranges);
  const double tau = setup.noise.bias_correlation_s;
  Variances s;
  s << setup.noise.angle_random_walk.cwiseAbs2(), setup.noise.velocity_random_walk.cwiseAbs2(),
      std::pow(setup.noise.gyro_bias_instability_radps, 2), std::pow(setup.noise.accel_bias_instability_mps2, 2);
  NoiseFit fit;

  // One value a triad first: three sensors of a kind. Axes get values of their own where they demonstrably differ.
  const std::vector<Group> triads = {{0, 1, 2}, {3, 4, 5}};
  const std::vector<Group> axes = {{0}, {1}, {2}, {3}, {4}, {5}};
  std::vector<Group> groups;
  const auto estimate = [&](const std::vector<Group>& of_walks, bool gyro_instability, bool accel_instability) {
    groups = of_walks;
    if (gyro_instability) groups.push_back({6});
    if (accel_instability) groups.push_back({7});
    return score(likelihood, groups, tau, options.max_iterations, s);
  };
  std::vector<Group> of_walks;
  if (options.random_walks) of_walks = triads;
  if (options.random_walks && options.near_start && (differ(s.segment<3>(0)) || differ(s.segment<3>(3))))
    of_walks = axes;
  else if (options.random_walks)
    for (const int k : {0, 3}) s.segment<3>(k).setConstant(s.segment<3>(k).mean());
  Scoring scoring = estimate(of_walks, options.bias_instability, options.bias_instability);
  if (options.random_walks && !options.near_start) {
    // One scoring step with six values shows whether that would say more than chance (4 more degrees of freedom).
    Variances apart = s;
    const Scoring six = score(likelihood, axes, tau, 1, apart);
    if (scoring.value - six.value > noise_limits.axes_differ) {
      fit.axes_differ = true;
      of_walks = axes;
      s = apart;
      scoring = estimate(of_walks, options.bias_instability, options.bias_instability);
    }
  }
  // Is each instability there? The likelihood without it, everything else fitted again.
  bool kept[2] = {s[6] > 0.0, s[7] > 0.0};
  for (const int triad : {0, 1}) {
    if (!kept[triad]) continue;
    const Variances with = s;
    s[6 + triad] = 0.0;
    const Scoring without = estimate(of_walks, triad == 1 && kept[0], triad == 0 && kept[1]);
    const double gain = without.value - scoring.value;
    (triad == 0 ? fit.gyro_bias_instability_gain : fit.accel_bias_instability_gain) = gain;
    if (gain > noise_limits.instability_gain) {
      s = with;
    } else {
      kept[triad] = false;
      scoring = without;
    }
  }
  if (options.random_walks) {  // sigma of a root: half the relative sigma of the variance
    const Eigen::MatrixXd covariance = inverse(scoring.information);
    for (std::size_t g = 0; g < of_walks.size(); ++g)
      for (const int k : of_walks[g]) {
        const double sigma =
            0.5 * std::sqrt(covariance(static_cast<Eigen::Index>(g), static_cast<Eigen::Index>(g)) / s[k]);
        (k < 3 ? fit.sigma_angle_random_walk[k] : fit.sigma_velocity_random_walk[k - 3]) = sigma;
      }
  }
  const Eigen::Index count = static_cast<Eigen::Index>(free.size());
  fit.unseen_instability = Eigen::MatrixXd::Zero(count, count);
  if (options.bias_instability && !options.near_start && !(kept[0] && kept[1])) {
    const RestrictedLikelihood::Run without = likelihood(s);
    for (const int triad : {0, 1})
      if (!kept[triad]) fit.unseen_instability += unseen_instability(likelihood, without, s, triad, tau);
  }
  fit.converged = scoring.converged;
  fit.evaluations = likelihood.evaluations;
  fit.noise = setup.noise;
  RestrictedLikelihood::set(s, fit.noise);
  return fit;
}

}  // namespace turncal
