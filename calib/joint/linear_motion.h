// A recording as a linear system about the navigated motion: what the filter (joint_filter.h) runs on.
//
// The recording is navigated once with given parameters and cut into intervals: blocks at rest, and everything between two rests in one.
// The state is the error of the navigated motion,
// psi (attitude error in n, C_computed = (I + [psi x]) C_true), v (velocity), b_g, b_a (excess readings of the sensors),
// and over an interval, with p the parameters and effects' values,
//   psi(end) = turn psi + psi_bg b_g + B_psi dp,       v(end) = v + v_psi psi + v_bg b_g + v_ba b_a + B_v dp
//   mean v (at rest) = y = v + v_psi psi / 2 + ... + D dp: what should be zero
// The navigation is closed: at the beginning of every rest the motion is levelled and stopped. The jump is known (jump_psi, jump_v), so
// nothing is lost, and psi stays small. A chain is a stretch that one attitude is carried through. It begins at the first rest, and anew
// after a break across which nothing is known, with the commanded heading plus FilterSetup::headings_rad. The transitions are evaluated
// along an attitude that does not jump: else every jump would look like a turn of the unit, and directions that nothing excites would seem
// determined (first-estimates Jacobians: Huang, Mourikis, Roumeliotis, Int. J. Rob. Res. 29 (2010) 502).
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include <Eigen/Core>

#include "calib/joint/joint_filter.h"
#include "calib/model/parameters.h"
#include "calib/statistics/block_motion.h"

