// One step of navigation at a station that does not move, and the noise that enters over it.
//
// n turns with the earth, so what the accelerometers gained is seen from a frame that has turned meanwhile:
//   C_nb(end) = Exp(-w_ie t) C_nb Exp(rotation),  v(end) = v + (I - t/2 [w_ie x]) C_nb velocity - g t U
//   mean v    = v + (I - t/3 [w_ie x]) C_nb mean_velocity - g t/2 U
// Error state (psi, v), psi with C_computed = (I + [psi x]) C_true, over the step with specific force f_n, F = [f_n x]:
//   psi(end) = Exp(-w_ie t) psi,  v(end) = v - F t psi,  mean v = v - F t/2 psi
// Not modelled: Coriolis on v, curvature of the earth (v is centimetres a second, for seconds).
#pragma once

#include <algorithm>
#include <cmath>

#include <Eigen/Core>

#include "calib/model/attitude.h"
#include "calib/model/noise_model.h"
#include "calib/statistics/block_motion.h"

namespace turncal {

// What turns over a step, whatever the attitude.
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

// The whole number next to x, |x| < 2^51: as std::round but where it has a choice, without a call of the library.
inline double nearest(double x) {
  constexpr double whole_from_here = 6755399441055744.0;  // 1.5 * 2^52
  return (x + whole_from_here) - whole_from_here;
}

// Quantisation noise of the mean velocity over N samples that hold `counts` pulses. The count is short of the truth by a sawtooth
// of one pulse, -sum sin(2 pi k x) / pi k, that begins anywhere and is sampled every s teeth, s the counts a sample. Of harmonic k
// the mean over N samples keeps sin(pi k s N) / N sin(pi k s): all of it where k s is whole, else, s N not known to a part of a
// tooth, in the mean square 1 / 2 (N sin(pi k s))^2. Many fine teeth: pulse^2 / 360 (s N)^2. Of the harmonics above the eighth one in N
// is near a whole number.
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

}  // namespace turncal
