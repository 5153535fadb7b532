#include "calib/noise_fit.h"

#include <algorithm>
#include <array>
#include <cmath>

#include <Eigen/Dense>

#include "calib/motion_step.h"

namespace turncal {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Matrix12 = Eigen::Matrix<double, 12, 12>;

constexpr int sources = 8;  // ARW x y z, VRW x y z, gyro bias instability, accelerometer bias instability

struct Interval {
  bool observed = false;
  double t = 0.0;
  double cut_tilt = 0.0, cut_heading = 0.0, cut_velocity = 0.0;  // variances added before the interval (a break)
  // observed: evaluated from these
  Matrix3d C, F, turn;
  Vector3d y = Vector3d::Zero();         // open-loop mean velocity: should be zero
  Vector3d quantisation = Vector3d::Zero();
  // not observed: transition of (psi, v), of the biases into it, and the noise of each unit walk
  Matrix6 phi = Matrix6::Identity();
  Matrix6 gamma = Matrix6::Zero();
  std::array<Matrix6, 6> q{};
};

class Likelihood {
 public:
  Likelihood(const CompressedRecording& recording, const Parameters& parameters, const EffectModel& effects,
             const FilterSetup& setup, int seconds_together);
  // Innovations and root of their covariance for given variances; returns -2 log L.
  struct Run {
    double value = 0.0;
    std::vector<Vector3d> nu;
    std::vector<Matrix3d> S;
  };
  Run run(const Eigen::Matrix<double, sources, 1>& variances, double tau_b) const;

