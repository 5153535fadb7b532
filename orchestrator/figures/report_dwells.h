// What each dwell after a rotation says about the residual, in the axes of the sensors: the numbers behind the report's figures.
//
// The residual is the velocity (n frame, m/s) that the unit shows when it is navigated freely from the beginning of the last
// rotation on, although it stands. From each dwell after a rotation three numbers are read off:
//   v(t) = v0 + a t + j t (t - T) / 2, t from the start of the dwell, least squares over T, at most fit_window_s
//   accelerometer residual  C_bn a                   what the accelerometers read too much (and g times the tilt error)
//   tilt residual           C_bn (a_E, 0, -a_N) / g  attitude error that the rotation left; horizontal axes only
//   gyro residual           C_bn (j_E, 0, -j_N) / g  what the gyros read too much; horizontal axes only
// from v' = -f x psi, f = (0, g, 0), psi' = C_nb dw_b (calib/joint/joint_filter.h). C_nb is the commanded heading, levelled by the
// specific force: good to the table's errors, which is enough to tell the axes apart.
// Not modelled: which sensor is to blame. That is what the scores are for; these numbers show it to the eye.
#pragma once

#include <utility>
#include <vector>

#include <Eigen/Core>

#include "calib/evidence/diagnosis.h"
#include "calib/statistics/compression.h"

namespace turncal {

struct DwellResidual {
  int segment = 0;
  int step = 0;
  double time_s = 0.0;                                      // middle of the fit, from the first sample
  Eigen::Vector3d table_deg = Eigen::Vector3d::Zero();      // heading, pitch, roll as commanded, -180..180
  Eigen::Vector3d f_b_g = Eigen::Vector3d::Zero();          // specific force in g
  double temperature_c = 0.0;                               // NaN: not measured
  Eigen::Vector3d turned_rad = Eigen::Vector3d::Zero();     // about each body axis, since the dwell before
  Eigen::Vector3d fastest_radps = Eigen::Vector3d::Zero();  // largest rate on that way, with its sign
  Eigen::Vector3d level_share = Eigen::Vector3d::Zero();    // of each body axis: 1 horizontal, 0 vertical
  struct Side {
    Eigen::Vector3d velocity_mps = Eigen::Vector3d::Zero();  // n, at the start of the dwell
    Eigen::Vector3d accel_mps2 = Eigen::Vector3d::Zero();    // b
    Eigen::Vector3d tilt_rad = Eigen::Vector3d::Zero();      // b
    Eigen::Vector3d gyro_radps = Eigen::Vector3d::Zero();    // b
  } before, after;
};

// Longer dwells are cut: after minutes the angle random walk hides everything else.
inline constexpr double fit_window_s = 120.0;
std::vector<DwellResidual> dwell_residuals(const Diagnosis& diagnosis, const CompressedRecording& recording);

// Runs of static seconds after one rotation (the first: before any), [first, last) in `points`.
std::vector<std::pair<std::size_t, std::size_t>> rests(const std::vector<ResidualPoint>& points);
inline bool before_any_rotation(const ResidualPoint& point) { return point.since_rotation_s > 1e6; }

// rms of the residual velocity over the first velocity_seconds of every dwell, as on held-out data (holdout.h). NaN: none.
double velocity_rms_mps(const Diagnosis& diagnosis, bool after);

}  // namespace turncal
