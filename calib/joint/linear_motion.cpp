#include "calib/joint/linear_motion.h"

#include "calib/model/attitude.h"

namespace turncal {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// Largest distance of the attitude of linearisation from the navigated one.
constexpr double max_linear_rad = 0.02;
// Tilt at which a rest is levelled again, from a gyro bias far off or a random walk of degrees. The vertical force g (1
// - tilt^2 / 2) is not linear in the tilt: 5e-7 of g.
constexpr double max_tilt_rad = 0.001;

}  // namespace

void take_off(const Vector3d& turn, const Vector3d& push, BlockMotion& m) {
  m.velocity -= push + 0.5 * (turn.cross(m.velocity) + m.rotation.cross(push));
  m.mean_velocity -= 0.5 * push + turn.cross(m.mean_velocity) / 3.0;
  m.rotation -= turn;
}

WalkNoise walk_noise(const NoiseModel& noise) {
  return {noise.angle_random_walk.cwiseAbs2(), noise.velocity_random_walk.cwiseAbs2()};
}

LinearMotion::LinearMotion(const CompressedRecording& recording, const Parameters& parameters,
                           const EffectModel& effects, const FilterSetup& setup, const Options& options)
    : recording_(recording),
      effects_(effects),
      setup_(setup),
      options_(options),
      model_(sensor_model(parameters, recording.info)),
      unit_(si_per_unit(recording.info)),
      earth_(earth_rate_n(recording.info.latitude_deg)),
      gravity_(recording.info.gravity_mps2),
      F_(skew(Vector3d(0.0, recording.info.gravity_mps2, 0.0))),
      p_(options.columns ? parameter_count + effects.columns : 0),
      nothing_taken_off_(effects.values.isZero(0.0)),
      cut_(setup.breaks.begin()) {
  before_.setZero(p_, 3);
  turned_.setZero(effects.columns, 3);
  pushed_.setZero(effects.columns, 3);
  regressors_ = EffectRegressors(effects.columns);
}

bool LinearMotion::still(std::size_t index) const { return recording_.blocks[index].whole_second; }

bool LinearMotion::observed(std::size_t index) const {
  return still(index) && (setup_.unobserved.empty() || !setup_.unobserved[index]);
}

bool LinearMotion::next(LinearInterval& interval) {
  // Before the first rest nothing is known of the attitude, so nothing is navigated.
  for (; chain_ == 0 && index_ < recording_.blocks.size() && !still(index_); ++index_) {
    if (setup_.keep_taken_off) taken_off.emplace_back();
    for (; cut_at(index_); ++cut_)
      if (cut_->begins_recording) begin_recording(cut_->block);
  }
  if (index_ >= recording_.blocks.size()) return false;
  begin(index_, interval);
  add_breaks(index_, interval);
  if (still(index_))
    rest(interval);
  else
    turn(interval);
  return true;
}

void LinearMotion::begin(std::size_t index, LinearInterval& interval) const {
  interval.block = index;
  interval.t = 0.0;
  interval.begins_chain = interval.begins_recording = false;
  interval.cut_psi = interval.cut_v = 0.0;
  interval.jump_psi.setZero();
  interval.jump_v.setZero();
  interval.turn.setIdentity();
  for (Matrix3d* zero : {&interval.v_psi, &interval.psi_bg, &interval.v_bg, &interval.v_ba}) zero->setZero();
  interval.B_psi.setZero(p_, 3);
  interval.B_v.setZero(p_, 3);
  interval.still = interval.observed = false;
}

void LinearMotion::add_breaks(std::size_t index, LinearInterval& interval) {
  for (; cut_at(index); ++cut_) {
    if (cut_->nothing_is_known()) chain_due_ = true;
    if (cut_->begins_recording) begin_recording(cut_->block);
    interval.cut_psi += cut_->attitude_sigma_rad * cut_->attitude_sigma_rad;
    interval.cut_v += cut_->velocity_sigma_mps * cut_->velocity_sigma_mps;
  }
}

void LinearMotion::begin_recording(std::size_t block) {
  ++of_recording_;
  recording_due_ = true;
  recording_begin_ = block;
  last_rotation_end_s_ = -1e9;
}

WalkNoise LinearMotion::filled_in(const Block& block) const {
  const auto rate = [&](const Eigen::Vector3f& variance, const Matrix3d& scale) -> Vector3d {
    return variance.cast<double>() * (scale(0, 0) * scale(0, 0) / block.duration_s);
  };
  return {rate(block.gyro_filled, model_.gyro_scale), rate(block.accel_filled, model_.accel_scale)};
}

