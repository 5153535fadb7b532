#include "calib/joint_filter.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Cholesky>

#include "calib/attitude.h"

namespace turncal {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Columns = Eigen::MatrixXd;  // one row a parameter, so that all of them move through a 3x3 product together

// The motion over a block after everything the present model knows has been taken off.
struct Step {
  BlockMotion motion;
  Vector3d gyro_correction = Vector3d::Zero();   // rad, what was taken off the rotation
  Vector3d accel_correction = Vector3d::Zero();  // m/s
};

void take_off(const Vector3d& turn, const Vector3d& push, BlockMotion& m) {
  m.velocity -= push + 0.5 * (turn.cross(m.velocity) + m.rotation.cross(push));
  m.mean_velocity -= 0.5 * push + turn.cross(m.mean_velocity) / 3.0;
  m.rotation -= turn;
}

// Covariance of the noise that enters over a block of length t with specific force f_n (skew F), for the state at its end
// (psi, v) and for the mean velocity z; W and V are the walks' covariance rates in n.
struct BlockNoise {
  Matrix3d psi_psi, psi_v, v_v, psi_z, v_z, z_z;
};
BlockNoise block_noise(const Matrix3d& W, const Matrix3d& V, const Matrix3d& F, double t) {
  BlockNoise q;
  const Matrix3d WF = W * F.transpose();  // cov(psi, -F psi) = -W F'
  const Matrix3d FWF = F * WF;
  q.psi_psi = W * t;
  q.psi_v = -WF * (t * t / 2.0);
  q.v_v = V * t + FWF * (t * t * t / 3.0);
  q.psi_z = -WF * (t * t / 6.0);
  q.v_z = V * (t / 2.0) + FWF * (t * t * t / 8.0);
  q.z_z = V * (t / 3.0) + FWF * (t * t * t / 20.0);
  return q;
}

// Quantisation noise of the mean velocity of a static second: a sawtooth of one pulse, averaged over the teeth it makes.
double quantisation_variance(double counts, int samples, double pulse) {
  const double teeth = std::abs(counts);
  return pulse * pulse / 12.0 * (1.0 / (1.0 + teeth * teeth) + 1.0 / samples);
}

template <int NS>  // 6: psi, v;  12: psi, v, b_g, b_a
class Filter {
 public:
  Filter(const CompressedRecording& recording, const Parameters& parameters, const EffectModel& effects,
         const FilterSetup& setup)
      : recording_(recording), effects_(effects), setup_(setup), model_(sensor_model(parameters, recording.info)),
        unit_(si_per_unit(recording.info)), earth_(earth_rate_n(recording.info.latitude_deg)) {}

  FilterResult run();

 private:
  using State = Eigen::Matrix<double, NS, 1>;
  using Covariance = Eigen::Matrix<double, NS, NS>;
  using Cross = Eigen::Matrix<double, NS, 3>;

  void start();
  void apply_break(const Break& cut);
  Step evaluate_step(std::size_t index);
  void block_columns(const Block& block, const Step& step);
  void advance(std::size_t index, const Step& step);
  void accumulate(const Vector3d& nu, const Eigen::LLT<Matrix3d>& root);
  void flush();

  const CompressedRecording& recording_;
  const EffectModel& effects_;
  const FilterSetup& setup_;
  const SensorModel model_;
  const ParameterVector unit_;
  const Vector3d earth_;

