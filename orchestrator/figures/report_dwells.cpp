#include "orchestrator/figures/diagnosis_figures.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "calib/evidence/holdout.h"
#include "calib/model/attitude.h"
#include "calib/statistics/linear_algebra.h"

namespace turncal {

namespace {

using Eigen::Vector3d;
constexpr std::size_t fewest_seconds = 8;

double within_180(double angle_deg) { return std::remainder(angle_deg, 360.0); }

// The motion between the rest that ends before block `end` and that block.
void add_motion(const CompressedRecording& recording, const SensorModel& model, std::size_t end, DwellResidual& dwell) {
  for (std::size_t k = std::min(end, recording.blocks.size()); k-- > 0;) {
    const Block& block = recording.blocks[k];
    if (recording.segments[static_cast<std::size_t>(block.segment)].kind != SegmentKind::rotate) {
      if (block.whole_second) return;
      continue;
    }
    dwell.add_turn(block, model);
  }
}

DwellResidual::Side fit_side(const std::vector<ResidualPoint>& points, std::size_t first, std::size_t last, bool after,
                             const Eigen::Matrix3d& C_nb, double gravity_mps2) {
  const auto rows = static_cast<Eigen::Index>(last - first);
  Eigen::MatrixX3d shape(rows, 3);
  Eigen::MatrixX3d v(rows, 3);
  const double start_s = points[first].time_s;
  const double middle_s = 0.5 * (points[last - 1].time_s - start_s);
  for (Eigen::Index i = 0; i < rows; ++i) {
    const ResidualPoint& p = points[first + static_cast<std::size_t>(i)];
    const double t = p.time_s - start_s;
    shape.row(i) << 1.0, t, 0.5 * t * (t - 2.0 * middle_s);  // the slope is that of the middle
    v.row(i) = (after ? p.velocity_after_mps : p.velocity_before_mps).transpose();
  }
  Eigen::Matrix3d fit;
  for (int k = 0; k < 3; ++k) fit.col(k) = least_squares(shape, v.col(k)).x;
  const Vector3d a = fit.row(1).transpose();
  const Vector3d j = fit.row(2).transpose();
  DwellResidual::Side side;
  side.velocity_mps = fit.row(0).transpose();
  side.accel_mps2 = C_nb.transpose() * a;
  side.tilt_rad = C_nb.transpose() * Vector3d(a.z(), 0.0, -a.x()) / gravity_mps2;
  side.gyro_radps = C_nb.transpose() * Vector3d(j.z(), 0.0, -j.x()) / gravity_mps2;
  return side;
}

}  // namespace

void DwellResidual::add_turn(const Block& block, const SensorModel& model) {
  const Vector3d turn = model.gyro_scale * block.gyro - model.gyro_bias_radps * block.duration_s;
  turned_rad += turn;
  const Vector3d rate = turn / block.duration_s;
  for (int axis = 0; axis < 3; ++axis)
    if (std::abs(rate[axis]) > std::abs(fastest_radps[axis])) fastest_radps[axis] = rate[axis];
}

std::vector<std::pair<std::size_t, std::size_t>> rests(const std::vector<ResidualPoint>& points) {
  std::vector<std::pair<std::size_t, std::size_t>> result;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const bool begins =
        i == 0 || points[i].since_rotation_s <= points[i - 1].since_rotation_s ||
        points[i].time_s - points[i - 1].time_s > 1.5 * (points[i].since_rotation_s - points[i - 1].since_rotation_s);
    if (begins) result.emplace_back(i, i);
    result.back().second = i + 1;
  }
  return result;
}

std::vector<DwellResidual> dwell_residuals(const Diagnosis& diagnosis, const CompressedRecording& recording) {
  const std::vector<ResidualPoint>& points = diagnosis.residuals;
  const SensorModel model = sensor_model(diagnosis.base.parameters, recording.info);
  std::vector<DwellResidual> result;
  for (auto [first, last] : rests(points)) {
    if (before_any_rotation(points[first])) continue;
    while (last > first && points[last - 1].time_s - points[first].time_s > fit_window_s) --last;
    if (last - first < fewest_seconds) continue;
    const ResidualPoint& p = points[first];
    if (p.segment < 0 || static_cast<std::size_t>(p.segment) >= recording.segments.size()) continue;
    const Segment& segment = recording.segments[static_cast<std::size_t>(p.segment)];
    DwellResidual d;
    d.segment = p.segment;
    d.step = segment.step;
    d.time_s = 0.5 * (p.time_s + points[last - 1].time_s);
    d.table_deg = {within_180(segment.heading_deg), within_180(segment.pitch_deg), within_180(segment.roll_deg)};
    Vector3d f = Vector3d::Zero();
    double temperature = 0.0;
    for (std::size_t i = first; i < last; ++i) {
      f += points[i].f_b_mps2;
      temperature += points[i].temperature_c;
    }
    f /= static_cast<double>(last - first);
    d.f_b_g = f / standard_gravity_mps2;
    d.temperature_c = recording.info.has_temperature ? temperature / static_cast<double>(last - first) : no_point;
    const Eigen::Matrix3d C_nb =
        level(attitude_from_angles(segment.heading_deg * rad_per_deg, segment.pitch_deg * rad_per_deg,
                                   segment.roll_deg * rad_per_deg),
              f);
    d.level_share = (Vector3d::Ones() - C_nb.row(1).transpose().cwiseAbs2()).cwiseMax(0.0).cwiseSqrt();
    d.before = fit_side(points, first, last, false, C_nb, recording.info.gravity_mps2);
    d.after = fit_side(points, first, last, true, C_nb, recording.info.gravity_mps2);
    add_motion(recording, model, p.block, d);
    result.push_back(d);
  }
  return result;
}

double velocity_rms_mps(const Diagnosis& diagnosis, bool after) {
  double sum = 0.0;
  double count = 0.0;
  for (const auto& [first, last] : rests(diagnosis.residuals))
    for (std::size_t i = first; i < std::min(last, first + velocity_seconds); ++i) {
      const ResidualPoint& p = diagnosis.residuals[i];
      sum += (after ? p.velocity_after_mps : p.velocity_before_mps).squaredNorm();
      count += 1.0;
    }
  return count > 0.0 ? std::sqrt(sum / count) : no_point;
}

}  // namespace turncal
