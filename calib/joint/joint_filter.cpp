#include "calib/joint/joint_filter.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Cholesky>

#include "calib/joint/motion_step.h"
#include "calib/model/attitude.h"

namespace turncal {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
// Further from the best attitude nothing is linearised. The first heading, known to 0.02 rad, is nearer.
constexpr double max_linear_rad = 0.06;
using Columns = Eigen::MatrixXd;  // one row a parameter, so that all of them move through a 3x3 product together

// Takes a turn (rad) and a push (m/s) that the sensors read but the unit did not make off the motion over a block.
void take_off(const Vector3d& turn, const Vector3d& push, BlockMotion& m) {
  m.velocity -= push + 0.5 * (turn.cross(m.velocity) + m.rotation.cross(push));
  m.mean_velocity -= 0.5 * push + turn.cross(m.mean_velocity) / 3.0;
  m.rotation -= turn;
}

template <int NS>  // 6: psi, v;  12: psi, v, b_g, b_a
class Filter {
 public:
  Filter(const CompressedRecording& recording, const Parameters& parameters, const EffectModel& effects,
         const FilterSetup& setup)
      : recording_(recording),
        effects_(effects),
        setup_(setup),
        model_(sensor_model(parameters, recording.info)),
        unit_(si_per_unit(recording.info)),
        earth_(earth_rate_n(recording.info.latitude_deg)) {}

  FilterResult run();

 private:
  using State = Eigen::Matrix<double, NS, 1>;
  using Covariance = Eigen::Matrix<double, NS, NS>;
  using Cross = Eigen::Matrix<double, NS, 3>;

  void start();
  void apply_break(const Break& cut);
  BlockMotion model_motion(std::size_t index);
  void block_columns(const Block& block, const BlockMotion& motion);
  void advance(std::size_t index, const BlockMotion& motion);
  Vector3d navigate(const Block& block, const BlockMotion& motion, const MotionStep& move, const MotionStep& linear,
                    double rho);
  void move_columns(const BlockMotion& motion, const Matrix3d& F, const Matrix3d& turn_n, double t);
  void move_columns_by_biases(const Covariance& Phi, double rho);
  void add_bias_noise(double rho, Covariance& Q) const;
  void update(const Vector3d& nu, const Eigen::LLT<Matrix3d>& root, const Cross& M);
  void defer(const MotionStep& step, const Matrix3d& F, const StepNoise& noise, double t, double rho);
  void catch_up();
  Innovation innovation(std::size_t index, const Vector3d& nu, const Eigen::LLT<Matrix3d>& root,
                        const Vector3d& free_mean) const {
    const Block& block = recording_.blocks[index];
    const double before = static_cast<double>(block.start_sample - recording_.blocks.front().start_sample);
    return {index, (before + 0.5 * block.samples) * recording_.info.sample_period_s, nu, root.matrixL().solve(nu),
            free_mean};
  }
  void accumulate(const Vector3d& nu, const Eigen::LLT<Matrix3d>& root);
  void flush();

  const CompressedRecording& recording_;
  const EffectModel& effects_;
  const FilterSetup& setup_;
  const SensorModel model_;
  const ParameterVector unit_;
  const Vector3d earth_;

