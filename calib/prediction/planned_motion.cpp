#include "calib/prediction/planned_motion.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <limits>
#include <span>

#include <Eigen/LU>

#include "calib/model/attitude.h"

namespace turncal {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// A vector fixed in n, seen from the body while it turns by theta about u: Exp(-theta u) v.
struct TurningVector {
  Vector3d along, across, third;
  TurningVector(const Vector3d& v_b, const Vector3d& u)
      : along(u * u.dot(v_b)), across(v_b - along), third(u.cross(v_b)) {}
  Vector3d at(double cosine, double sine) const { return along + across * cosine - third * sine; }
};

class Unit {
 public:
  Unit(const RecordingInfo& info, const Parameters& parameters, const std::optional<TemperatureProfile>& temperature)
      : model_(sensor_model(parameters, info)),
        gyro_counts_(model_.gyro_scale.inverse()),
        accel_counts_(model_.accel_scale.inverse()),
        period_s_(info.sample_period_s),
        temperature_(temperature),
        compressor_(info, undisturbed()) {}

  void begin(const Segment& segment) { compressor_.begin_segment(segment); }
  void end(const Segment& segment) {
    flush();
    compressor_.end_segment(segment.kind, segment.end_sample);
  }
  CompressedRecording take() { return compressor_.take(); }

  // Adds one sample over which the unit turned by dtheta_b and gained dv_b.
  void feel(const Vector3d& dtheta_b, const Vector3d& dv_b) {
    if (filled_ == chunk_.size()) flush();
    chunk_[filled_] = sense(dtheta_b, dv_b);
    stamp(chunk_[filled_++]);
  }
  // Adds many equal samples.
  void rest(const Vector3d& dtheta_b, const Vector3d& dv_b, std::int64_t samples) {
    flush();
    chunk_.fill(sense(dtheta_b, dv_b));
    while (samples > 0) {
      filled_ = std::size_t(std::min<std::int64_t>(samples, std::int64_t(chunk_.size())));
      for (ImuSample& sample : std::span(chunk_).first(filled_)) stamp(sample);
      samples -= std::int64_t(filled_);
      flush();
    }
  }

 private:
  // No sample of an ideal unit stands out, however hard the table accelerates.
  static CompressionOptions undisturbed() {
    CompressionOptions options;
    options.glitch.counts_min = std::numeric_limits<double>::infinity();
    return options;
  }
  ImuSample sense(const Vector3d& dtheta_b, const Vector3d& dv_b) const {
    ImuSample sample;
    Vector3d::Map(sample.gyro.data()) = gyro_counts_ * (dtheta_b + model_.gyro_bias_radps * period_s_);
    Vector3d::Map(sample.accel.data()) = accel_counts_ * (dv_b + model_.accel_bias_mps2 * period_s_);
    return sample;
  }
  void stamp(ImuSample& sample) {
    sample.counter = counter_++;
    if (!temperature_) return;
    const double t = double(sample.counter) * period_s_;
    sample.temperature_c =
        float(temperature_->start_c + temperature_->rise_c * (1.0 - std::exp(-t / temperature_->tau_s)));
  }
  void flush() {
    compressor_.add(std::span(chunk_).first(filled_));
    filled_ = 0;
  }

  const SensorModel model_;
  const Matrix3d gyro_counts_, accel_counts_;
  const double period_s_;
  const std::optional<TemperatureProfile> temperature_;
  Compressor compressor_;
  std::array<ImuSample, 256> chunk_{};
  std::size_t filled_ = 0;
  std::int64_t counter_ = 0;
};

}  // namespace

double trapezoid_duration_s(double angle_deg, double rate_degps, double acceleration_degps2) {
  const double angle = std::abs(angle_deg);
  if (angle < rate_degps * rate_degps / acceleration_degps2) return 2.0 * std::sqrt(angle / acceleration_degps2);
  return angle / rate_degps + rate_degps / acceleration_degps2;
}

double trapezoid_angle_deg(double angle_deg, double rate_degps, double acceleration_degps2, double t_s) {
  const double duration = trapezoid_duration_s(angle_deg, rate_degps, acceleration_degps2);
  if (t_s <= 0.0) return 0.0;
  if (t_s >= duration) return angle_deg;
  // The second half mirrors the first.
  const double t = std::min(t_s, duration - t_s);
  const double ramp = std::min(rate_degps / acceleration_degps2, 0.5 * duration);
  const double gone = t < ramp ? 0.5 * acceleration_degps2 * t * t : acceleration_degps2 * ramp * (t - 0.5 * ramp);
  return std::copysign(t_s <= 0.5 * duration ? gone : std::abs(angle_deg) - gone, angle_deg);
}

CompressedRecording planned_recording(const RecordingInfo& info_given, const PlannedMotion& motion,
                                      const Parameters& parameters,
                                      const std::optional<TemperatureProfile>& temperature) {
  RecordingInfo info = info_given;
  info.has_temperature = temperature.has_value();
  Unit unit(info, parameters, temperature);
  const double dt = info.sample_period_s;
  const Vector3d gravity_n(0.0, info.gravity_mps2, 0.0);
  const Vector3d earth_n = earth_rate_n(info.latitude_deg);
  AxisTriple at_deg = motion.start_deg;
  std::int64_t start = 0;
  for (const PlannedMotionItem& item : motion.items) {
    const bool move = item.kind == PlannedMotionItem::Kind::move;
    const Matrix3d C_nb = attitude_at(at_deg);
    const double angle_deg = move ? item.to_deg - item.from_deg : 0.0;
    std::int64_t moving = 0;
    if (move) {
      assert(item.from_deg == at_deg[item.axis] && item.rate_degps > 0.0 && item.acceleration_degps2 > 0.0);
      const double duration = trapezoid_duration_s(angle_deg, item.rate_degps, item.acceleration_degps2);
      moving = std::min(item.samples, std::int64_t(std::ceil(duration / dt)));
    }
    const Vector3d u = move ? axis_b(item.axis, at_deg) : Vector3d::UnitX();
    if (move) at_deg[item.axis] = item.to_deg;
    Segment segment{item.step,
                    move ? SegmentKind::rotate : item.dwell_kind,
                    start,
                    start + item.samples,
                    at_deg[Axis::heading],
                    at_deg[Axis::pitch],
                    at_deg[Axis::roll]};
    start = segment.end_sample;
    unit.begin(segment);

    const TurningVector force(C_nb.transpose() * gravity_n, u);
    const TurningVector earth(C_nb.transpose() * earth_n, u);
    const auto theta = [&](double t) {
      return trapezoid_angle_deg(angle_deg, item.rate_degps, item.acceleration_degps2, t) * rad_per_deg;
    };
    const double gauss = 0.5 / std::sqrt(3.0);
    double before = 0.0;
    for (std::int64_t k = 0; k < moving; ++k) {
      const double middle = (double(k) + 0.5) * dt;
      const double first = theta(middle - gauss * dt);
      const double second = theta(middle + gauss * dt);
      const double after = theta(middle + 0.5 * dt);
      const double cosine = 0.5 * (std::cos(first) + std::cos(second));
      const double sine = 0.5 * (std::sin(first) + std::sin(second));
      unit.feel(u * (after - before) + earth.at(cosine, sine) * dt, force.at(cosine, sine) * dt);
      before = after;
    }
    const Matrix3d C_end = attitude_at(at_deg);
    unit.rest(C_end.transpose() * earth_n * dt, C_end.transpose() * gravity_n * dt, item.samples - moving);
    unit.end(segment);
  }
  return unit.take();
}

}  // namespace turncal
