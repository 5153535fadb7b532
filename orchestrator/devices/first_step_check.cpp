#include "orchestrator/devices/first_step_check.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

#include "calib/model/attitude.h"
#include "calib/statistics/unit_slip.h"
#include "imu_io/base/format_number.h"

namespace turncal {

namespace {

constexpr double stretch_s = 0.5;

Eigen::Matrix3d attitude_of(const AxisTriple& deg) {
  return attitude_from_angles(deg[Axis::heading] * rad_per_deg, deg[Axis::pitch] * rad_per_deg,
                              deg[Axis::roll] * rad_per_deg);
}

bool points_along(const Eigen::Vector3d& v, const Eigen::Vector3d& direction, double within_deg) {
  return v.norm() > 0.0 && v.dot(direction) >= v.norm() * direction.norm() * std::cos(within_deg * rad_per_deg);
}

// "-z": the axis that a direction is nearest to.
std::string nearest_axis(const Eigen::Vector3d& v) {
  Eigen::Index axis = 0;
  v.cwiseAbs().maxCoeff(&axis);
  return std::string(v[axis] < 0.0 ? "-" : "+") + "xyz"[axis];
}

std::string angles_text(const AxisTriple& deg) {
  return "heading " + format_number(deg[Axis::heading]) + ", pitch " + format_number(deg[Axis::pitch]) + ", roll " +
         format_number(deg[Axis::roll]) + " deg";
}

std::string triple_text(const Eigen::Vector3d& v) {
  char text[80];
  std::snprintf(text, sizeof text, "%+.4g, %+.4g, %+.4g", v.x(), v.y(), v.z());
  return text;
}

// Axis and angle of a turn; nothing when more than one axis differs.
std::optional<std::pair<Axis, double>> turn_between(const AxisTriple& from, const AxisTriple& to) {
  std::optional<std::pair<Axis, double>> turn;
  for (const Axis axis : all_axes) {
    if (to[axis] == from[axis]) continue;
    if (turn) return {};
    turn = {axis, to[axis] - from[axis]};
  }
  return turn;
}

// Of the body, for a turn by + about an axis of the table (planned_motion.h).
Eigen::Vector3d body_axis_of(Axis axis, const AxisTriple& at_deg) {
  switch (axis) {
    case Axis::heading: return -attitude_of(at_deg).transpose() * Eigen::Vector3d::UnitY();
    case Axis::pitch:
      return Eigen::AngleAxisd(-at_deg[Axis::roll] * rad_per_deg, Eigen::Vector3d::UnitX()) * Eigen::Vector3d::UnitZ();
    case Axis::roll: break;
  }
  return Eigen::Vector3d::UnitX();
}

}  // namespace

Status judge_force(const Eigen::Vector3d& force_mps2, const AxisTriple& angles_deg, double gravity_mps2,
                   const FirstStepLimits& limits) {
  const Eigen::Vector3d up = attitude_of(angles_deg).transpose() * Eigen::Vector3d::UnitY();
  const bool size_fits = std::abs(force_mps2.norm() - gravity_mps2) <= limits.force_tolerance * gravity_mps2;
  const bool points_up = points_along(force_mps2, up, limits.direction_deg);
  if (size_fits && points_up) return {};
  const std::string sensed = "at " + angles_text(angles_deg) + " the accelerometers sense " + triple_text(force_mps2) +
                             " m/s^2 along x, y, z: expected " + triple_text(gravity_mps2 * up);
  const UnitSlip* const slip = slip_near(accel_slips(), force_mps2.norm() / gravity_mps2);
  if (points_up && slip != nullptr) {
    return device_error(sensed + "; the accelerometers look " + slip->words +
                        " (accel.unit, accel.scale of the frame)");
  }
  Eigen::Index most = 0;
  up.cwiseAbs().maxCoeff(&most);
  if (!size_fits && std::abs(force_mps2[most]) < 0.1 * gravity_mps2 && std::abs(up[most]) > 0.5) {
    return device_error(sensed + "; accelerometer " + "xyz"[most] + " does not answer to gravity");
  }
  if (!points_up) {
    return device_error(sensed + "; the unit's " + nearest_axis(force_mps2) + " is up instead of its " +
                        nearest_axis(up) + ": mounted another way, or axes and signs of its frame (accel.axes)");
  }
  return device_error(sensed +
                      "; scale of the accelerometers (accel.pulse_mps, accel.scale of the frame) or a dead one");
}

Status judge_felt(const Eigen::Vector3d& sum, const AxisTriple& from_deg, const AxisTriple& to_deg,
                  const FirstStepLimits& limits) {
  const auto turn = turn_between(from_deg, to_deg);
  if (!turn || std::abs(turn->second) < limits.smallest_turn_deg) return {};
  const Eigen::Vector3d expected = body_axis_of(turn->first, from_deg) * turn->second;
  if (points_along(sum, expected, limits.direction_deg)) return {};
  const std::string turned =
      std::string("the turn of ") + to_string(turn->first) + " by " + format_number(turn->second) + " deg ";
  if (sum.norm() == 0.0) return device_error(turned + "was not felt by any gyro");
  return device_error(turned + "was felt about " + nearest_axis(sum) + " (" + triple_text(sum) + "): expected about " +
                      nearest_axis(expected) +
                      ": mounted another way, signs of the table's axis, or axes and signs of the unit's frame");
}

Status FirstStepCheck::resume(const RecordingInfo& info, std::int64_t end_sample) {
  info_ = info;
  spikes_.emplace(info);
  life_.emplace(info.sample_period_s);
  turned_to_deg_.reset();
  return sink_.resume(info, end_sample);
}

Status FirstStepCheck::start(const RecordingInfo& info) {
  info_ = info;
  spikes_.emplace(info);
  life_.emplace(info.sample_period_s);
  turned_to_deg_.reset();
  active_ = true;
  step_.reset();
  before_deg_.reset();
  rest_gyro_.reset();
  rests_ = rests_other_way_ = 0;
  return sink_.start(info);
}

Status FirstStepCheck::begin_segment(const Segment& segment) {
  if (active_ && step_ && segment.step != *step_) {
    active_ = false;
    if (Status status = judge_step(); !status) return status;
  }
  step_ = segment.step;
  segment_ = segment;
  gyro_.setZero();
  accel_.setZero();
  samples_ = 0;
  stretch_.setZero();
  stretch_samples_ = 0;
  way_ = 0.0;
  impossible_temperatures_ = 0;
  return sink_.begin_segment(segment);
}

Status FirstStepCheck::add(std::span<const ImuSample> samples) {
  for (const ImuSample& sample : samples) {
    life_->add(sample);
    if (!active_ || spikes_->spike_in(sample)) continue;
    const Eigen::Vector3d gyro(sample.gyro[0], sample.gyro[1], sample.gyro[2]);
    gyro_ += gyro;
    accel_ += Eigen::Vector3d(sample.accel[0], sample.accel[1], sample.accel[2]);
    ++samples_;
    stretch_ += gyro;
    ++stretch_samples_;
    if (static_cast<double>(stretch_samples_) * info_.sample_period_s >= stretch_s) end_stretch();
    if (temperature_can_be(sample.temperature_c)) continue;
    ++impossible_temperatures_;
    temperature_c_ = sample.temperature_c;
  }
  return sink_.add(samples);
}

void FirstStepCheck::end_stretch() {
  if (rest_gyro_) way_ += (stretch_ - *rest_gyro_ * static_cast<double>(stretch_samples_)).norm();
  stretch_.setZero();
  stretch_samples_ = 0;
}

Status FirstStepCheck::end_segment(SegmentKind kind, std::int64_t end_sample, const AxisTriple& angles_deg) {
  if (Status status = sink_.end_segment(kind, end_sample, angles_deg); !status) return status;
  if (Status status = judge_life(angles_deg); !status || !active_) return status;
  const Status judged = judge_segment(kind, end_sample, angles_deg);
  before_deg_ = angles_deg;
  return judged;
}

Status FirstStepCheck::judge_life(const AxisTriple& angles_deg) {
  double turned_deg = 0.0;
  for (const Axis axis : all_axes)
    if (turned_to_deg_) turned_deg += std::abs(angles_deg[axis] - (*turned_to_deg_)[axis]);
  turned_to_deg_ = angles_deg;
  life_->turned(turned_deg);
  return life_->defect().empty() ? Status{} : Status(device_error(life_->defect()));
}

Status FirstStepCheck::finish() {
  if (std::exchange(active_, false)) {  // there was no other step
    if (Status status = judge_step(); !status) return status;
  }
  return sink_.finish();
}

Status FirstStepCheck::judge_segment(SegmentKind kind, std::int64_t end_sample, const AxisTriple& angles_deg) {
  if (samples_ == 0) return {};
  const auto n = static_cast<double>(samples_);
  const SensorModel model = sensor_model(start_parameters(info_), info_);
  if (kind != SegmentKind::rotate) return judge_rest(model, angles_deg, n);
  const bool whole = samples_ == end_sample - segment_.start_sample;
  if (!before_deg_ || !rest_gyro_ || !whole) return {};
  end_stretch();
  const Eigen::Vector3d sum = gyro_ - *rest_gyro_ * n;
  const auto turn = turn_between(*before_deg_, angles_deg);
  const double scale = model.gyro_scale.norm() / std::sqrt(3.0);
  // Before the direction: what a gyro adds up to in the wrong unit may well be a detour.
  if (turn && std::abs(turn->second) >= limits_.least_turn_of_units_deg && way_ <= limits_.detour * sum.norm()) {
    if (Status status = judge_units(scale * sum.norm() / (std::abs(turn->second) * rad_per_deg)); !status)
      return status;
  }
  const bool moved = turn && scale * way_ > 0.5 * std::abs(turn->second) * rad_per_deg;
  if (moved && way_ > limits_.detour * sum.norm()) return {};
  return judge_felt(sum, *before_deg_, angles_deg, limits_);
}

// Pulses have a weight of their own, which is estimated.
Status FirstStepCheck::judge_units(double ratio) const {
  const UnitSlip* const slip = slip_near(gyro_slips(), ratio);
  if (info_.gyro_increment == IncrementKind::pulses || slip == nullptr) return {};
  char text[80];
  std::snprintf(text, sizeof text, "the gyros feel %.4g times what is expected: they look ", ratio);
  return device_error(text + std::string(slip->words) + " (gyro.unit, gyro.scale of the frame)");
}

Status FirstStepCheck::judge_rest(const SensorModel& model, const AxisTriple& angles_deg, double samples) {
  if (2 * impossible_temperatures_ > samples_) {
    return device_error("the unit's temperature reads " + format_number(temperature_c_) + " C: expected " +
                        format_number(least_temperature_c) + " to " + format_number(most_temperature_c) +
                        " (temperature.type, .zero, .scale of the frame)");
  }
  rest_gyro_ = gyro_ / samples;
  const Eigen::Vector3d force = model.accel_scale * accel_ / (samples * info_.sample_period_s);
  if (Status status = judge_force(force, angles_deg, info_.gravity_mps2, limits_); !status) return status;
  const double vertical = (model.gyro_scale * *rest_gyro_ / info_.sample_period_s).dot(force.normalized());
  const double expected = earth_rate_radps * std::sin(info_.latitude_deg * rad_per_deg);
  ++rests_;
  if (std::abs(expected) < limits_.least_vertical_degph * radps_per_degph) return {};
  if (std::abs(vertical / expected + 1.0) < limits_.other_way) ++rests_other_way_;
  // Of the earth's rate alone no more is said than what a bias can hardly imitate.
  return std::abs(vertical) > limits_.least_times * std::abs(expected) ? judge_units(vertical / expected) : Status{};
}

Status FirstStepCheck::judge_step() const {
  if (rests_ == 0 || rests_other_way_ != rests_) return {};
  return device_error(
      "in every rest of the first step the gyros feel the earth turn about the vertical the other way: "
      "site.latitude_deg is " +
      format_number(info_.latitude_deg) + " (north is positive), or the gyros' signs are wrong");
}

}  // namespace turncal
