// Figures of a diagnosis: residual velocity over time, Allan deviation, residuals of each dwell against their possible causes,
// and the bar chart of the candidates' scores with their common threshold.
#pragma once

#include <Eigen/Core>

#include <cmath>
#include <string>
#include <string_view>
#include <vector>

#include "calib/evidence/diagnosis.h"
#include "calib/statistics/compression.h"
#include "orchestrator/figures/drawing.h"

namespace turncal {

inline std::string component_name(const EffectColumn& column) {
  return std::string(column.entry->components[std::size_t(column.component)]);
}
inline double z_of(const EstimatedEffect& e) { return e.sigma > 0.0 ? std::abs(e.value) / e.sigma : 0.0; }
// Return the estimated components of an effect: in order, and the strongest first.
std::vector<const EstimatedEffect*> components_of(const JointResult& result, std::string_view effect);
std::vector<const EstimatedEffect*> strongest_of(const JointResult& result, std::string_view effect);

// Returns whether effects were added: then there are two curves, before and after.
inline bool has_after(const Diagnosis& diagnosis) { return !diagnosis.effect_names.empty(); }
// Returns one or two series without points: residual, or before and after.
std::vector<Series> before_after_series(bool with_after);

Figure time_figure(const Diagnosis& diagnosis);
// Marks the beginnings of the sequence's steps on every time axis ("time, h", "time, min").
void mark_steps(const CompressedRecording& recording, Figure& figure);
// `other`: deviations for comparison, as open circles.
Figure allan_figure(const AllanResult& allan, const AllanResult* other = nullptr);

// The residual of one dwell after a rotation, in the axes of the sensors: the velocity (n frame, m/s) that free navigation from the beginning
// of the last rotation shows although the unit is at rest. Each such dwell gives three numbers:
//   v(t) = v0 + a t + j t (t - T) / 2, t from the start of the dwell, least squares over T, at most 120 s
//   accelerometer residual  C_bn a                   excess reading of the accelerometers (and g times the tilt error)
//   tilt residual           C_bn (a_E, 0, -a_N) / g  attitude error that the rotation left; horizontal axes only
//   gyro residual           C_bn (j_E, 0, -j_N) / g  excess reading of the gyros; horizontal axes only
// from v' = -f x psi, f = (0, g, 0), psi' = C_nb dw_b (calib/joint/joint_filter.h). C_nb is the commanded heading, levelled by the specific
// force: good to the table's errors. Not modelled: which sensor is to blame; the scores decide that.
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

  void add_turn(const Block& block, const SensorModel& model);
};

std::vector<DwellResidual> dwell_residuals(const Diagnosis& diagnosis, const CompressedRecording& recording);

// rms of the residual velocity over the first velocity_seconds of every dwell, as on held-out data (holdout.h). NaN: none.
double velocity_rms_mps(const Diagnosis& diagnosis, bool after);

// Draws the residual before and after an effect was added, against the quantity that it depends on: a panel for each of its strongest components.
Figure effect_figure(const Diagnosis& diagnosis, const std::vector<DwellResidual>& dwells, const std::string& effect,
                     std::size_t number);
// Draw a residual that no effect explains, against table angles, specific force, rate, temperature and time: once as an accelerometer
// error, once as a gyro error.
std::vector<Figure> unexplained_figures(const std::vector<DwellResidual>& dwells);

// Returns, for each effect that the recording can show, the component with the largest |z|; the strongest effect first.
std::vector<const CandidateScore*> strongest_candidates(const Diagnosis& diagnosis);
// Returns the |z| that chance alone exceeds in a fraction false_alarm of recordings, over all visible candidates.
double family_threshold_z(const Diagnosis& diagnosis, double false_alarm);

}  // namespace turncal