  Matrix3d C_nb_;
  // Where transitions and sensitivities are evaluated: the attitude navigated without corrections, so that it turns with the
  // unit only. Evaluated at the corrected attitude they would see a turn with every correction of the heading, and an
  // accelerometer bias that nothing determines would seem to be determined by it.
  Matrix3d linear_C_nb_;
  Vector3d v_ = Vector3d::Zero();
  Vector3d b_g_ = Vector3d::Zero();
  Vector3d b_a_ = Vector3d::Zero();
  Covariance P_;
  // What P_ (and the columns, as far as the biases drive them) still has to go through: the short blocks since the last
  // static second, between which nothing is observed. Of (psi, v): transition (turn, v_psi), what a constant bias does
  // (psi_bg, v_bg, v_ba), noise; rho: decay of the biases.
  struct Deferred {
    bool any = false;
    Matrix3d turn = Matrix3d::Identity(), v_psi = Matrix3d::Zero();
    Matrix3d psi_bg = Matrix3d::Zero(), v_bg = Matrix3d::Zero(), v_ba = Matrix3d::Zero();
    Matrix3d psi_psi = Matrix3d::Zero(), psi_v = Matrix3d::Zero(), v_v = Matrix3d::Zero();
    double rho = 1.0;
  } deferred_;
  int p_ = 0;             // parameters and effect components
  Columns X_;             // p x NS
  Columns dr_, dv_, dm_;  // p x 3: derivatives of rotation, velocity and mean velocity of the block, body frame
  Columns N_;             // p x 3
  BlockColumns base_;
  EffectRegressors regressors_;
  Eigen::MatrixXd buffer_;  // (p + 1) x 48: whitened rows waiting to be added to the information
  int buffered_ = 0;
  Eigen::MatrixXd moments_;  // (p + 1)^2: [N nu]' [N nu], lower triangle
  double last_rotation_end_s_ = -1e9;
  Vector3d last_up_ = Vector3d::Zero();
  // Navigated beside the filter from the beginning of the last rotation on, without its corrections; for the reports.
  Matrix3d free_C_nb_ = Matrix3d::Identity();
  Vector3d free_v_ = Vector3d::Zero();
  bool was_static_ = false;
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
      if (cut->block == index) {
        catch_up();
        apply_break(*cut);
      }
    const BlockMotion motion = model_motion(index);
    if (setup_.with_columns) block_columns(recording_.blocks[index], motion);
    advance(index, motion);
  }
  flush();
  if (p_ > 0) {
    result_.information = moments_.topLeftCorner(p_, p_).template selfadjointView<Eigen::Lower>();
    result_.gradient = moments_.row(p_).head(p_).transpose();
  }
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
                                     first.roll_deg * rad_per_deg),
                f_b);
  result_.initial_C_nb = C_nb_;
  linear_C_nb_ = C_nb_;
  free_C_nb_ = C_nb_;
  P_.setZero();
  const double tilt = setup_.initial_tilt_sigma_rad * setup_.initial_tilt_sigma_rad;
  const double heading = setup_.initial_heading_sigma_rad * setup_.initial_heading_sigma_rad;
  P_.diagonal().template segment<3>(0) << tilt, heading, tilt;
  P_.diagonal().template segment<3>(3).setConstant(setup_.initial_velocity_sigma_mps *
                                                   setup_.initial_velocity_sigma_mps);
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
BlockMotion Filter<NS>::model_motion(std::size_t index) {
  const Block& block = recording_.blocks[index];
  BlockMotion motion = evaluate(block, model_, recording_.info.sample_period_s);
  const double t = block.duration_s;
  TakenOff off;
  if (effects_.columns > 0) {
    const auto rate = [&](std::size_t k) -> Vector3d {
      const Block& b = recording_.blocks[k];
      return model_.gyro_scale * b.gyro / b.duration_s - model_.gyro_bias_radps;
    };
    BlockState s;
    s.w_b = motion.rotation / t;
    s.f_b = model_.accel_scale * block.accel / t - model_.accel_bias_mps2;
    const std::size_t before = index > 0 ? index - 1 : index;
    const std::size_t after = index + 1 < recording_.blocks.size() ? index + 1 : index;
    const double span = 0.5 * recording_.blocks[before].duration_s + 0.5 * recording_.blocks[after].duration_s +
                        (before != index && after != index ? t : 0.0);
    s.w_dot_b =
        after == before || block.whole_second ? Vector3d::Zero().eval() : ((rate(after) - rate(before)) / span).eval();
    s.C_nb = C_nb_ * rotation_exp(0.5 * motion.rotation);
    s.duration_s = t;
    s.time_s = static_cast<double>(block.start_sample - recording_.blocks.front().start_sample) *
                   recording_.info.sample_period_s +
               0.5 * t;
    const bool rotating = recording_.segments[block.segment].kind == SegmentKind::rotate;
    if (rotating) last_rotation_end_s_ = s.time_s + 0.5 * t;
    s.since_rotation_s = rotating ? 1e9 : s.time_s - last_rotation_end_s_;
    s.temperature_c = std::isnan(block.temperature_c) ? 0.0 : block.temperature_c - effects_.reference_temperature_c;
    const Segment& segment = recording_.segments[block.segment];
    const Segment& from = recording_.segments[rotating && block.segment > 0 ? block.segment - 1 : block.segment];
    s.table_rad = 0.5 * rad_per_deg *
                  Vector3d(segment.heading_deg + from.heading_deg, segment.pitch_deg + from.pitch_deg,
                           segment.roll_deg + from.roll_deg);
    for (int axis = 0; axis < 3; ++axis)
      if (std::abs(s.f_b[axis]) > 0.5 * standard_gravity_mps2) last_up_[axis] = s.f_b[axis] > 0.0 ? 1.0 : -1.0;
    s.last_up = last_up_;
    effects_.regressors(s, regressors_);
    off = {regressors_.gyro * effects_.values * t, regressors_.accel * effects_.values * t};
    take_off(off.turn_rad, off.push_mps, motion);
  }
  if (setup_.keep_motions) {
    result_.motions.push_back(motion);
    result_.taken_off.push_back(off);
  }
  if constexpr (NS == 12) take_off(b_g_ * t, b_a_ * t, motion);
  return motion;
}