namespace turncal {

// One step of navigation at a station that does not move, and the noise that enters over it.
//
// n turns with the earth, so what the accelerometers gained is seen from a frame that has turned meanwhile:
//   C_nb(end) = Exp(-w_ie t) C_nb Exp(rotation),  v(end) = v + (I - t/2 [w_ie x]) C_nb velocity - g t U
//   mean v    = v + (I - t/3 [w_ie x]) C_nb mean_velocity - g t/2 U
// Error state (psi, v), psi with C_computed = (I + [psi x]) C_true, over the step with specific force f_n, F = [f_n x]:
//   psi(end) = Exp(-w_ie t) psi,  v(end) = v - F t psi,  mean v = v - F t/2 psi
// Not modelled: Coriolis on v, curvature of the earth (v is centimetres a second, for seconds).
// Rotations over a step that do not depend on the attitude.
struct StepTurn {
  Eigen::Matrix3d turn_n;  // Exp(-w_ie t)
  Eigen::Matrix3d half;    // Exp(rotation / 2)
};

struct AttitudeStep {
  Eigen::Matrix3d C_mid;  // C_nb in the middle of the step
  Eigen::Matrix3d C_end;
};
inline AttitudeStep attitude_step(const Eigen::Matrix3d& C_nb, const StepTurn& turn) {
  AttitudeStep step;
  step.C_mid.noalias() = C_nb * turn.half;
  const Eigen::Matrix3d seen = step.C_mid * turn.half;
  step.C_end.noalias() = turn.turn_n * seen;
  return step;
}

struct VelocityStep {
  Eigen::Vector3d dv_n;       // v(end) - v
  Eigen::Vector3d mean_dv_n;  // mean v - v
};
inline VelocityStep velocity_step(const Eigen::Matrix3d& C_nb, const BlockMotion& motion,
                                  const Eigen::Vector3d& earth_n, double gravity_mps2, double t) {
  const Eigen::Vector3d gained = C_nb * motion.velocity;
  const Eigen::Vector3d mean = C_nb * motion.mean_velocity;
  const Eigen::Vector3d gravity(0.0, -gravity_mps2, 0.0);
  return {gained - 0.5 * t * earth_n.cross(gained) + gravity * t,
          mean - t / 3.0 * earth_n.cross(mean) + 0.5 * t * gravity};
}

// Covariance of the noise that enters over a step of length t, for the state at its end (psi, v) and for the mean velocity
// z; W and V are the covariance rates of the walks in n (rad^2/s, m^2/s^3). From psi = walk, v' = -F psi + walk. z is formed
// from the whole rotation r as if it were even (BlockMotion::mean_velocity: r/3), not from the walk's course: its noise from
// the gyros is -F r t/6, hence t^3/36 and t^3/12 where the mean of the true course had t^3/20 and t^3/8.
struct StepNoise {
  Eigen::Matrix3d psi_psi, psi_v, v_v, psi_z, v_z, z_z;
};
inline StepNoise step_noise(const Eigen::Matrix3d& W, const Eigen::Matrix3d& V, const Eigen::Matrix3d& F, double t) {
  StepNoise q;
  const Eigen::Matrix3d WF = W * F.transpose();
  const Eigen::Matrix3d FWF = F * WF;
  q.psi_psi = W * t;
  q.psi_v = -WF * (t * t / 2.0);
  q.v_v = V * t + FWF * (t * t * t / 3.0);
  q.psi_z = -WF * (t * t / 6.0);
  q.v_z = V * (t / 2.0) + FWF * (t * t * t / 12.0);
  q.z_z = V * (t / 3.0) + FWF * (t * t * t / 36.0);
  return q;
}

// Returns the integer nearest to x, |x| < 2^51: std::round except for ties, without a library call.
inline double nearest(double x) {
  constexpr double whole_from_here = 6755399441055744.0;  // 1.5 * 2^52
  return (x + whole_from_here) - whole_from_here;
}

// Returns the quantisation variance of the mean velocity over N samples that hold `counts` pulses. The count lags the
// truth by a sawtooth of one pulse, -sum sin(2 pi k x) / pi k, of unknown phase, sampled every s teeth, s the counts a
// sample. The mean over N samples keeps the factor sin(pi k s N) / N sin(pi k s) of harmonic k: all of it where k s is
// whole; else, since s N is not known to a part of a tooth, 1 / 2 (N sin(pi k s))^2 in the mean square. Many fine
// teeth: pulse^2 / 360 (s N)^2. Of the harmonics above the eighth one in N is near a whole number.
inline double quantisation_variance(double counts, int samples, double pulse) {
  constexpr double pi_square = 9.8696044010893586;
  const double s = counts / samples;
  double sum = 0.00595 / samples;  // k > 8
  for (int k = 1; k <= 8; ++k) {
    const double d = std::abs(k * s - nearest(k * s));
    const double teeth = d * samples;
    const double arch = 4.0 * d * (1.0 - d);
    const double sine = 4.0 * arch / (5.0 - arch);  // sin(pi d) to 0.002 (Bhaskara)
    const double whole = std::max(1.0 - pi_square * teeth * teeth / 3.0, 0.0);
    const double kept = teeth < 0.4 ? whole : std::min(0.5 / (samples * sine * samples * sine), 0.4);
    sum += kept / (2.0 * pi_square * k * k);
  }
  return pulse * pulse * sum;
}

// Variance rates of white noise on the body axes: rad^2/s, m^2/s^3.
struct WalkNoise {
  Eigen::Vector3d gyro = Eigen::Vector3d::Zero();
  Eigen::Vector3d accel = Eigen::Vector3d::Zero();
};
WalkNoise walk_noise(const NoiseModel& noise);

// Removes a rotation (rad) and a velocity (m/s) that the sensors read but the unit did not make from the motion over a block.
void take_off(const Eigen::Vector3d& turn, const Eigen::Vector3d& push, BlockMotion& motion);

// One row a parameter, so that all of them move through a 3x3 product together.
using Columns = Eigen::Matrix<double, Eigen::Dynamic, 3>;

struct LinearInterval {
  std::size_t block = 0;  // the first one
  double time_s = 0.0;    // middle, from the first sample
  double t = 0.0;
  // Before the interval: a chain begins (nothing before counts), or variances are added, and the navigated motion jumps.
  bool begins_chain = false, begins_recording = false;
  double cut_psi = 0.0, cut_v = 0.0;  // variances
  Eigen::Vector3d jump_psi, jump_v;
  Eigen::Vector3d v_start;  // of the navigated motion, after the jump

  Eigen::Matrix3d turn, v_psi, psi_bg, v_bg, v_ba;
  Columns B_psi, B_v;  // p x 3

  bool still = false;     // at rest: y, D and the noise by C, F
  bool observed = false;  // still, and not left out
  Eigen::Matrix3d C, F;
  Eigen::Vector3d y, quantisation;
  Columns D;
  WalkNoise filled;  // noise of filled-in samples, body axes
  // not still: covariance of the noise that enters, one per source asked for; then that of filled-in samples, if there are any
  struct Entered {
    Eigen::Matrix3d psi_psi, psi_v, v_v;
  };
  std::vector<Entered> noise;
};

class LinearMotion {
 public:
  struct Options {
    bool columns = true;
    std::vector<WalkNoise> sources;  // the noise of turns is given for each
  };
  LinearMotion(const CompressedRecording& recording, const Parameters& parameters, const EffectModel& effects,
               const FilterSetup& setup, const Options& options);
  // The next interval; false at the end. `interval` is reused: nothing is allocated after the first few.
  bool next(LinearInterval& interval);
  std::vector<TakenOff> taken_off;  // of every block so far, with FilterSetup::keep_taken_off
  std::vector<FilterStep> steps;    // of every block so far, with FilterSetup::keep_steps

