#include "orchestrator/devices/first_step_check.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "calib/model/attitude.h"
#include "calib/statistics/unit_slip.h"
#include "imu_io/base/format_number.h"

namespace turncal {

namespace {

constexpr double stretch_s = 0.5;
constexpr double least_stretches = 4.0;  // of a rest that tells its noise

}  // namespace

Status FirstStepCheck::resume(const RecordingInfo& info, std::int64_t end_sample,
                              std::optional<std::uint32_t> written) {
  info_ = info;
  spikes_.emplace(info);
  life_.emplace(info);
  turned_to_deg_.reset();
  return sink_.resume(info, end_sample, written);
}

Status FirstStepCheck::start(const RecordingInfo& info) {
  info_ = info;
  spikes_.emplace(info);
  life_.emplace(info);
  turned_to_deg_.reset();
  active_ = true;
  step_.reset();
  before_deg_.reset();
  rest_gyro_.reset();
  earth_.emplace(info.latitude_deg);
  return sink_.start(info);
}

Status FirstStepCheck::begin_segment(const Segment& segment) {
  if (step_ && segment.step != *step_) active_ = false;
  step_ = segment.step;
  segment_ = segment;
  gyro_.setZero();
  accel_.setZero();
  samples_ = 0;
  stretch_.setZero();
  stretch_samples_ = 0;
  way_ = 0.0;
  stretches_ = 0.0;
  stretch_squares_.setZero();
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
  // Of whole ones: the last may be shorter.
  if (static_cast<double>(stretch_samples_) * info_.sample_period_s >= stretch_s) {
    ++stretches_;
    stretch_squares_ += (stretch_ / static_cast<double>(stretch_samples_)).cwiseAbs2();
  }
  if (rest_gyro_) way_ += (stretch_ - *rest_gyro_ * static_cast<double>(stretch_samples_)).norm();
  stretch_.setZero();
  stretch_samples_ = 0;
}

Status FirstStepCheck::end_segment(SegmentKind kind, std::int64_t end_sample, const AxisTriple& angles_deg) {
  TRY(sink_.end_segment(kind, end_sample, angles_deg));
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
  const bool large =
      turn && std::abs(turn->second) >= limits_.least_turn_of_units_deg && way_ <= limits_.detour * sum.norm();
  const double ratio = large ? scale * sum.norm() / (std::abs(turn->second) * rad_per_deg) : 1.0;
  TRY(judge_units(ratio));
  const bool moved = turn && scale * way_ > 0.5 * std::abs(turn->second) * rad_per_deg;
  if (moved && way_ > limits_.detour * sum.norm()) return {};
  TRY(judge_felt(scale * sum / rad_per_deg, *before_deg_, angles_deg, limits_));
  return judge_pulses(ratio);
}

// Pulses have a weight of their own, which is estimated, from near its nominal value on.
Status FirstStepCheck::judge_pulses(double ratio) const {
  const bool fits = ratio >= limits_.least_pulses && ratio <= limits_.most_pulses;
  if (info_.gyro_increment != IncrementKind::pulses || fits) return {};
  const double nominal = start_parameters(info_).n(0, 0);
  return device_error(fmt::format(
      "the gyros feel {:.4g} times what is expected: by this turn a pulse weighs {:.4g} arcsec: expected {:.2g} to "
      "{:.2g} (gyro.unit, .type and .offset of the frame)",
      ratio, nominal / ratio, nominal / limits_.most_pulses, nominal / limits_.least_pulses));
}

Status FirstStepCheck::judge_units(double ratio) const {
  const UnitSlip* const slip = slip_near(gyro_slips(), ratio);
  if (info_.gyro_increment == IncrementKind::pulses || slip == nullptr) return {};
  return device_error(
      fmt::format("the gyros feel {:.4g} times what is expected: they look {} (gyro.unit, gyro.scale of the frame)",
                  ratio, slip->words));
}

Status FirstStepCheck::judge_rest(const SensorModel& model, const AxisTriple& angles_deg, double samples) {
  if (2 * impossible_temperatures_ > samples_) {
    return device_error("the unit's temperature reads " + format_number(temperature_c_) + " C: expected " +
                        format_number(least_temperature_c) + " to " + format_number(most_temperature_c) +
                        " (temperature.type, .zero, .scale of the frame)");
  }
  rest_gyro_ = gyro_ / samples;
  const Eigen::Vector3d force = model.accel_scale * accel_ / (samples * info_.sample_period_s);
  TRY(judge_force(force, angles_deg, info_.gravity_mps2, limits_));
  const Eigen::Vector3d rate = model.gyro_scale * *rest_gyro_ / info_.sample_period_s;
  // Of the earth's rate alone no more is said of units than what a bias can hardly imitate.
  const double times = rate.norm() / earth_rate_radps;
  if (times > limits_.least_times) TRY(judge_units(times));
  if (stretches_ < least_stretches) return {};
  const Eigen::Vector3d variance = stretch_squares_ / stretches_ - rest_gyro_->cwiseAbs2();
  const double sigma = model.gyro_scale.norm() / std::sqrt(3.0) / info_.sample_period_s *
                       std::sqrt(std::max(variance.maxCoeff(), 0.0) / stretches_);
  const std::string wrong = earth_->add_rest(rate, sigma, attitude_of(angles_deg), force);
  return wrong.empty() ? Status{} : Status(device_error(wrong));
}

}  // namespace turncal