template <int NS>
void Filter<NS>::block_columns(const Block& block, const BlockMotion& motion) {
  parameter_columns(block, motion, model_, unit_, base_);
  dr_.topRows<parameter_count>() = base_.rotation.transpose();
  dv_.topRows<parameter_count>() = base_.velocity.transpose();
  dm_.topRows<parameter_count>() = base_.mean_velocity.transpose();
  if (effects_.columns == 0) return;
  const double t = block.duration_s;
  const Columns turn = regressors_.gyro.transpose() * t;  // rows: one component each
  const Columns push = regressors_.accel.transpose() * t;
  // a x b for rows a: a * skew(b);   b x a: -a * skew(b)
  const Matrix3d v_skew = skew(motion.velocity);
  const Matrix3d r_skew = skew(motion.rotation);
  dr_.bottomRows(effects_.columns).noalias() = -turn;
  dv_.bottomRows(effects_.columns) = -push;
  dv_.bottomRows(effects_.columns).noalias() -= 0.5 * turn * v_skew;
  dv_.bottomRows(effects_.columns).noalias() += 0.5 * push * r_skew;
  dm_.bottomRows(effects_.columns) = -0.5 * push;
  dm_.bottomRows(effects_.columns).noalias() -= turn * v_skew / 6.0;
}

// The unit's motion over a block, navigated: attitude, velocity, biases. Returns the mean velocity of the block, navigated
// freely since the last rotation began.
template <int NS>
Vector3d Filter<NS>::navigate(const Block& block, const BlockMotion& motion, const MotionStep& move,
                              const MotionStep& linear, double rho) {
  Vector3d free_mean = v_ + move.mean_dv_n;
  if (setup_.keep_innovations) {
    if (was_static_ && !block.whole_second) {  // a rotation begins: what is known now is all that is used
      free_C_nb_ = C_nb_;
      free_v_.setZero();
    }
    was_static_ = block.whole_second;
    const MotionStep free_move =
        motion_step(free_C_nb_, motion, earth_, recording_.info.gravity_mps2, block.duration_s);
    free_mean = free_v_ + free_move.mean_dv_n;
    free_C_nb_ = free_move.C_end;
    free_v_ += free_move.dv_n;
  }
  C_nb_ = move.C_end;
  linear_C_nb_ = linear.C_end;
  v_ += move.dv_n;
  b_g_ *= rho;
  b_a_ *= rho;
  return free_mean;
}

// What the parameters do to (psi, v) over a block; the biases come on top.
template <int NS>
void Filter<NS>::move_columns(const BlockMotion& motion, const Matrix3d& F, const Matrix3d& turn_n, double t) {
  const Matrix3d rotate = linear_C_nb_ * left_jacobian(motion.rotation);
  X_.template middleCols<3>(3).noalias() -= X_.template leftCols<3>() * (t * F).transpose();
  X_.template middleCols<3>(3).noalias() += dv_ * linear_C_nb_.transpose();
  dm_.noalias() = X_.template leftCols<3>() * turn_n.transpose();
  X_.template leftCols<3>() = dm_;
  X_.template leftCols<3>().noalias() += dr_ * rotate.transpose();
}