// Fills a gap with the mean motion of its neighbours; the Break beside it says how far that may be wrong.
void LinearMotion::fill_gap(std::size_t index, BlockMotion& motion) const {
  const Block& block = recording_.blocks[index];
  if (block.missing == 0) return;
  const double lost = block.missing * recording_.info.sample_period_s;
  Vector3d rate = Vector3d::Zero();
  Vector3d force = Vector3d::Zero();
  int sides = 0;
  for (const std::size_t k : {index - 1, index + 1}) {
    if (k >= recording_.blocks.size() || recording_.blocks[k].missing > 0) continue;
    const Block& side = recording_.blocks[k];
    rate += model_.gyro_scale * side.gyro / side.duration_s;
    force += model_.accel_scale * side.accel / side.duration_s;
    ++sides;
  }
  if (sides > 0) take_off(-rate / sides * lost, -force / sides * lost, motion);
}

void LinearMotion::effects_on(std::size_t index, BlockMotion& motion) {
  const Block& block = recording_.blocks[index];
  const double t = block.duration_s;
  BlockState s;
  s.w_b = motion.rotation / t;
  s.f_b = model_.accel_scale * block.accel / t - model_.accel_bias_mps2;
  // Over a turn the differences of the rate sum to zero, however abruptly the table accelerates.
  s.w_dot_b.setZero();
  if (!block.whole_second && index + 1 < recording_.blocks.size())
    s.w_dot_b = model_.gyro_scale * (recording_.blocks[index + 1].gyro_at_start - block.gyro_at_start) /
                (t * recording_.info.sample_period_s);
  s.C_nb = C_nb_ * rotation_exp(0.5 * motion.rotation);
  s.duration_s = t;
  s.recording = of_recording_;
  s.time_s = recording_.middle_s(block, recording_begin_);
  const bool rotating = recording_.rotates(block);
  if (rotating) last_rotation_end_s_ = s.time_s + 0.5 * t;
  s.since_rotation_s = rotating ? 1e9 : s.time_s - last_rotation_end_s_;
  take_temperature(block, effects_.reference_temperature_c, s);
  s.table_rad = rad_per_deg * Vector3d(angles_of(recording_.segments[block.segment]).value.data());
  effects_.regressors(s, regressors_);
  if (p_ > 0) {
    turned_ = regressors_.gyro.transpose();
    pushed_ = regressors_.accel.transpose();
  }
  if (nothing_taken_off_) {
    if (setup_.keep_taken_off) taken_off.emplace_back();
    return;
  }
  const Vector3d turn = regressors_.gyro * effects_.values * t;
  const Vector3d push = regressors_.accel * effects_.values * t;
  if (setup_.keep_taken_off) taken_off.push_back({turn, push});
  take_off(turn, push, motion);
}

BlockMotion LinearMotion::block_motion(std::size_t index) {
  BlockMotion motion = evaluate(recording_.blocks[index], model_, recording_.info.sample_period_s);
  fill_gap(index, motion);
  if (effects_.columns > 0)
    effects_on(index, motion);
  else if (setup_.keep_taken_off)
    taken_off.emplace_back();
  return motion;
}

// Returns the derivatives to second order in the rotation; psi turns v with the measured force.
JumpByReadings LinearMotion::jump_by_readings(const BlockMotion& motion, double t) const {
  JumpByReadings jump = JumpByReadings::Zero();
  jump.topLeftCorner<3, 3>() = t * linear_C_nb_ * left_jacobian(motion.rotation);
  jump.bottomLeftCorner<3, 3>() = -0.5 * t * linear_C_nb_ * skew(motion.velocity);
  jump.bottomRightCorner<3, 3>() = t * linear_C_nb_ * (Matrix3d::Identity() + 0.5 * skew(motion.rotation));
  return jump;
}

// Propagates the columns of (psi, v) over a block. Effects enter negatively: the model takes them off.
void LinearMotion::move_columns(const Block& block, const BlockMotion& motion, const Matrix3d& turn_n,
                                LinearInterval& interval) {
  const double t = block.duration_s;
  differentiate(block, motion, model_, unit_, interval.still, base_);
  const Matrix3d to_n = linear_C_nb_.transpose();
  const Matrix3d rotate = (linear_C_nb_ * left_jacobian(motion.rotation)).transpose();
  interval.B_v.col(0) -= t * gravity_ * interval.B_psi.col(2);  // F psi = g (psi_E, 0, -psi_N)
  interval.B_v.col(2) += t * gravity_ * interval.B_psi.col(0);
  before_.swap(interval.B_psi);
  set_product(before_, turn_n.transpose(), interval.B_psi);
  add_product(base_.rotation, rotate, interval.B_psi.topRows<BlockDerivatives::turning>());
  add_product(base_.velocity, to_n, interval.B_v.topRows<parameter_count>());
  const int n = effects_.columns;
  if (n == 0) return;
  const JumpByReadings less = -jump_by_readings(motion, t).transpose();
  add_product(turned_, less.topLeftCorner<3, 3>(), interval.B_psi.bottomRows(n));
  add_product(turned_, less.topRightCorner<3, 3>(), interval.B_v.bottomRows(n));
  add_product(pushed_, less.bottomRightCorner<3, 3>(), interval.B_v.bottomRows(n));
}