 private:
  void add_motion(const BlockMotion& motion, double t, Interval& interval);
  std::vector<Interval> intervals_;
  FilterSetup setup_;
  Matrix3d C_nb_;
  Vector3d v_ = Vector3d::Zero();
  Vector3d earth_;
  double gravity_;
};

// Adds one block to an unobserved interval.
void Likelihood::add_motion(const BlockMotion& motion, double t, Interval& interval) {
  const MotionStep move = motion_step(C_nb_, motion, earth_, gravity_, t);
  Matrix6 phi = Matrix6::Identity();
  phi.topLeftCorner<3, 3>() = move.turn_n;
  phi.bottomLeftCorner<3, 3>() = -move.F * t;
  Matrix6 gamma = Matrix6::Zero();
  gamma.topLeftCorner<3, 3>() = move.C_mid * t;
  gamma.bottomLeftCorner<3, 3>() = -move.F * move.C_mid * (0.5 * t * t);
  gamma.bottomRightCorner<3, 3>() = move.C_mid * t;
  for (int k = 0; k < 6; ++k) {
    const Vector3d axis = move.C_mid.col(k % 3);
    const Matrix3d unit = axis * axis.transpose();
    const StepNoise n = k < 3 ? step_noise(unit, Matrix3d::Zero(), move.F, t) : step_noise(Matrix3d::Zero(), unit, move.F, t);
    Matrix6 q;
    q << n.psi_psi, n.psi_v, n.psi_v.transpose(), n.v_v;
    interval.q[static_cast<std::size_t>(k)] = phi * interval.q[static_cast<std::size_t>(k)] * phi.transpose() + q;
  }
  interval.phi = phi * interval.phi;
  interval.gamma = phi * interval.gamma + gamma;
  interval.t += t;
  C_nb_ = move.C_end;
  v_ += move.dv_n;
}

Likelihood::Likelihood(const CompressedRecording& recording, const Parameters& parameters, const EffectModel& effects,
                       const FilterSetup& setup, int seconds_together)
    : setup_(setup), earth_(earth_rate_n(recording.info.latitude_deg)), gravity_(recording.info.gravity_mps2) {
  // The motion of every block with the model's effects taken off is what the filter itself navigates on.
  FilterSetup once = setup;
  once.noise.gyro_bias_instability_radps = once.noise.accel_bias_instability_mps2 = 0.0;
  once.with_columns = false;
  once.keep_motions = true;
  const FilterResult nominal = run_filter(recording, parameters, effects, once);
  const std::vector<BlockMotion>& motions = nominal.motions;
  C_nb_ = nominal.initial_C_nb;
  const double period = recording.info.sample_period_s;
  const SensorModel model = sensor_model(parameters, recording.info);
  auto cut = setup.breaks.begin();
  for (std::size_t index = 0; index < recording.blocks.size();) {
    Interval interval;
    for (Matrix6& q : interval.q) q.setZero();
    for (; cut != setup.breaks.end() && cut->block <= index; ++cut) {
      interval.cut_tilt += cut->tilt_sigma_rad * cut->tilt_sigma_rad;
      interval.cut_heading += cut->heading_sigma_rad * cut->heading_sigma_rad;
      interval.cut_velocity += cut->velocity_sigma_mps * cut->velocity_sigma_mps;
    }
    const auto may_join = [&](std::size_t k) {
      return cut == setup.breaks.end() || cut->block != k;
    };
    const auto observed = [&](std::size_t k) {
      return recording.blocks[k].whole_second && (setup.unobserved.empty() || !setup.unobserved[k]);
    };
    if (!observed(index)) {
      const std::size_t first = index;
      while (index < recording.blocks.size() && !observed(index) && (index == first || may_join(index))) {
        add_motion(motions[index], recording.blocks[index].duration_s, interval);
        ++index;
      }
      intervals_.push_back(interval);
      continue;
    }
    Block block = recording.blocks[index];
    BlockMotion taken_off = evaluate(block, model, period);  // what effects change, kept as a difference
    Vector3d turn = taken_off.rotation - motions[index].rotation;
    Vector3d push = taken_off.velocity - motions[index].velocity;
    for (++index; index < recording.blocks.size() && observed(index) && may_join(index) &&
                  recording.blocks[index].segment == block.segment && block.duration_s < seconds_together - 0.5;
         ++index) {
      const BlockMotion plain = evaluate(recording.blocks[index], model, period);
      turn += plain.rotation - motions[index].rotation;
      push += plain.velocity - motions[index].velocity;
      block = merge(block, recording.blocks[index]);
    }
    BlockMotion motion = evaluate(block, model, period);
    motion.rotation -= turn;
    motion.velocity -= push;
    motion.mean_velocity -= 0.5 * push;
    const MotionStep move = motion_step(C_nb_, motion, earth_, gravity_, block.duration_s);
    interval.observed = true;
    interval.t = block.duration_s;
    interval.C = move.C_mid;
    interval.F = move.F;
    interval.turn = move.turn_n;
    interval.y = v_ + move.mean_dv_n;
    if (setup.noise.accel_pulse_mps > 0.0)
      for (int axis = 0; axis < 3; ++axis)
        interval.quantisation[axis] = quantisation_variance(block.accel[axis], block.samples, setup.noise.accel_pulse_mps);
    intervals_.push_back(interval);
    C_nb_ = move.C_end;
    v_ += move.dv_n;
  }
}

Likelihood::Run Likelihood::run(const Eigen::Matrix<double, sources, 1>& s, double tau_b) const {
  Run out;
  out.nu.reserve(intervals_.size());
  out.S.reserve(intervals_.size());
  Matrix6 P = Matrix6::Zero();    // (psi, v)
  Matrix6 M = Matrix6::Zero();    // cov((psi, v), (b_g, b_a))
  Matrix6 B = Matrix6::Zero();    // cov of the biases
  P.diagonal().head<3>() << std::pow(setup_.initial_tilt_sigma_rad, 2), std::pow(setup_.initial_heading_sigma_rad, 2),
      std::pow(setup_.initial_tilt_sigma_rad, 2);
  P.diagonal().tail<3>().setConstant(std::pow(setup_.initial_velocity_sigma_mps, 2));
  Eigen::Matrix<double, 6, 1> stationary;
  stationary << s[6], s[6], s[6], s[7], s[7], s[7];
  B.diagonal() = stationary;
  Eigen::Matrix<double, 6, 1> x = Eigen::Matrix<double, 6, 1>::Zero();
  Eigen::Matrix<double, 6, 1> b = Eigen::Matrix<double, 6, 1>::Zero();
  const bool biases = s[6] > 0.0 || s[7] > 0.0;
  for (const Interval& i : intervals_) {
    P.diagonal().head<3>() += Vector3d(i.cut_tilt, i.cut_heading, i.cut_tilt);
    P.diagonal().tail<3>().array() += i.cut_velocity;
    const double rho = std::exp(-i.t / tau_b);
    Matrix6 phi, gamma, q;
    if (i.observed) {
      phi.setIdentity();
      phi.topLeftCorner<3, 3>() = i.turn;
      phi.bottomLeftCorner<3, 3>() = -i.F * i.t;
      const Matrix3d W = i.C * s.segment<3>(0).asDiagonal() * i.C.transpose();
      const Matrix3d V = i.C * s.segment<3>(3).asDiagonal() * i.C.transpose();
      const StepNoise n = step_noise(W, V, i.F, i.t);
      q << n.psi_psi, n.psi_v, n.psi_v.transpose(), n.v_v;
      Eigen::Matrix<double, 3, 6> H;
      H << -i.F * (0.5 * i.t), Matrix3d::Identity();
      Eigen::Matrix<double, 6, 3> PH = P * H.transpose();
      Eigen::Matrix<double, 6, 3> MH = Eigen::Matrix<double, 6, 3>::Zero();  // cov(bias, z)
      Eigen::Matrix<double, 3, 6> G;
      if (biases) {
        gamma.setZero();
        gamma.topLeftCorner<3, 3>() = i.C * i.t;
        gamma.bottomLeftCorner<3, 3>() = -i.F * i.C * (0.5 * i.t * i.t);
        gamma.bottomRightCorner<3, 3>() = i.C * i.t;
        G << -i.F * i.C * (i.t * i.t / 6.0), i.C * (0.5 * i.t);
        PH += M * G.transpose();
        MH = M.transpose() * H.transpose() + B * G.transpose();
      }
      Matrix3d S = H * PH + n.z_z + i.C * i.quantisation.asDiagonal() * i.C.transpose();
      Eigen::Matrix<double, 6, 3> cross = phi * PH;
      if (biases) {
        S += G * MH;
        cross += gamma * MH;
      }
      cross.topRows<3>() += n.psi_z;
      cross.bottomRows<3>() += n.v_z;
      Vector3d nu = i.y + H * x;
      if (biases) nu += G * b;
      const Eigen::LLT<Matrix3d> root(S);
      out.value += nu.dot(root.solve(nu)) + 2.0 * root.matrixLLT().diagonal().array().log().sum();
      out.nu.push_back(nu);
      out.S.push_back(S);
      // time update and update in one
      const Eigen::Matrix<double, 6, 3> K = root.solve(cross.transpose()).transpose();
      if (biases) {
        x = (phi * x + gamma * b).eval();
        const Matrix6 gM = gamma * M.transpose() * phi.transpose();
        P = (phi * P * phi.transpose() + gM + gM.transpose() + gamma * B * gamma.transpose() + q).eval();
        M = (rho * (phi * M + gamma * B)).eval();
        const Eigen::Matrix<double, 6, 3> Kb = rho * root.solve(MH.transpose()).transpose();
        M.noalias() -= K * (rho * MH).transpose();
        B *= rho * rho;
        B.diagonal() += (1.0 - rho * rho) * stationary;
        B.noalias() -= Kb * (rho * MH).transpose();
        b = (rho * b - Kb * nu).eval();
      } else {
        x = (phi * x).eval();
        P = (phi * P * phi.transpose() + q).eval();
      }
      P.noalias() -= K * cross.transpose();
      x -= K * nu;
    } else {
      q.setZero();
      for (int k = 0; k < 6; ++k) q += s[k] * i.q[static_cast<std::size_t>(k)];
      x = (i.phi * x).eval();
      P = (i.phi * P * i.phi.transpose() + q).eval();
      if (biases) {
        x += i.gamma * b;
        const Matrix6 gM = i.gamma * M.transpose() * i.phi.transpose();
        P += gM + gM.transpose() + i.gamma * B * i.gamma.transpose();
        M = (rho * (i.phi * M + i.gamma * B)).eval();
        B *= rho * rho;
        B.diagonal() += (1.0 - rho * rho) * stationary;
        b *= rho;
      }
    }
  }
  return out;
}

// Variances that move together: one index, or the three axes of a triad.
using Group = std::vector<int>;

// Fisher scoring of the groups' variances, in place; -2 log L and the last information matrix come back.
struct Scoring {
  double value = 0.0;
  bool converged = false;
  int evaluations = 0;
  Eigen::MatrixXd information;
};
Scoring score(const Likelihood& likelihood, const std::vector<Group>& groups, double tau, int max_iterations,
              Eigen::Matrix<double, sources, 1>& s) {
  using Variances = Eigen::Matrix<double, sources, 1>;
  const std::size_t n = groups.size();
  // A bias instability that would move psi as much as the random walk does in tau_b: its natural unit.
  Variances unit = s;
  unit[6] = s.segment<3>(0).mean() / tau;
  unit[7] = s.segment<3>(3).mean() / tau;
  Scoring result;
  Likelihood::Run now = likelihood.run(s, tau);
  ++result.evaluations;
  const auto moved_by = [&](const Group& group, double delta, Variances& t) {
    for (const int k : group) t[k] = std::max(t[k] + delta, k < 6 ? 0.05 * t[k] : 0.0);
  };
  for (int iteration = 0; iteration < max_iterations && n > 0; ++iteration) {
    std::vector<Likelihood::Run> moved;
    std::vector<double> step;
    for (const Group& group : groups) {
      Variances t = s;
      step.push_back(0.01 * std::max(s[group[0]], unit[group[0]]));
      moved_by(group, step.back(), t);
      moved.push_back(likelihood.run(t, tau));
      ++result.evaluations;
    }
    Eigen::VectorXd gradient = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(n));
    Eigen::MatrixXd information = Eigen::MatrixXd::Zero(gradient.size(), gradient.size());
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
      if (s[groups[k][0]] > 0.0 || gradient[static_cast<Eigen::Index>(k)] < 0.0) moving.push_back(static_cast<Eigen::Index>(k));
    const Eigen::MatrixXd part = information(moving, moving);
    const Eigen::VectorXd full = part.ldlt().solve(-gradient(moving));
    Likelihood::Run next;
    Variances t = s;
    bool better = false;
    double shrink = 1.0;
    for (int attempt = 0; attempt < 4 && !better; ++attempt, shrink *= 0.4) {
      t = s;
      for (std::size_t k = 0; k < moving.size(); ++k)
        moved_by(groups[static_cast<std::size_t>(moving[k])], shrink * full[static_cast<Eigen::Index>(k)], t);
      next = likelihood.run(t, tau);
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
  const Likelihood likelihood(recording, parameters, effects, setup, options.seconds_together);
  const double tau = setup.noise.bias_correlation_s;
  Eigen::Matrix<double, sources, 1> s;
  s << setup.noise.angle_random_walk.cwiseAbs2(), setup.noise.velocity_random_walk.cwiseAbs2(),
      std::pow(setup.noise.gyro_bias_instability_radps, 2), std::pow(setup.noise.accel_bias_instability_mps2, 2);
  NoiseFit fit;
  const double start_value = likelihood.run(s, tau).value;

  // One value a triad first: three sensors of a kind. Axes get values of their own where they demonstrably differ.
  std::vector<Group> groups;
  const std::vector<Group> axes = {{0}, {1}, {2}, {3}, {4}, {5}};
  const bool apart_already = !options.axes_apart && (s.segment<3>(0).maxCoeff() > s.segment<3>(0).minCoeff() ||
                                                     s.segment<3>(3).maxCoeff() > s.segment<3>(3).minCoeff());
  if (options.random_walks && apart_already) {
    groups = axes;
  } else if (options.random_walks) {
    s.segment<3>(0).setConstant(s.segment<3>(0).mean());
    s.segment<3>(3).setConstant(s.segment<3>(3).mean());
    groups = {{0, 1, 2}, {3, 4, 5}};
  }
  if (options.bias_instability) groups.insert(groups.end(), {{6}, {7}});
  Scoring scoring = score(likelihood, groups, tau, options.max_iterations, s);
  fit.evaluations = 1 + scoring.evaluations;
  if (options.random_walks && options.axes_apart) {
    const Eigen::Vector2d variance(s[0], s[3]);
    const Eigen::Vector2d relative = scoring.information.topLeftCorner<2, 2>().inverse().diagonal().cwiseSqrt();
    fit.sigma_angle_random_walk.setConstant(0.5 * relative[0] / std::sqrt(variance[0]));
    fit.sigma_velocity_random_walk.setConstant(0.5 * relative[1] / std::sqrt(variance[1]));
    // One scoring step with six values shows whether that would say more than chance (4 more degrees of freedom).
    Eigen::Matrix<double, sources, 1> apart = s;
    const Scoring six = score(likelihood, axes, tau, 1, apart);
    fit.evaluations += six.evaluations;
    constexpr double chi_square_4_one_in_1e4 = 23.5;
    if (scoring.value - six.value > chi_square_4_one_in_1e4) {
      fit.axes_differ = true;
      std::vector<Group> all = axes;
      if (options.bias_instability) all.insert(all.end(), {{6}, {7}});
      s = apart;
      scoring = score(likelihood, all, tau, options.max_iterations, s);
      fit.evaluations += scoring.evaluations;
      const Eigen::MatrixXd covariance = scoring.information.topLeftCorner(6, 6).inverse();
      for (int k = 0; k < 3; ++k) {  // sigma of a root: half the relative sigma of the variance
        fit.sigma_angle_random_walk[k] = 0.5 * std::sqrt(covariance(k, k) / s[k]);
        fit.sigma_velocity_random_walk[k] = 0.5 * std::sqrt(covariance(k + 3, k + 3) / s[k + 3]);
      }
    }
  }
  fit.converged = scoring.converged;
  fit.gain = start_value - scoring.value;
  if (s[6] > 0.0 || s[7] > 0.0) {
    Eigen::Matrix<double, sources, 1> t = s;
    t[6] = t[7] = 0.0;
    fit.bias_instability_gain = likelihood.run(t, tau).value - scoring.value;
    ++fit.evaluations;
  }
  fit.noise = setup.noise;
  fit.noise.angle_random_walk = s.segment<3>(0).cwiseSqrt();
  fit.noise.velocity_random_walk = s.segment<3>(3).cwiseSqrt();
  fit.noise.gyro_bias_instability_radps = std::sqrt(s[6]);
  fit.noise.accel_bias_instability_mps2 = std::sqrt(s[7]);
  return fit;
}

}  // namespace turncal