// One block more that P_ has to go through (b_g, b_a are minus the error of the estimated biases: psi grows with what is taken
// off too little).
template <int NS>
void Filter<NS>::defer(const MotionStep& step, const Matrix3d& F, const StepNoise& noise, double t, double rho) {
  Deferred& d = deferred_;
  const Matrix3d Ft = F * t;
  const Matrix3d& T = step.turn_n;
  if constexpr (NS == 12) {
    const Matrix3d by_bias = d.rho * t * step.C_mid;
    d.v_bg -= Ft * d.psi_bg + 0.5 * Ft * by_bias;
    d.psi_bg = T * d.psi_bg + by_bias;
    d.v_ba += by_bias;
  }
  d.v_psi -= Ft * d.turn;
  d.turn = T * d.turn;
  const Matrix3d turned = d.psi_psi * Ft.transpose();
  const Matrix3d crossed = Ft * d.psi_v;
  d.v_v += Ft * turned - crossed - crossed.transpose() + noise.v_v;
  d.psi_v = T * (d.psi_v - turned) + noise.psi_v;
  d.psi_psi = T * d.psi_psi * T.transpose() + noise.psi_psi;
  d.rho *= rho;
  d.any = true;
}

template <int NS>
void Filter<NS>::catch_up() {
  if (!deferred_.any) return;
  const Deferred& d = deferred_;
  Covariance Phi = Covariance::Identity();
  Covariance Q = Covariance::Zero();
  Phi.template block<3, 3>(0, 0) = d.turn;
  Phi.template block<3, 3>(3, 0) = d.v_psi;
  Q.template block<3, 3>(0, 0) = d.psi_psi;
  Q.template block<3, 3>(0, 3) = d.psi_v;
  Q.template block<3, 3>(3, 0) = d.psi_v.transpose();
  Q.template block<3, 3>(3, 3) = d.v_v;
  if constexpr (NS == 12) {
    Phi.template block<3, 3>(0, 6) = d.psi_bg;
    Phi.template block<3, 3>(3, 6) = d.v_bg;
    Phi.template block<3, 3>(3, 9) = d.v_ba;
    Phi.template block<6, 6>(6, 6) *= d.rho;
    add_bias_noise(d.rho, Q);
    if (p_ > 0) move_columns_by_biases(Phi, d.rho);
  }
  P_ = (Phi * P_ * Phi.transpose() + Q).eval();
  P_ = (0.5 * (P_ + P_.transpose())).eval();
  deferred_ = {};
}

template <int NS>
void Filter<NS>::add_bias_noise(double rho, Covariance& Q) const {
  if constexpr (NS == 12) {
    const double grow = 1.0 - rho * rho;
    Q.diagonal().template segment<3>(6).array() += grow * std::pow(setup_.noise.gyro_bias_instability_radps, 2);
    Q.diagonal().template segment<3>(9).array() += grow * std::pow(setup_.noise.accel_bias_instability_mps2, 2);
  }
}

template <int NS>
void Filter<NS>::move_columns_by_biases(const Covariance& Phi, double rho) {
  if constexpr (NS == 12) {
    X_.template middleCols<3>(3).noalias() += X_.template middleCols<3>(6) * Phi.template block<3, 3>(3, 6).transpose();
    X_.template middleCols<3>(3).noalias() += X_.template middleCols<3>(9) * Phi.template block<3, 3>(3, 9).transpose();
    X_.template leftCols<3>().noalias() += X_.template middleCols<3>(6) * Phi.template block<3, 3>(0, 6).transpose();
    X_.template rightCols<6>() *= rho;
  }
}