// Sets the columns of the mean velocity over a block at rest, after move_columns().
void LinearMotion::mean_columns(const BlockMotion& motion, const Matrix3d& to_n, double t, LinearInterval& interval) {
  interval.D.resize(p_, 3);
  set_product(base_.mean_velocity, to_n, interval.D.topRows<parameter_count>());
  const int n = effects_.columns;
  if (n == 0) return;
  const Matrix3d by_turned = t / -6.0 * skew(motion.velocity) * to_n;
  const Matrix3d by_pushed = -0.5 * t * to_n;
  set_product(turned_, by_turned, interval.D.bottomRows(n));
  add_product(pushed_, by_pushed, interval.D.bottomRows(n));
}

// On the first second of a rest, levels the navigated motion and stops it.
void LinearMotion::begin_rest(const Block& block, const BlockMotion& motion, LinearInterval& interval) {
  const Vector3d f_b = motion.velocity / motion.velocity.norm() * gravity_;
  if (chain_due_) {
    const double heading = chain_ < std::ssize(setup_.headings_rad)
                               ? setup_.headings_rad[chain_]
                               : (setup_.headings_rad.empty() ? 0.0 : setup_.headings_rad.front());
    const Segment& at = recording_.segments[block.segment];
    C_nb_ = level(attitude_from_angles(at.heading_deg * rad_per_deg + heading, at.pitch_deg * rad_per_deg,
                                       at.roll_deg * rad_per_deg) *
                      setup_.mounting,
                  f_b);
    linear_C_nb_ = C_nb_;
    v_.setZero();
    interval.begins_chain = true;
    interval.begins_recording = recording_due_;
    chain_due_ = recording_due_ = false;
    ++chain_;
  } else {
    const Vector3d up = C_nb_ * f_b / gravity_;
    const bool tilted = Vector3d(up.x(), 0.0, up.z()).norm() > max_tilt_rad;
    if (was_still_ && !tilted) return;
    const Matrix3d levelled = level(C_nb_, f_b);
    const Matrix3d by = C_nb_ * levelled.transpose();  // Exp(psi taken away)
    interval.jump_psi = 0.5 * Vector3d(by(2, 1) - by(1, 2), by(0, 2) - by(2, 0), by(1, 0) - by(0, 1));
    interval.jump_v = v_;
    C_nb_ = levelled;
    v_.setZero();
  }
  if ((linear_C_nb_ - C_nb_).squaredNorm() > 2.0 * max_linear_rad * max_linear_rad) linear_C_nb_ = C_nb_;
}

// The turn of n is cached: most blocks are equally long.
StepTurn LinearMotion::step_turn(const BlockMotion& motion, double t) {
  if (t != turned_for_s_) {
    turn_n_ = rotation_exp(-earth_ * t);
    turned_for_s_ = t;
  }
  return {turn_n_, rotation_exp(0.5 * motion.rotation)};
}

