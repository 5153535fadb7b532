#include "calib/joint/noise_fit.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

#include "calib/joint/linear_motion.h"
#include "calib/model/limits.h"
#include "calib/statistics/numerics.h"

namespace turncal {

namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double of_sure = 4.0;  // times instability_gain: an instability that gains so much is certain
constexpr int walks = 6;         // variances of ARW x y z, VRW x y z
constexpr int sources = 8;       // then those of gyro and accelerometer bias instability
using Variances = Eigen::Matrix<double, sources, 1>;

// Variances that move together: one index, or the three axes of a triad.
using Group = std::vector<int>;

// The linearised recording, and its likelihood under one noise model after another.
class RestrictedLikelihood {
 public:
  struct Run {
    double value = std::numeric_limits<double>::infinity();  // -2 log L_R
    double log_det_information = 0.0;
    std::vector<Vector3d> nu;  // m/s
    std::vector<Matrix3d> S;
    Eigen::MatrixXd covariance;  // of the free parameters
    Eigen::VectorXd estimate;    // of them, from the point of linearisation
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
    run.nu.reserve(pass.innovations.size());
    for (const Innovation& one : pass.innovations) run.nu.push_back(one.velocity_mps);
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

// Fisher scoring of the groups' variances: gradient of -ln L_R and information.
struct Derivatives {
  VectorXd gradient;
  MatrixXd information;
};

// Returns the variance of a bias instability that moves psi as much as the random walk does in tau_b: its natural unit.
double natural_unit(const Variances& s, int k, double tau) { return s.segment<3>(k == 6 ? 0 : 3).mean() / tau; }

void move(const Group& group, double delta, Variances& s) {
  for (const int k : group) s[k] = std::max(s[k] + delta, k < walks ? 0.05 * s[k] : 0.0);
}

// Computes the derivatives by differences, one run per group. `now`: the run at s.
Derivatives derivatives(RestrictedLikelihood& likelihood, const RestrictedLikelihood::Run& now,
                        const std::vector<Group>& groups, double tau, const Variances& s) {
  const Eigen::Index n = groups.size();
  std::vector<RestrictedLikelihood::Run> moved;
  std::vector<double> step;
  for (const Group& group : groups) {
    Variances t = s;
    const int k = group[0];
    step.push_back(0.01 * (k < walks ? s[k] : std::max(s[k], natural_unit(s, k, tau))));
    move(group, step.back(), t);
    moved.push_back(likelihood(t));
  }
  Derivatives result = {VectorXd::Zero(n), MatrixXd::Zero(n, n)};
  for (Eigen::Index k = 0; k < n; ++k)  // part of the parameters' information
    result.gradient[k] = 0.5 * (moved[k].log_det_information - now.log_det_information) / step[k];
  std::vector<Matrix3d> A(groups.size());
  std::vector<Vector3d> d(groups.size());
  for (std::size_t i = 0; i < now.nu.size(); ++i) {
    const Matrix3d inverse = now.S[i].inverse();
    const Vector3d& nu = now.nu[i];
    const Vector3d w = inverse * nu;
    for (std::size_t k = 0; k < groups.size(); ++k) {
      A[k] = inverse * ((moved[k].S[i] - now.S[i]) / step[k]);
      d[k] = (moved[k].nu[i] - nu) / step[k];
      result.gradient[k] += 0.5 * (A[k].trace() - nu.dot(A[k] * w)) + d[k].dot(w);
      for (std::size_t l = 0; l <= k; ++l)
        result.information(k, l) += 0.5 * (A[k].cwiseProduct(A[l].transpose())).sum() + d[k].dot(inverse * d[l]);
    }
  }
  result.information = MatrixXd(result.information.selfadjointView<Eigen::Lower>());
  return result;
}

// Sums derivatives over larger groups, each a union of some of `groups`.
Derivatives together(const Derivatives& d, const std::vector<Group>& groups, const std::vector<Group>& larger) {
  MatrixXd in = MatrixXd::Zero(d.gradient.size(), larger.size());
  for (std::size_t k = 0; k < groups.size(); ++k)
    for (std::size_t l = 0; l < larger.size(); ++l)
      if (std::ranges::find(larger[l], groups[k][0]) != larger[l].end()) in(k, l) = 1.0;
  return {in.transpose() * d.gradient, in.transpose() * d.information * in};
}

// The step of Fisher scoring, and the fall of -2 ln L_R were it quadratic. Variances at zero that would fall are held
// there.
struct Suggestion {
  VectorXd step;
  double gain = 0.0;
};
Suggestion suggested(const Derivatives& d, const std::vector<Group>& groups, const Variances& s) {
  std::vector<Eigen::Index> moving;
  for (Eigen::Index k = 0; k < d.gradient.size(); ++k)
    if (s[groups[k][0]] > 0.0 || d.gradient[k] < 0.0) moving.push_back(k);
  Suggestion result = {VectorXd::Zero(d.gradient.size())};
  if (moving.empty()) return result;
  const VectorXd gradient = d.gradient(moving);
  const VectorXd step = solve_symmetric(MatrixXd(d.information(moving, moving)), VectorXd(-gradient));
  result.step(moving) = step;
  result.gain = -gradient.dot(step);
  return result;
}

struct Scoring {
  double value = 0.0;
  bool converged = false;
  MatrixXd information;
};

// Fisher scoring of the groups' variances, in place. It ends where the likelihood follows the quadratic prediction, since what remains is
// of the order of their difference, or where -2 ln L_R is certain to stay above `enough`. `now`: the run at s, on entry and on return.
constexpr int most_iterations = 6;
Scoring score(RestrictedLikelihood& likelihood, const std::vector<Group>& groups, double tau, int max_iterations,
              Variances& s, RestrictedLikelihood::Run& now, double enough = std::numeric_limits<double>::infinity()) {
  constexpr double nothing = 0.0005, little = 0.2;  // of 2 ln L: a failed step for so little is not retried
  Scoring result;
  result.converged = groups.empty();
  for (int iteration = 0; iteration < max_iterations && !result.converged; ++iteration) {
    const Derivatives d = derivatives(likelihood, now, groups, tau, s);
    result.information = d.information;
    const Suggestion to = suggested(d, groups, s);
    if (to.gain < nothing || now.value - 2.0 * to.gain > enough) {
      result.converged = true;
      break;
    }
    RestrictedLikelihood::Run next;
    Variances t = s;
    bool better = false;
    double shrink = 1.0;
    for (int attempt = 0; attempt < 4 && !better; ++attempt, shrink *= 0.4) {
      t = s;
      for (std::size_t k = 0; k < groups.size(); ++k) move(groups[k], shrink * to.step[k], t);
      next = likelihood(t);
      better = next.value < now.value + 1e-6;
      if (to.gain < little) break;
    }
    if (!better) {  // converged already, if scoring expected hardly any gain
      result.converged = to.gain < 0.5;
      break;
    }
    const double gained = now.value - next.value;
    result.converged = gained < 0.05 || std::abs(gained - to.gain) < nothing;
    s = t;
    now = std::move(next);
  }
  result.value = now.value;
  return result;
}

// Returns what an instability that was not kept still adds to the covariance: the mean over its possible sizes,
// weighted by likelihood and prior, less the covariance without it.
Eigen::MatrixXd unseen_instability(RestrictedLikelihood& likelihood, const RestrictedLikelihood::Run& without,
                                   const Variances& s, int triad, double tau) {
  const double usual = triad == 0 ? noise_limits.usual_gyro : noise_limits.usual_accel;
  constexpr std::array sizes = {0.8, 1.6, 2.6, 4.0, 6.0};  // of the usual one
  const double unit = usual * usual * s.segment<3>(3 * triad).mean() / tau;
  double sum = 0.5 * sizes[0];  // of the weights, with none: the first corner of the trapezoids
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
    if (weight < 1e-3 * sum) break;  // a larger one has at most a tenth of that
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

  // First one value per triad, since its sensors are of a kind. Axes get values of their own where they demonstrably differ.
  const std::vector<Group> axes = {{0}, {1}, {2}, {3}, {4}, {5}};
  std::vector<Group> of_walks = {{0, 1, 2}, {3, 4, 5}};
  if (options.near_start && (differ(s.segment<3>(0)) || differ(s.segment<3>(3))))
    of_walks = axes;
  else
    for (const int k : {0, 3}) s.segment<3>(k).setConstant(s.segment<3>(k).mean());
  RestrictedLikelihood::Run now = likelihood(s);
  const auto with_instability = [&](bool gyro, bool accel) {
    std::vector<Group> groups = of_walks;
    if (gyro) groups.push_back({6});
    if (accel) groups.push_back({7});
    return groups;
  };
  const auto estimate = [&](bool gyro_instability, bool accel_instability,
                            double enough = std::numeric_limits<double>::infinity()) {
    return score(likelihood, with_instability(gyro_instability, accel_instability), tau, most_iterations, s, now,
                 enough);
  };
  bool look_for_instability = options.bias_instability;
  bool axes_may_differ = !options.near_start, axes_promise_more = false;
  const bool none_yet = s[6] == 0.0 && s[7] == 0.0;
  // The walks alone first: six states, not twelve.
  Scoring scoring;
  if (none_yet && !(options.near_start && look_for_instability)) scoring = estimate(false, false);
  // At their optimum the score shows whether an instability, or a value per axis, could gain anything to speak of.
  if (none_yet && (look_for_instability || axes_may_differ)) {
    std::vector<Group> finest = axes_may_differ ? axes : of_walks;
    if (look_for_instability) finest.insert(finest.end(), {{6}, {7}});
    const Derivatives all = derivatives(likelihood, now, finest, tau, s);
    const auto gain = [&](const std::vector<Group>& groups) {
      return suggested(together(all, finest, groups), groups, s).gain;
    };
    const double of_walks_alone = gain(of_walks);
    const auto may_pass = [&](double limit, const std::vector<Group>& groups) {
      return gain(groups) - of_walks_alone > noise_limits.worth_a_look * limit;
    };
    look_for_instability =
        look_for_instability && may_pass(noise_limits.instability_gain, with_instability(true, true));
    axes_may_differ = axes_may_differ && may_pass(noise_limits.axes_differ, axes);
    const bool surely_an_instability = look_for_instability && gain(with_instability(true, true)) - of_walks_alone >
                                                                   of_sure * noise_limits.instability_gain;
    axes_promise_more = axes_may_differ && !surely_an_instability;
    if (!look_for_instability && options.near_start) scoring = estimate(false, false);
  }
  // Do six values gain more than chance (4 more degrees of freedom)? One step may fall short of their gain: one axis
  // may have a sixteenth of another's variance.
  const auto take_axes_that_differ = [&](int steps) {
    axes_may_differ = false;
    Variances apart = s;
    RestrictedLikelihood::Run run = now;
    const Scoring six = score(likelihood, axes, tau, steps, apart, run);
    if (scoring.value - six.value <= noise_limits.axes_differ) return;
    fit.axes_differ = true;
    of_walks = axes;
    s = apart;
    now = std::move(run);
    if (!look_for_instability) scoring = six;
  };
  // Tried before a marginal instability, which would absorb part of the axes' gain and be dropped afterwards.
  if (axes_may_differ && axes_promise_more) take_axes_that_differ(4);
  if (look_for_instability) scoring = estimate(true, true);
  if (axes_may_differ) {
    take_axes_that_differ(1);
    if (fit.axes_differ) scoring = estimate(options.bias_instability, options.bias_instability);
  }
  // Is each instability there? Compares the likelihood without it, with everything else fitted again.
  bool kept[2] = {s[6] > 0.0, s[7] > 0.0};
  for (const int triad : {0, 1}) {
    if (!kept[triad]) continue;
    const Variances with = s;
    RestrictedLikelihood::Run run_with = std::move(now);
    s[6 + triad] = 0.0;
    now = likelihood(s);
    const double surely_there = scoring.value + of_sure * noise_limits.instability_gain;
    const Scoring without = estimate(triad == 1 && kept[0], triad == 0 && kept[1], surely_there);
    if (without.value - scoring.value > noise_limits.instability_gain) {
      s = with;
      now = std::move(run_with);
    } else {
      kept[triad] = false;
      scoring = without;
    }
  }
  const Eigen::MatrixXd covariance = inverse(scoring.information);
  for (std::size_t g = 0; g < of_walks.size(); ++g)  // sigma of a root: half the relative sigma of the variance
    for (const int k : of_walks[g])
      (k < 3 ? fit.sigma_angle_random_walk : fit.sigma_velocity_random_walk)[k % 3] =
          0.5 * std::sqrt(covariance(g, g) / s[k]);
  const Eigen::Index count = free.size();
  fit.unseen_instability = Eigen::MatrixXd::Zero(count, count);
  for (const int triad : {0, 1})
    if (options.bias_instability && !options.near_start && !kept[triad])
      fit.unseen_instability += unseen_instability(likelihood, now, s, triad, tau);
  fit.converged = scoring.converged;
  fit.evaluations = likelihood.evaluations;
  fit.noise = setup.noise;
  RestrictedLikelihood::set(s, fit.noise);
  return fit;
}

Eigen::VectorXd pull_of_noise(const CompressedRecording& recording, const Parameters& parameters,
                              const EffectModel& effects, const FilterSetup& at, const std::vector<int>& free,
                              const Eigen::MatrixXd& covariance) {
  constexpr double step = 0.01;        // of a variance
  constexpr double negligible = 0.01;  // of a sigma
  const ParameterVector values = to_vector(parameters);
  const double all = double(std::ranges::count_if(recording.blocks, [](const Block& b) { return b.whole_second; }));
  Eigen::VectorXd pull = Eigen::VectorXd::Zero(parameter_count);
  std::optional<double> log_determinant;
  const auto pass = [&](const NoiseModel& noise) {
    FilterSetup setup = at;
    setup.with_columns = false;
    setup.noise = noise;
    return run_filter(recording, parameters, effects, setup).log_determinant;
  };
  for (std::size_t k = 0; k < scale_factor_parameters.size(); ++k) {
    const auto found = std::ranges::find(free, scale_factor_parameters[k]);
    if (found == free.end()) continue;
    const auto row = found - free.begin();
    const double sigma = std::sqrt(covariance(row, row));
    const double value = values[scale_factor_parameters[k]];
    if (3.0 * all * sigma < negligible * std::abs(value)) continue;  // bound: as if S were all of this sensor
    if (!log_determinant) log_determinant = pass(at.noise);
    NoiseModel louder = at.noise;
    (k < 3 ? louder.angle_random_walk : louder.velocity_random_walk)[k % 3] *= std::sqrt(1.0 + step);
    pull[scale_factor_parameters[k]] = (pass(louder) - *log_determinant) / step / value;
  }
  return pull;
}

NoiseModel start_noise(const CompressedRecording& recording, const AllanResult& allan, const Parameters& from) {
  NoiseModel noise;
  const SensorModel model = sensor_model(from, recording.info);
  const bool gyro_pulses = recording.info.gyro_increment == IncrementKind::pulses;
  const bool accel_pulses = recording.info.accel_increment == IncrementKind::pulses;
  if (gyro_pulses) noise.gyro_pulse_rad = model.gyro_scale(0, 0);
  if (accel_pulses) noise.accel_pulse_mps = recording.info.accel_pulse_mps;
  // The noisiest axis of a triad stands for all three: in dwells of 100 s an axis that counts close to a whole number
  // of pulses per sample can look three times too quiet, and its later noise would be taken for faults.
  double gyro = gyro_pulses ? 0.02 * noise.gyro_pulse_rad : 1e-9;
  double accel = accel_pulses ? 0.02 * noise.accel_pulse_mps : 1e-8;
  // Where no dwell is long enough for the fit: the difference of neighbouring seconds, quantisation included.
  constexpr double shortest_dwell_s = 3.0;
  const bool fitted = allan.total_s > 0.0;
  const AllanResult brief = fitted ? allan : allan_deviation(recording, from, shortest_dwell_s);
  const auto random_walk = [&](const AllanAxis& axis) {
    const AllanCoefficient& walk = axis.fit.random_walk();
    if (axis.fit.made || axis.points.empty()) return walk.value > 0.0 ? walk.value : walk.limit;
    return axis.points.front().deviation * std::sqrt(axis.points.front().tau_s);
  };
  for (std::size_t k = 0; k < 3; ++k) {
    gyro = std::max(gyro, random_walk(brief.axes[k]));
    accel = std::max(accel, random_walk(brief.axes[k + 3]));
  }
  noise.angle_random_walk.setConstant(gyro);
  noise.velocity_random_walk.setConstant(accel);
  return noise;
}

}  // namespace turncal