 private:
  BlockMotion block_motion(std::size_t index);
  void effects_on(std::size_t index, BlockMotion& motion);
  void fill_gap(std::size_t index, BlockMotion& motion) const;
  WalkNoise filled_in(const Block& block) const;
  bool still(std::size_t index) const;
  bool observed(std::size_t index) const;
  bool cut_at(std::size_t index) const { return cut_ != setup_.breaks.end() && cut_->block <= index; }
  void add_breaks(std::size_t index, LinearInterval& interval);
  void begin_recording(std::size_t block);
  void begin_rest(const Block& block, const BlockMotion& motion, LinearInterval& interval);
  void rest(LinearInterval& interval);
  void turn(LinearInterval& interval);
  void move_columns(const Block& block, const BlockMotion& motion, const Eigen::Matrix3d& turn_n,
                    LinearInterval& interval);
  void mean_columns(const BlockMotion& motion, const Eigen::Matrix3d& to_n, double t, LinearInterval& interval);
  void begin(std::size_t index, LinearInterval& interval) const;
  StepTurn step_turn(const BlockMotion& motion, double t);
  JumpByReadings jump_by_readings(const BlockMotion& motion, double t) const;
  void keep_step(std::size_t index, const BlockMotion& motion, const Eigen::Matrix3d& turn_n,
                 const Eigen::Matrix3d& C_mid, double t);

  const CompressedRecording& recording_;
  const EffectModel& effects_;
  const FilterSetup& setup_;
  const Options options_;
  const SensorModel model_;
  const ParameterVector unit_;
  const Eigen::Vector3d earth_;
  const double gravity_;
  // [f_n x]. The station stands still, so the specific force in n is known, in turns as well. The navigated one has a
  // horizontal part, g times the tilt, which would make the heading seem observable.
  const Eigen::Matrix3d F_;
  const int p_;
  const bool nothing_taken_off_;  // effects are candidates only

  std::size_t index_ = 0;
  std::vector<Break>::const_iterator cut_;
  int chain_ = 0;
  bool chain_due_ = true;
  int of_recording_ = 0;  // index of the recording
  bool recording_due_ = false;
  std::size_t recording_begin_ = 0;  // its first block
  bool was_still_ = false;
  Eigen::Matrix3d C_nb_ = Eigen::Matrix3d::Identity();
  Eigen::Matrix3d linear_C_nb_ = Eigen::Matrix3d::Identity();
  Eigen::Vector3d v_ = Eigen::Vector3d::Zero();
  double turned_for_s_ = -1.0;
  Eigen::Matrix3d turn_n_ = Eigen::Matrix3d::Identity();  // Exp(-w_ie t) for t = turned_for_s_
  Columns before_;                                        // B_psi before the block
  Columns turned_, pushed_;  // rate and force of one unit of each effect in the block, body frame
  BlockDerivatives base_;
  EffectRegressors regressors_;
  double last_rotation_end_s_ = -1e9;
};

// Products of three columns (a row per parameter) with a 3x3 matrix: they propagate the columns of all parameters together.
//
// All three results of a row are computed while its values are at hand; a general product passes over the rows three times.

// to (+)= from * by, n rows; columns are `stride` apart and do not overlap.
template <bool add>
inline void column_product(const double* __restrict from, Eigen::Index from_stride, const Eigen::Matrix3d& by,
                           double* __restrict to, Eigen::Index to_stride, Eigen::Index n) {
  const double* __restrict x = from;
  const double* __restrict y = from + from_stride;
  const double* __restrict z = from + 2 * from_stride;
  double* __restrict a = to;
  double* __restrict b = to + to_stride;
  double* __restrict c = to + 2 * to_stride;
  const double xa = by(0, 0), ya = by(1, 0), za = by(2, 0), xb = by(0, 1), yb = by(1, 1), zb = by(2, 1), xc = by(0, 2),
               yc = by(1, 2), zc = by(2, 2);
  for (Eigen::Index i = 0; i < n; ++i) {
    const double xi = x[i], yi = y[i], zi = z[i];
    a[i] = (add ? a[i] : 0.0) + (xi * xa + yi * ya + zi * za);
    b[i] = (add ? b[i] : 0.0) + (xi * xb + yi * yb + zi * zb);
    c[i] = (add ? c[i] : 0.0) + (xi * xc + yi * yc + zi * zc);
  }
}

// On columns of matrices: from.middleCols<3>(at) and so on, each with a data() and an outerStride().
template <class From, class To>
inline void set_product(const From& from, const Eigen::Matrix3d& by, To&& to) {
  column_product<false>(from.data(), from.outerStride(), by, to.data(), to.outerStride(), to.rows());
}
template <class From, class To>
inline void add_product(const From& from, const Eigen::Matrix3d& by, To&& to) {
  column_product<true>(from.data(), from.outerStride(), by, to.data(), to.outerStride(), to.rows());
}

}  // namespace turncal