  Matrix3d C_nb_;
  Vector3d v_ = Vector3d::Zero();
  Vector3d b_g_ = Vector3d::Zero();
  Vector3d b_a_ = Vector3d::Zero();
  Covariance P_;
  int p_ = 0;          // parameters and effect components
  Columns X_;          // p x NS
  Columns dr_, dv_, dm_;  // p x 3: derivatives of rotation, velocity and mean velocity of the block, body frame
  Columns N_;          // p x 3
  BlockColumns base_;
  EffectRegressors regressors_;
  Eigen::MatrixXd buffer_;  // (p + 1) x 48: whitened rows waiting to be added to the information
  int buffered_ = 0;
  Eigen::MatrixXd moments_;  // (p + 1)^2: [N nu]' [N nu], lower triangle
  double last_rotation_end_s_ = -1e9;
  FilterResult result_;
};

template <int NS>
FilterResult Filter<NS>::run() {
  p_ = setup_.with_columns ? parameter_count + effects_.columns : 0;
  X_.setZero(p_, NS);
  dr_.setZero(p_, 3);
  dv_.setZero(p_, 3);
  dm_.setZero(p_, 3);
  N_.setZero(p_, 3);
  buffer_.setZero(p_ + 1, 48);
  moments_.setZero(p_ + 1, p_ + 1);
  regressors_.gyro.setZero(3, effects_.columns);
  regressors_.accel.setZero(3, effects_.columns);
  if (recording_.blocks.empty()) return result_;
  start();
  auto cut = setup_.breaks.begin();
  for (std::size_t index = 0; index < recording_.blocks.size(); ++index) {
    for (; cut != setup_.breaks.end() && cut->block <= index; ++cut)
      if (cut->block == index) apply_break(*cut);
    const Step step = evaluate_step(index);
    if (setup_.with_columns) block_columns(recording_.blocks[index], step);
    advance(index, step);
  }
  flush();
  if (p_ > 0) {
    result_.information = moments_.topLeftCorner(p_, p_).template selfadjointView<Eigen::Lower>();
    result_.gradient = moments_.row(p_).head(p_).transpose();
  }
  result_.final_C_nb = C_nb_;
  return result_;
}

template <int NS>
void Filter<NS>::start() {
  // Levelled on the first static second (the first block if there is none); the heading is the given one.
  const Segment& first = recording_.segments[recording_.blocks.front().segment];
  const Block* level_on = &recording_.blocks.front();
  for (const Block& block : recording_.blocks)
    if (block.whole_second) {
      level_on = &block;
      break;
    }
  const Vector3d f_b = model_.accel_scale * level_on->accel / level_on->duration_s - model_.accel_bias_mps2;
  C_nb_ = level(attitude_from_angles(first.heading_deg * rad_per_deg, first.pitch_deg * rad_per_deg,
                                     first.roll_deg * rad_per_deg), f_b);
  P_.setZero();
  const double tilt = setup_.initial_tilt_sigma_rad * setup_.initial_tilt_sigma_rad;
  const double heading = setup_.initial_heading_sigma_rad * setup_.initial_heading_sigma_rad;
  P_.diagonal().template segment<3>(0) << tilt, heading, tilt;
  P_.diagonal().template segment<3>(3).setConstant(setup_.initial_velocity_sigma_mps * setup_.initial_velocity_sigma_mps);
  if constexpr (NS == 12) {
    P_.diagonal().template segment<3>(6).setConstant(std::pow(setup_.noise.gyro_bias_instability_radps, 2));
    P_.diagonal().template segment<3>(9).setConstant(std::pow(setup_.noise.accel_bias_instability_mps2, 2));
  }
}

template <int NS>
void Filter<NS>::apply_break(const Break& cut) {
  const double tilt = cut.tilt_sigma_rad * cut.tilt_sigma_rad;
  P_.diagonal().template segment<3>(0) += Vector3d(tilt, cut.heading_sigma_rad * cut.heading_sigma_rad, tilt);
  P_.diagonal().template segment<3>(3).array() += cut.velocity_sigma_mps * cut.velocity_sigma_mps;
}

template <int NS>
Step Filter<NS>::evaluate_step(std::size_t index) {
  const Block& block = recording_.blocks[index];
  Step step;
  step.motion = evaluate(block, model_, recording_.info.sample_period_s);
  const double t = block.duration_s;
  if constexpr (NS == 12) {
    step.gyro_correction += b_g_ * t;
    step.accel_correction += b_a_ * t;
  }
  if (effects_.columns > 0) {
    const auto rate = [&](std::size_t k) -> Vector3d {
      const Block& b = recording_.blocks[k];
      return model_.gyro_scale * b.gyro / b.duration_s - model_.gyro_bias_radps;
    };
    BlockState s;
    s.w_b = step.motion.rotation / t;
    s.f_b = model_.accel_scale * block.accel / t - model_.accel_bias_mps2;
    const std::size_t before = index > 0 ? index - 1 : index;
    const std::size_t after = index + 1 < recording_.blocks.size() ? index + 1 : index;
    const double span = 0.5 * recording_.blocks[before].duration_s + 0.5 * recording_.blocks[after].duration_s +
                        (before != index && after != index ? t : 0.0);
    s.w_dot_b = after == before || block.whole_second ? Vector3d::Zero().eval() : ((rate(after) - rate(before)) / span).eval();
    s.C_nb = C_nb_ * rotation_exp(0.5 * step.motion.rotation);
    s.duration_s = t;
    s.time_s = static_cast<double>(block.start_sample - recording_.blocks.front().start_sample) *
                   recording_.info.sample_period_s + 0.5 * t;
    const bool rotating = recording_.segments[block.segment].kind == SegmentKind::rotate;
    if (rotating) last_rotation_end_s_ = s.time_s + 0.5 * t;
    s.since_rotation_s = rotating ? 1e9 : s.time_s - last_rotation_end_s_;
    s.temperature_c = std::isnan(block.temperature_c) ? 0.0 : block.temperature_c - effects_.reference_temperature_c;
    effects_.regressors(s, regressors_);
    step.gyro_correction += regressors_.gyro * effects_.values * t;
    step.accel_correction += regressors_.accel * effects_.values * t;
  }
  take_off(step.gyro_correction, step.accel_correction, step.motion);
  return step;
}

template <int NS>
void Filter<NS>::block_columns(const Block& block, const Step& step) {
  parameter_columns(block, step.motion, model_, unit_, base_);
  dr_.topRows<parameter_count>() = base_.rotation.transpose();
  dv_.topRows<parameter_count>() = base_.velocity.transpose();
  dm_.topRows<parameter_count>() = base_.mean_velocity.transpose();
  if (effects_.columns == 0) return;
  const double t = block.duration_s;
  const Columns turn = regressors_.gyro.transpose() * t;  // rows: one component each
  const Columns push = regressors_.accel.transpose() * t;
  // a x b for rows a: a * skew(b);   b x a: -a * skew(b)
  const Matrix3d v_skew = skew(step.motion.velocity);
  const Matrix3d r_skew = skew(step.motion.rotation);
  dr_.bottomRows(effects_.columns).noalias() = -turn;
  dv_.bottomRows(effects_.columns) = -push;
  dv_.bottomRows(effects_.columns).noalias() -= 0.5 * turn * v_skew;
  dv_.bottomRows(effects_.columns).noalias() += 0.5 * push * r_skew;
  dm_.bottomRows(effects_.columns) = -0.5 * push;
  dm_.bottomRows(effects_.columns).noalias() -= turn * v_skew / 6.0;
}

template <int NS>
void Filter<NS>::advance(std::size_t index, const Step& step) {
  const Block& block = recording_.blocks[index];
  const double t = block.duration_s;
  const double rho = NS == 12 ? std::exp(-t / setup_.noise.bias_correlation_s) : 1.0;

  // Navigation: n turns with the earth, so what was gained is seen from a frame that has turned.
  const Matrix3d turn_n = rotation_exp(-earth_ * t);
  const Vector3d gained = C_nb_ * step.motion.velocity;
  const Vector3d mean_gained = C_nb_ * step.motion.mean_velocity;
  const Vector3d gravity(0.0, -recording_.info.gravity_mps2, 0.0);
  const Vector3d dv_n = gained - 0.5 * t * earth_.cross(gained) + gravity * t;
  const Vector3d v_mean = v_ + mean_gained - t / 3.0 * earth_.cross(mean_gained) + 0.5 * t * gravity;
  const Matrix3d C_mid = C_nb_ * rotation_exp(0.5 * step.motion.rotation);
  const Matrix3d F = skew(gained / t);

  // Transition of (psi, v, b_g, b_a) and noise.
  Covariance Phi = Covariance::Identity();
  Phi.template block<3, 3>(0, 0) = turn_n;
  Phi.template block<3, 3>(3, 0) = -F * t;
  if constexpr (NS == 12) {
    Phi.template block<3, 3>(0, 6) = C_mid * t;
    Phi.template block<3, 3>(3, 6) = -F * C_mid * (0.5 * t * t);
    Phi.template block<3, 3>(3, 9) = C_mid * t;
    Phi.template block<3, 3>(6, 6) *= rho;
    Phi.template block<3, 3>(9, 9) *= rho;
  }
  // b_g, b_a above are minus the error of the estimated bias: psi grows with what is taken off too little.
  const Matrix3d W = C_mid * setup_.noise.angle_random_walk.cwiseAbs2().asDiagonal() * C_mid.transpose();
  const Matrix3d V = C_mid * setup_.noise.velocity_random_walk.cwiseAbs2().asDiagonal() * C_mid.transpose();
  const BlockNoise q = block_noise(W, V, F, t);
  Covariance Q = Covariance::Zero();
  Q.template block<3, 3>(0, 0) = q.psi_psi;
  Q.template block<3, 3>(0, 3) = q.psi_v;
  Q.template block<3, 3>(3, 0) = q.psi_v.transpose();
  Q.template block<3, 3>(3, 3) = q.v_v;
  if constexpr (NS == 12) {
    const double grow = 1.0 - rho * rho;
    Q.diagonal().template segment<3>(6).setConstant(grow * std::pow(setup_.noise.gyro_bias_instability_radps, 2));
    Q.diagonal().template segment<3>(9).setConstant(grow * std::pow(setup_.noise.accel_bias_instability_mps2, 2));
  }

  const bool observed = block.whole_second && (setup_.unobserved.empty() || !setup_.unobserved[index]);
  Eigen::Matrix<double, 3, NS> H = Eigen::Matrix<double, 3, NS>::Zero();
  Matrix3d S = Matrix3d::Identity();
  Cross M = Cross::Zero();  // cov(state at the end, nu)
  if (observed) {
    H.template block<3, 3>(0, 0) = -F * (0.5 * t);
    H.template block<3, 3>(0, 3).setIdentity();
    if constexpr (NS == 12) {
      H.template block<3, 3>(0, 6) = -F * C_mid * (t * t / 6.0);
      H.template block<3, 3>(0, 9) = C_mid * (0.5 * t);
    }
    Vector3d r = Vector3d::Zero();
    if (setup_.noise.accel_pulse_mps > 0.0)
      for (int axis = 0; axis < 3; ++axis)
        r[axis] = quantisation_variance(block.accel[axis], block.samples, setup_.noise.accel_pulse_mps);
    const Cross PH = P_ * H.transpose();
    S = H * PH + q.z_z + C_mid * r.asDiagonal() * C_mid.transpose();
    M = Phi * PH;
    M.template topRows<3>() += q.psi_z;
    M.template block<3, 3>(3, 0) += q.v_z;
  }

  // Sensitivities before the state moves on.
  if (p_ > 0) {
    if (observed) {
      N_ = X_.template middleCols<3>(3);
      N_.noalias() += X_.template leftCols<3>() * H.template block<3, 3>(0, 0).transpose();
      N_.noalias() += dm_ * C_nb_.transpose();
      if constexpr (NS == 12) {
        N_.noalias() += X_.template middleCols<3>(6) * H.template block<3, 3>(0, 6).transpose();
        N_.noalias() += X_.template middleCols<3>(9) * H.template block<3, 3>(0, 9).transpose();
      }
    }
    const Matrix3d rotate = C_nb_ * left_jacobian(step.motion.rotation);
    X_.template middleCols<3>(3).noalias() += X_.template leftCols<3>() * Phi.template block<3, 3>(3, 0).transpose();
    X_.template middleCols<3>(3).noalias() += dv_ * C_nb_.transpose();
    dm_.noalias() = X_.template leftCols<3>() * turn_n.transpose();
    X_.template leftCols<3>() = dm_;
    X_.template leftCols<3>().noalias() += dr_ * rotate.transpose();
    if constexpr (NS == 12) {
      X_.template middleCols<3>(3).noalias() += X_.template middleCols<3>(6) * Phi.template block<3, 3>(3, 6).transpose();
      X_.template middleCols<3>(3).noalias() += X_.template middleCols<3>(9) * Phi.template block<3, 3>(3, 9).transpose();
      X_.template leftCols<3>().noalias() += X_.template middleCols<3>(6) * Phi.template block<3, 3>(0, 6).transpose();
      X_.template rightCols<6>() *= rho;
    }
  }

  C_nb_ = turn_n * C_nb_ * rotation_exp(step.motion.rotation);
  v_ += dv_n;
  b_g_ *= rho;
  b_a_ *= rho;
  P_ = (Phi * P_ * Phi.transpose() + Q).eval();

  if (observed) {
    const Vector3d nu = v_mean;
    const Eigen::LLT<Matrix3d> root(S);
    if (setup_.keep_innovations)
      result_.innovations.push_back({index,
                                     (static_cast<double>(block.start_sample - recording_.blocks.front().start_sample) +
                                      0.5 * block.samples) * recording_.info.sample_period_s,
                                     nu, root.matrixL().solve(nu)});
    result_.chi_square += nu.dot(root.solve(nu));
    result_.log_determinant += 2.0 * root.matrixLLT().diagonal().array().log().sum();
    result_.observations += 3;
    accumulate(nu, root);

    const Cross K = root.solve(M.transpose()).transpose();
    P_.noalias() -= K * M.transpose();
    if (p_ > 0) X_.noalias() -= N_ * K.transpose();
    const State correction = K * nu;
    const Vector3d psi = correction.template segment<3>(0);
    C_nb_ = rotation_exp(-psi) * C_nb_;
    v_ -= correction.template segment<3>(3);
    if constexpr (NS == 12) {
      b_g_ += correction.template segment<3>(6);
      b_a_ += correction.template segment<3>(9);
    }
  }
  P_ = (0.5 * (P_ + P_.transpose())).eval();
}

template <int NS>
void Filter<NS>::accumulate(const Vector3d& nu, const Eigen::LLT<Matrix3d>& root) {
  if (p_ == 0) return;
  // Whitened rows: L^-1 N', L^-1 nu
  const Matrix3d inverse = root.matrixL().solve(Matrix3d::Identity());
  buffer_.block(0, buffered_, p_, 3).noalias() = N_ * inverse.transpose();
  buffer_.block(p_, buffered_, 1, 3) = (inverse * nu).transpose();
  buffered_ += 3;
  if (buffered_ + 3 > buffer_.cols()) flush();
}

template <int NS>
void Filter<NS>::flush() {
  if (buffered_ == 0) return;
  moments_.selfadjointView<Eigen::Lower>().rankUpdate(buffer_.leftCols(buffered_));
  buffered_ = 0;
}

}  // namespace

FilterResult run_filter(const CompressedRecording& recording, const Parameters& parameters, const EffectModel& effects,
                        const FilterSetup& setup) {
  if (setup.noise.gyro_bias_instability_radps > 0.0 || setup.noise.accel_bias_instability_mps2 > 0.0)
    return Filter<12>(recording, parameters, effects, setup).run();
  return Filter<6>(recording, parameters, effects, setup).run();
}

}  // namespace turncal