void LinearMotion::rest(LinearInterval& interval) {
  const BlockMotion motion = block_motion(index_);
  const Block& block = recording_.blocks[index_];
  begin_rest(block, motion, interval);
  interval.still = true;
  interval.observed = observed(index_);
  interval.noise.clear();
  interval.v_start = v_;
  ++index_;
  was_still_ = true;
  const double t = interval.t = block.duration_s;
  interval.filled = filled_in(block);
  interval.time_s =
      double(block.start_sample - recording_.blocks.front().start_sample) * recording_.info.sample_period_s +
      0.5 * block.samples * recording_.info.sample_period_s;
  const StepTurn turned = step_turn(motion, t);
  const VelocityStep move = velocity_step(C_nb_, motion, earth_, gravity_, t);
  const AttitudeStep linear = attitude_step(linear_C_nb_, turned);
  interval.C = linear.C_mid;
  interval.F = F_;
  interval.turn = turned.turn_n;
  interval.v_psi = -F_ * t;
  interval.psi_bg = linear.C_mid * t;
  interval.v_bg = -F_ * linear.C_mid * (0.5 * t * t);
  interval.v_ba = linear.C_mid * t;
  interval.y = v_ + move.mean_dv_n;
  for (int axis = 0; axis < 3; ++axis)
    interval.quantisation[axis] =
        setup_.noise.accel_pulse_mps > 0.0
            ? quantisation_variance(block.accel[axis], block.samples, setup_.noise.accel_pulse_mps)
            : 0.0;
  if (p_ > 0) {
    move_columns(block, motion, turned.turn_n, interval);
    mean_columns(motion, linear_C_nb_.transpose(), t, interval);
  }
  keep_step(interval.block, motion, turned.turn_n, linear.C_mid, t);
  if (setup_.keep_steps) {
    steps.back().begins_chain = interval.begins_chain;
    steps.back().begins_recording = interval.begins_recording;
  }
  C_nb_ = attitude_step(C_nb_, turned).C_end;
  linear_C_nb_ = linear.C_end;
  v_ += move.dv_n;
}

void LinearMotion::keep_step(std::size_t index, const BlockMotion& motion, const Matrix3d& turn_n,
                             const Matrix3d& C_mid, double t) {
  if (!setup_.keep_steps) return;
  FilterStep step;
  step.block = index;
  step.rho = setup_.noise.has_bias_instability() ? std::exp(-t / setup_.noise.bias_correlation_s) : 1.0;
  step.rotation = motion.rotation;
  step.turn_n = turn_n;
  step.F = F_;
  step.C_mid = C_mid;
  step.jump = jump_by_readings(motion, t);
  steps.push_back(std::move(step));
}

void LinearMotion::turn(LinearInterval& interval) {
  interval.noise.resize(options_.sources.size());
  for (LinearInterval::Entered& n : interval.noise) n = {Matrix3d::Zero(), Matrix3d::Zero(), Matrix3d::Zero()};
  interval.v_start = v_;
  was_still_ = false;
  double rho = 1.0;
  const std::size_t first = index_;
  for (; index_ < recording_.blocks.size() && !still(index_) && (index_ == first || !cut_at(index_)); ++index_) {
    const Block& block = recording_.blocks[index_];
    const BlockMotion motion = block_motion(index_);
    const double t = block.duration_s;
    const StepTurn turned = step_turn(motion, t);
    const VelocityStep move = velocity_step(C_nb_, motion, earth_, gravity_, t);
    const AttitudeStep linear = attitude_step(linear_C_nb_, turned);
    const Matrix3d Ft = F_ * t;
    const Matrix3d& T = turned.turn_n;
    const Matrix3d by_bias = rho * t * linear.C_mid;
    interval.v_bg -= Ft * interval.psi_bg + 0.5 * Ft * by_bias;
    interval.psi_bg = T * interval.psi_bg + by_bias;
    interval.v_ba += by_bias;
    interval.v_psi -= Ft * interval.turn;
    interval.turn = T * interval.turn;
    rho *= std::exp(-t / setup_.noise.bias_correlation_s);
    // Filled-in samples are one more source, of known size.
    if (!block.gyro_filled.isZero(0.0F) && interval.noise.size() == options_.sources.size())
      interval.noise.push_back({Matrix3d::Zero(), Matrix3d::Zero(), Matrix3d::Zero()});
    for (std::size_t k = 0; k < interval.noise.size(); ++k) {
      LinearInterval::Entered& n = interval.noise[k];
      const WalkNoise source = k < options_.sources.size() ? options_.sources[k] : filled_in(block);
      const StepNoise q = step_noise(linear.C_mid * source.gyro.asDiagonal() * linear.C_mid.transpose(),
                                     linear.C_mid * source.accel.asDiagonal() * linear.C_mid.transpose(), F_, t);
      const Matrix3d tilted = n.psi_psi * Ft.transpose();
      const Matrix3d crossed = Ft * n.psi_v;
      n.v_v += Ft * tilted - crossed - crossed.transpose() + q.v_v;
      n.psi_v = T * (n.psi_v - tilted) + q.psi_v;
      n.psi_psi = T * n.psi_psi * T.transpose() + q.psi_psi;
    }
    if (p_ > 0) move_columns(block, motion, turned.turn_n, interval);
    keep_step(index_, motion, turned.turn_n, linear.C_mid, t);
    C_nb_ = attitude_step(C_nb_, turned).C_end;
    linear_C_nb_ = linear.C_end;
    v_ += move.dv_n;
    interval.t += t;
  }
}

}  // namespace turncal