template <int NS>
void Filter<NS>::advance(std::size_t index, const BlockMotion& motion) {
  const Block& block = recording_.blocks[index];
  const double t = block.duration_s;
  const double rho = NS == 12 ? std::exp(-t / setup_.noise.bias_correlation_s) : 1.0;

  const MotionStep move = motion_step(C_nb_, motion, earth_, recording_.info.gravity_mps2, t);
  if ((linear_C_nb_ - C_nb_).squaredNorm() > 2.0 * max_linear_rad * max_linear_rad) linear_C_nb_ = C_nb_;
  const MotionStep linear = motion_step(linear_C_nb_, motion, earth_, recording_.info.gravity_mps2, t);
  const Matrix3d& C_mid = linear.C_mid;
  // At rest the specific force is known; as measured it would bring its noise into what is taken for certain.
  const Matrix3d F = block.whole_second ? skew(Vector3d(0.0, recording_.info.gravity_mps2, 0.0)) : linear.F;
  const Matrix3d W = C_mid * setup_.noise.angle_random_walk.cwiseAbs2().asDiagonal() * C_mid.transpose();
  const Matrix3d V = C_mid * setup_.noise.velocity_random_walk.cwiseAbs2().asDiagonal() * C_mid.transpose();
  const StepNoise q = step_noise(W, V, F, t);
  if (!block.whole_second) {
    defer(linear, F, q, t, rho);
    if (p_ > 0) move_columns(motion, F, move.turn_n, t);
    navigate(block, motion, move, linear, rho);
    return;
  }
  catch_up();

  // Transition of (psi, v, b_g, b_a) and noise.
  Covariance Phi = Covariance::Identity();
  Phi.template block<3, 3>(0, 0) = move.turn_n;
  Phi.template block<3, 3>(3, 0) = -F * t;
  if constexpr (NS == 12) {
    Phi.template block<3, 3>(0, 6) = C_mid * t;
    Phi.template block<3, 3>(3, 6) = -F * C_mid * (0.5 * t * t);
    Phi.template block<3, 3>(3, 9) = C_mid * t;
    Phi.template block<6, 6>(6, 6) *= rho;
  }
  Covariance Q = Covariance::Zero();
  Q.template block<3, 3>(0, 0) = q.psi_psi;
  Q.template block<3, 3>(0, 3) = q.psi_v;
  Q.template block<3, 3>(3, 0) = q.psi_v.transpose();
  Q.template block<3, 3>(3, 3) = q.v_v;
  add_bias_noise(rho, Q);

  const bool observed = setup_.unobserved.empty() || !setup_.unobserved[index];
  const bool predicted = observed || setup_.keep_innovations;  // left out, but looked at
  Eigen::Matrix<double, 3, NS> H = Eigen::Matrix<double, 3, NS>::Zero();
  Matrix3d S = Matrix3d::Identity();
  Cross M = Cross::Zero();  // cov(state at the end, nu)
  if (predicted) {
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
      N_.noalias() += dm_ * linear_C_nb_.transpose();
      if constexpr (NS == 12) {
        N_.noalias() += X_.template middleCols<3>(6) * H.template block<3, 3>(0, 6).transpose();
        N_.noalias() += X_.template middleCols<3>(9) * H.template block<3, 3>(0, 9).transpose();
      }
    }
    move_columns(motion, F, move.turn_n, t);
    move_columns_by_biases(Phi, rho);
  }

  const Vector3d nu = v_ + move.mean_dv_n;
  const Vector3d free_mean = navigate(block, motion, move, linear, rho);
  P_ = (Phi * P_ * Phi.transpose() + Q).eval();
  if (predicted) {
    const Eigen::LLT<Matrix3d> root(S);
    if (setup_.keep_innovations)
      (observed ? result_.innovations : result_.left_out).push_back(innovation(index, nu, root, free_mean));
    if (observed) update(nu, root, M);
  }
  P_ = (0.5 * (P_ + P_.transpose())).eval();
}

template <int NS>
void Filter<NS>::update(const Vector3d& nu, const Eigen::LLT<Matrix3d>& root, const Cross& M) {
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
  const auto rows = buffer_.leftCols(buffered_);
  const int narrow = std::min(setup_.narrow_columns, effects_.columns);
  const int wide = p_ - narrow;
  moments_.topLeftCorner(wide, wide).template selfadjointView<Eigen::Lower>().rankUpdate(rows.topRows(wide));
  moments_.row(p_).head(p_).noalias() += rows.row(p_) * rows.topRows(p_).transpose();
  if (narrow > 0) {
    const auto one_at_a_time = rows.middleRows(wide, narrow);
    moments_.block(wide, 0, narrow, setup_.narrow_against).noalias() +=
        one_at_a_time * rows.topRows(setup_.narrow_against).transpose();
    moments_.diagonal().segment(wide, narrow) += one_at_a_time.rowwise().squaredNorm();
  }
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
