#include "calib/joint/velocity_likelihood.h"

#include <cmath>

#include <Eigen/Dense>

#include "calib/joint/motion_step.h"

namespace turncal {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// Adds one block to an unobserved interval.
void VelocityLikelihood::add_motion(const Block& block, const BlockMotion& motion, const SensorModel& model,
                                    Interval& interval) {
  const double t = block.duration_s;
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
    const StepNoise n =
        k < 3 ? step_noise(unit, Matrix3d::Zero(), move.F, t) : step_noise(Matrix3d::Zero(), unit, move.F, t);
    Matrix6 q;
    q << n.psi_psi, n.psi_v, n.psi_v.transpose(), n.v_v;
    interval.q[static_cast<std::size_t>(k)] = phi * interval.q[static_cast<std::size_t>(k)] * phi.transpose() + q;
  }
  interval.phi = phi * interval.phi;
  interval.gamma = phi * interval.gamma + gamma;
  interval.t += t;
  derivatives(block, motion, model);
  move_on(motion, move.F, move.turn_n, t);
  C_nb_ = move.C_end;
  v_ += move.dv_n;
}

// Of the motion over a block, by the free parameters.
void VelocityLikelihood::derivatives(const Block& block, const BlockMotion& motion, const SensorModel& model) {
  parameter_columns(block, motion, model, unit_, columns_);
  int to = 0;
  for (int k = 0; k < parameter_count; ++k) {
    if (!parameter_is_free[static_cast<std::size_t>(k)]) continue;
    dr_.col(to) = columns_.rotation.col(k);
    dv_.col(to) = columns_.velocity.col(k);
    dm_.col(to) = columns_.mean_velocity.col(k);
    ++to;
  }
}

// d(psi, v)/d(parameters) from the start of the block to its end.
void VelocityLikelihood::move_on(const BlockMotion& motion, const Matrix3d& F, const Matrix3d& turn_n, double t) {
  X_.bottomRows<3>() += C_nb_ * dv_ - (t * F) * X_.topRows<3>();
  X_.topRows<3>() = turn_n * X_.topRows<3>() + (C_nb_ * left_jacobian(motion.rotation)) * dr_;
}

VelocityLikelihood::VelocityLikelihood(const CompressedRecording& recording, const Parameters& parameters,
                                       const EffectModel& effects, const FilterSetup& setup,
                                       const ParameterVector& ranges, int seconds_together)
    : setup_(setup),
      earth_(earth_rate_n(recording.info.latitude_deg)),
      gravity_(recording.info.gravity_mps2),
      unit_(si_per_unit(recording.info).cwiseProduct(ranges)) {
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
    const auto may_join = [&](std::size_t k) { return cut == setup.breaks.end() || cut->block != k; };
    const auto observed = [&](std::size_t k) {
      return recording.blocks[k].whole_second && (setup.unobserved.empty() || !setup.unobserved[k]);
    };
    if (!observed(index)) {
      const std::size_t first = index;
      while (index < recording.blocks.size() && !observed(index) && (index == first || may_join(index))) {
        add_motion(recording.blocks[index], motions[index], model, interval);
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
    derivatives(block, motion, model);
    interval.dy = X_.bottomRows<3>() - (0.5 * block.duration_s * move.F) * X_.topRows<3>() + C_nb_ * dm_;
    move_on(motion, move.F, move.turn_n, block.duration_s);
    if (setup.noise.accel_pulse_mps > 0.0)
      for (int axis = 0; axis < 3; ++axis)
        interval.quantisation[axis] =
            quantisation_variance(block.accel[axis], block.samples, setup.noise.accel_pulse_mps);
    intervals_.push_back(interval);
    C_nb_ = move.C_end;
    v_ += move.dv_n;
  }
}

VelocityLikelihood::Run VelocityLikelihood::run(const NoiseVariances& s, double tau_b, bool restricted) const {
  Run out;
  out.nu.reserve(intervals_.size());
  out.S.reserve(intervals_.size());
  Matrix6 P = Matrix6::Zero();  // (psi, v)
  Matrix6 M = Matrix6::Zero();  // cov((psi, v), (b_g, b_a))
  Matrix6 B = Matrix6::Zero();  // cov of the biases
  P.diagonal().head<3>() << std::pow(setup_.initial_tilt_sigma_rad, 2), std::pow(setup_.initial_heading_sigma_rad, 2),
      std::pow(setup_.initial_tilt_sigma_rad, 2);
  P.diagonal().tail<3>().setConstant(std::pow(setup_.initial_velocity_sigma_mps, 2));
  Eigen::Matrix<double, 6, 1> stationary;
  stationary << s[6], s[6], s[6], s[7], s[7], s[7];
  B.diagonal() = stationary;
  Eigen::Matrix<double, 6, 1> x = Eigen::Matrix<double, 6, 1>::Zero();
  Eigen::Matrix<double, 6, 1> b = Eigen::Matrix<double, 6, 1>::Zero();
  const bool biases = s[6] > 0.0 || s[7] > 0.0;
  Columns6 X = Columns6::Zero();  // as x and b, one column a parameter
  Columns6 X_b = Columns6::Zero();
  Eigen::Matrix<double, free_parameter_count, free_parameter_count> A;
  A.setIdentity();  // the ranges
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
      if (restricted) {
        Columns3 N = i.dy + H * X;
        if (biases) {
          N.noalias() += G * X_b;
          X = (phi * X + gamma * X_b).eval();
          X_b = (rho * X_b - rho * root.solve(MH.transpose()).transpose() * N).eval();
        } else {
          X = (phi * X).eval();
        }
        X.noalias() -= K * N;
        root.matrixL().solveInPlace(N);
        A.noalias() += N.transpose() * N;
      }
      P.noalias() -= K * cross.transpose();
      x -= K * nu;
    } else {
      if (restricted) {
        X = (i.phi * X).eval();
        if (biases) {
          X.noalias() += i.gamma * X_b;
          X_b *= rho;
        }
      }
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
  if (restricted) {
    const Eigen::LDLT<Eigen::MatrixXd> factor(A);
    out.log_det_information = factor.vectorD().array().log().sum();
    out.value += out.log_det_information;
  }
  return out;
}

}  // namespace turncal
