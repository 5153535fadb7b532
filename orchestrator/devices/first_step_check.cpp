#include "orchestrator/devices/first_step_check.h"

#include <fmt/format.h>
#include <Eigen/Geometry>
#include <Eigen/LU>

#include <algorithm>
#include <cmath>

#include "calib/model/attitude.h"
#include "calib/statistics/unit_slip.h"
#include "calib/types/value_text.h"
#include "imu_io/base/text.h"

namespace turncal {

namespace {

constexpr double stretch_s = 0.5;
constexpr double least_stretches = 4.0;  // in a rest, to determine its noise

// C_nb
Eigen::Matrix3d attitude_of(const AxisTriple& angles_deg) {
  return attitude_from_angles(angles_deg[Axis::heading] * rad_per_deg, angles_deg[Axis::pitch] * rad_per_deg,
                              angles_deg[Axis::roll] * rad_per_deg);
}

std::string angles_text(const AxisTriple& deg) {
  return fmt::format("heading {}, pitch {}, roll {} deg", format_number(deg[Axis::heading]),
                     format_number(deg[Axis::pitch]), format_number(deg[Axis::roll]));
}

std::string triple_text(const Eigen::Vector3d& v) {
  // Shows a component that is negligible beside the largest as 0, not as its rounding error.
  const double least = 1e-5 * v.cwiseAbs().maxCoeff();
  const auto shown = [least](double x) { return std::abs(x) < least ? 0.0 : x; };
  return fmt::format("{:+.4g}, {:+.4g}, {:+.4g}", shown(v.x()), shown(v.y()), shown(v.z()));
}

// Returns axis and angle of a turn; nothing when more than one axis differs.
std::optional<std::pair<Axis, double>> turn_between(const AxisTriple& from_deg, const AxisTriple& to_deg) {
  std::optional<std::pair<Axis, double>> turn;
  for (const Axis axis : all_axes) {
    if (to_deg[axis] == from_deg[axis]) continue;
    if (turn) return {};
    turn = {axis, to_deg[axis] - from_deg[axis]};
  }
  return turn;
}

// Judges the gyros' sum over a turn between angles that differ in one axis: degrees, by nominal scale factors.
Status judge_felt(const Eigen::Vector3d& sum_deg, const AxisTriple& from_deg, const AxisTriple& to_deg,
                  const DirectionLimits& limits) {
  const auto turn = turn_between(from_deg, to_deg);
  if (!turn || std::abs(turn->second) < limits.smallest_turn_deg) return {};
  const Eigen::Vector3d expected = body_axis_of(turn->first, from_deg) * turn->second;
  if (points_along(sum_deg, expected, limits.direction_deg)) return {};
  const std::string turned =
      fmt::format("the turn of {} by {} deg ", to_string(turn->first), format_number(turn->second));
  if (sum_deg.norm() == 0.0) return device_error(turned + "was not sensed by any gyro");
  if (sum_deg.norm() < 0.5 * std::abs(turn->second))
    return device_error(
        fmt::format("{}was hardly sensed ({} deg about x, y, z): expected {}: a dead gyro, or a unit that "
                    "does not ride on the table",
                    turned, triple_text(sum_deg), triple_text(expected)));
  return device_error(
      fmt::format("{}was sensed about {} ({}): expected about {}: mounted another way, signs of the table's "
                  "axis, or axes and signs of the unit's frame",
                  turned, nearest_axis(sum_deg), triple_text(sum_deg), nearest_axis(expected)));
}

}  // namespace

Eigen::Vector3d body_axis_of(Axis axis, const AxisTriple& at_deg) {
  switch (axis) {
    case Axis::heading: return -attitude_of(at_deg).transpose() * Eigen::Vector3d::UnitY();
    case Axis::pitch:
      return Eigen::AngleAxisd(-at_deg[Axis::roll] * rad_per_deg, Eigen::Vector3d::UnitX()) * Eigen::Vector3d::UnitZ();
    case Axis::roll: break;
  }
  return Eigen::Vector3d::UnitX();
}

bool points_along(const Eigen::Vector3d& v, const Eigen::Vector3d& direction, double within_deg) {
  return v.norm() > 0.0 && v.dot(direction) >= v.norm() * direction.norm() * std::cos(within_deg * rad_per_deg);
}

std::string nearest_axis(const Eigen::Vector3d& v) {
  Eigen::Index axis = 0;
  v.cwiseAbs().maxCoeff(&axis);
  return std::string(v[axis] < 0.0 ? "-" : "+") + "xyz"[axis];
}

Status judge_force(const Eigen::Vector3d& force_mps2, const AxisTriple& angles_deg, double gravity_mps2,
                   const DirectionLimits& limits) {
  const Eigen::Vector3d up = attitude_of(angles_deg).transpose() * Eigen::Vector3d::UnitY();
  const bool size_fits = std::abs(force_mps2.norm() - gravity_mps2) <= limits.force_tolerance * gravity_mps2;
  const bool points_up = points_along(force_mps2, up, limits.direction_deg);
  if (size_fits && points_up) return {};
  const std::string sensed =
      fmt::format("at {} the accelerometers sense {} m/s^2 along x, y, z: expected {}", angles_text(angles_deg),
                  triple_text(force_mps2), triple_text(gravity_mps2 * up));
  const UnitSlip* const slip = slip_near(accel_slips(), force_mps2.norm() / gravity_mps2);
  if (points_up && slip != nullptr)
    return device_error(
        fmt::format("{}; the accelerometers look {} (accel.unit, accel.scale of the frame)", sensed, slip->words));
  Eigen::Index most = 0;
  up.cwiseAbs().maxCoeff(&most);
  if (!size_fits && std::abs(force_mps2[most]) < 0.1 * gravity_mps2 && std::abs(up[most]) > 0.5)
    return device_error(sensed + "; accelerometer " + "xyz"[most] + " does not respond to gravity");
  if (!points_up && nearest_axis(force_mps2) != nearest_axis(up))
    return device_error(
        fmt::format("{}; the unit's {} is up instead of its {}: mounted another way, or axes and signs "
                    "of its frame (accel.axes)",
                    sensed, nearest_axis(force_mps2), nearest_axis(up)));
  if (size_fits)
    return device_error(fmt::format(
        "{}; up is {} deg away from there: zero of the table's pitch and roll, or the fixture", sensed,
        format_number(std::round(std::atan2(force_mps2.cross(up).norm(), force_mps2.dot(up)) / rad_per_deg))));
  return device_error(sensed +
                      "; scale of the accelerometers (accel.pulse_mps, accel.scale of the frame) or a dead one");
}

std::string EarthRateCheck::add_rest(const Eigen::Vector3d& rate_radps, double sigma_radps, const Eigen::Matrix3d& C_nb,
                                     const Eigen::Vector3d& up) {
  if (contradictory_) return {};
  if (rests_ == 0) {
    const double strange = strange_bias * std::abs(rate_radps.norm() - earth_rate_radps);
    const double bias = std::max(least_bias_degph * radps_per_degph, strange);
    P_.topLeftCorner<3, 3>().diagonal().setConstant(bias * bias);
    P_.bottomRightCorner<3, 3>().diagonal().setConstant(100.0 * earth_rate_radps * earth_rate_radps);
  }
  const Eigen::Matrix3d C_bn = level(C_nb, up).transpose();
  Eigen::Matrix<double, 3, 6> H;
  H << Eigen::Matrix3d::Identity(), C_bn;
  const double noise = std::hypot(sigma_radps, misalignment_rad * rate_radps.norm());
  const Eigen::Matrix3d S = H * P_ * H.transpose() + Eigen::Matrix3d::Identity() * (noise * noise);
  const Eigen::Matrix3d S_inverse = S.inverse();
  const Eigen::Vector3d innovation = rate_radps - H * x_;
  if (rests_ > 0 && innovation.dot(S_inverse * innovation) > contradiction) {
    contradictory_ = true;
    return {};
  }
  const Eigen::Matrix<double, 6, 3> K = P_ * H.transpose() * S_inverse;
  x_ += K * innovation;
  P_ = (P_ - K * H * P_).eval();
  P_ = (0.5 * (P_ + P_.transpose())).eval();
  ++rests_;

  const Eigen::Vector3d earth = x_.tail<3>();
  const double size = earth.norm();
  if (size < smallest * earth_rate_radps || size > largest * earth_rate_radps) return {};
  const double sine = earth.y() / size;
  const Eigen::Vector3d slope = (Eigen::Vector3d::UnitY() - sine * earth / size) / size;
  const double sigma = std::sqrt(slope.dot(P_.bottomRightCorner<3, 3>() * slope));
  if (std::abs(sine - std::sin(latitude_deg_ * rad_per_deg)) <= std::max(sigmas * sigma, least_difference)) return {};
  const double latitude_deg = std::asin(sine) / rad_per_deg;
  // Sigma of the latitude; near a pole the sine determines it poorly.
  const double sigma_deg = sigma / std::max(std::sqrt(1.0 - sine * sine), std::sqrt(sigma)) / rad_per_deg;
  return fmt::format(
      "at rest the gyros measure a vertical Earth rate of {:+.2f} deg/h, expected {:.2f}: that of a latitude of {} "
      "deg: "
      "site.latitude_deg is {:.10g} (north is positive), or axes and signs of the gyros",
      earth.y() / radps_per_degph, size / radps_per_degph, plus_minus(latitude_deg, sigma_deg), latitude_deg_);
}

void FirstStepCheck::begin(const RecordingInfo& info) {
  info_ = info;
  spikes_.emplace(info);
  life_.emplace(info);
  turned_to_deg_.reset();
}

Status FirstStepCheck::resume(const RecordingInfo& info, std::int64_t, std::optional<std::uint32_t>) {
  begin(info);
  return {};
}

Status FirstStepCheck::start(const RecordingInfo& info) {
  begin(info);
  active_ = true;
  step_.reset();
  before_deg_.reset();
  rest_gyro_.reset();
  earth_.emplace(info.latitude_deg);
  return {};
}

Status FirstStepCheck::begin_segment(const Segment& segment) {
  if (step_ && segment.step != *step_) active_ = false;
  step_ = segment.step;
  sums_ = {.start_sample = segment.start_sample};
  return {};
}

Status FirstStepCheck::add(std::span<const ImuSample> samples) {
  for (const ImuSample& sample : samples) {
    life_->add(sample);
    if (!active_ || spikes_->spike_in(sample)) continue;
    const Eigen::Vector3d gyro = Eigen::Vector3d::Map(sample.gyro.data());
    sums_.gyro += gyro;
    sums_.accel += Eigen::Vector3d::Map(sample.accel.data());
    ++sums_.samples;
    sums_.stretch += gyro;
    ++sums_.stretch_samples;
    if (double(sums_.stretch_samples) * info_.sample_period_s >= stretch_s) end_stretch();
    if (temperature_can_be(sample.temperature_c)) continue;
    ++sums_.impossible_temperatures;
    sums_.temperature_c = sample.temperature_c;
  }
  return {};
}

void FirstStepCheck::end_stretch() {
  // Counts whole stretches only; the last may be shorter.
  if (double(sums_.stretch_samples) * info_.sample_period_s >= stretch_s) {
    ++sums_.stretches;
    sums_.stretch_squares += (sums_.stretch / double(sums_.stretch_samples)).cwiseAbs2();
  }
  if (rest_gyro_) sums_.way += (sums_.stretch - *rest_gyro_ * double(sums_.stretch_samples)).norm();
  sums_.stretch.setZero();
  sums_.stretch_samples = 0;
}

Status FirstStepCheck::end_segment(SegmentKind kind, std::int64_t end_sample, const AxisTriple& angles_deg) {
  if (!found_) return {};
  found_ = judge_life(angles_deg);
  if (found_ && active_) found_ = judge_segment(kind, end_sample, angles_deg);
  before_deg_ = angles_deg;
  return {};
}

Status FirstStepCheck::judge_life(const AxisTriple& angles_deg) {
  double turned_deg = 0.0;
  for (const Axis axis : all_axes)
    if (turned_to_deg_) turned_deg += std::abs(angles_deg[axis] - (*turned_to_deg_)[axis]);
  turned_to_deg_ = angles_deg;
  life_->turned(turned_deg);
  return life_->defect().empty() ? Status{} : Status(device_error(life_->defect()));
}

Status FirstStepCheck::judge_segment(SegmentKind kind, std::int64_t end_sample, const AxisTriple& angles_deg) {
  if (sums_.samples == 0) return {};
  const auto n = double(sums_.samples);
  const SensorModel model = sensor_model(start_parameters(info_), info_);
  if (kind != SegmentKind::rotate) return judge_rest(model, angles_deg, n);
  if (!before_deg_ || !rest_gyro_ || sums_.samples != end_sample - sums_.start_sample) return {};
  end_stretch();
  const Eigen::Vector3d sum = sums_.gyro - *rest_gyro_ * n;
  const auto turn = turn_between(*before_deg_, angles_deg);
  const double scale = model.gyro_scale.norm() / std::sqrt(3.0);
  // Judged before the direction: with wrong units of measure a gyro's path may look like a detour.
  const bool large = turn && std::abs(turn->second) >= least_turn_of_units_deg && sums_.way <= detour * sum.norm();
  const double ratio = large ? scale * sum.norm() / (std::abs(turn->second) * rad_per_deg) : 1.0;
  TRY(judge_units(ratio));
  const bool moved = turn && scale * sums_.way > 0.5 * std::abs(turn->second) * rad_per_deg;
  if (moved && sums_.way > detour * sum.norm()) return {};
  TRY(judge_felt(scale * sum / rad_per_deg, *before_deg_, angles_deg, limits));
  return judge_pulses(ratio);
}

// Judges the weight of the pulses, which is estimated starting from its nominal value.
Status FirstStepCheck::judge_pulses(double ratio) const {
  if (info_.gyro_increment != IncrementKind::pulses || (ratio >= least_pulses && ratio <= most_pulses)) return {};
  const double nominal = start_parameters(info_).n(0, 0);
  return device_error(fmt::format(
      "the gyros feel {:.4g} times what is expected: by this turn a pulse weighs {:.4g} arcsec: expected {:.2g} to "
      "{:.2g} (gyro.unit, .type and .offset of the frame)",
      ratio, nominal / ratio, nominal / most_pulses, nominal / least_pulses));
}

Status FirstStepCheck::judge_units(double ratio) const {
  const UnitSlip* const slip = slip_near(gyro_slips(), ratio);
  if (info_.gyro_increment == IncrementKind::pulses || slip == nullptr) return {};
  return device_error(
      fmt::format("the gyros feel {:.4g} times what is expected: they look {} (gyro.unit, gyro.scale of the frame)",
                  ratio, slip->words));
}

Status FirstStepCheck::judge_rest(const SensorModel& model, const AxisTriple& angles_deg, double samples) {
  if (2 * sums_.impossible_temperatures > sums_.samples)
    return device_error(fmt::format(
        "the unit's temperature reads {} C: expected {} to {} (temperature.type, .zero, .scale of the frame)",
        format_number(sums_.temperature_c), format_number(least_temperature_c), format_number(most_temperature_c)));
  rest_gyro_ = sums_.gyro / samples;
  const Eigen::Vector3d force = model.accel_scale * sums_.accel / (samples * info_.sample_period_s);
  TRY(judge_force(force, angles_deg, info_.gravity_mps2, limits));
  const Eigen::Vector3d rate = model.gyro_scale * *rest_gyro_ / info_.sample_period_s;
  // From the Earth rate alone units are judged only where a bias can hardly imitate the error.
  const double times = rate.norm() / earth_rate_radps;
  if (times > least_times) TRY(judge_units(times));
  if (sums_.stretches < least_stretches) return {};
  const Eigen::Vector3d variance = sums_.stretch_squares / sums_.stretches - rest_gyro_->cwiseAbs2();
  const double sigma = model.gyro_scale.norm() / std::sqrt(3.0) / info_.sample_period_s *
                       std::sqrt(std::max(variance.maxCoeff(), 0.0) / sums_.stretches);
  const std::string wrong = earth_->add_rest(rate, sigma, attitude_of(angles_deg), force);
  return wrong.empty() ? Status{} : Status(device_error(wrong));
}

}  // namespace turncal
