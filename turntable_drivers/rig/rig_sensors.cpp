#include "turntable_drivers/rig/rig_sensors.h"

#include <algorithm>
#include <cmath>

#include <Eigen/LU>

namespace turncal::rig_model {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

Matrix3d matrix(const Nine& nine) { return Eigen::Map<const RowMajor3>(nine.data()); }

template <class Array>
bool any(const Array& values) {
  return std::ranges::any_of(values, [](double value) { return value != 0.0; });
}

}  // namespace

SensorEffects::SensorEffects(const RigConfig& config)
    : effects_(config.effects),
      outside_(config.outside),
      reference_c_(config.temperature.reference_c.value_or(config.temperature.start_c)),
      cross_(matrix(effects_.accel_cross_coupling) * mps2_per_ug),
      arms_m_(matrix(effects_.accel_size_effect) * 1e-3),
      g_sensitivity_(matrix(effects_.gyro_g_sensitivity) * radps_per_degph),
      magnetic_(matrix(effects_.gyro_magnetic) * radps_per_degph),
      flexure_(matrix(effects_.gyro_accel_flexure) * (pi / 180.0 / 3600.0)),
      delay_s_(effects_.accel_delay * 1e-3) {
  const RigEffects& e = effects_;
  has_standing_accel_ = any(e.accel_second_order) || any(e.accel_scale_asymmetry) || any(e.accel_odd_quadratic) ||
                        any(e.accel_third_order) || any(e.accel_cross_coupling);
  has_motion_accel_ = any(e.accel_size_effect) || e.accel_delay != 0.0;
  has_standing_gyro_ = any(e.gyro_scale_asymmetry) || any(e.gyro_rate_nonlinearity);
  has_matrix_gyro_ = any(e.gyro_g_sensitivity) || any(e.gyro_magnetic) || any(e.gyro_accel_flexure);
  has_running_ = any(e.accel_bias_temperature) || any(e.accel_scale_temperature) || any(e.accel_bias_drift) ||
                 any(e.gyro_bias_temperature) || any(e.gyro_scale_temperature) || any(e.gyro_bias_drift) ||
                 any(e.gyro_warm_up) || any(e.post_rotation_relaxation) || any(e.gyro_bias_temperature_rate) ||
                 any(e.accel_bias_temperature_rate) || outside_.gyro_bias_step.size != 0.0 ||
                 outside_.accel_bias_step.size != 0.0 || outside_.accel_time_periodic.size_ug != 0.0;
}

Reading SensorEffects::standing(const BodyMotion& motion, const std::array<TrueAxis, 3>& axes,
                                double hysteresis_state) const {
  const RigEffects& e = effects_;
  const Vector3d& w = motion.rate_ib_b;
  const Vector3d f_g = motion.force_b / standard_gravity_mps2;
  Reading reading{w + motion.earth_error_b, motion.force_b};
  if (has_standing_accel_) {
    for (int i = 0; i < 3; ++i) {
      const std::size_t k = std::size_t(i);
      const double f = f_g[i], size = std::abs(f);
      reading.accel[i] += mps2_per_ug * (e.accel_second_order[k] * f * f + e.accel_scale_asymmetry[k] * size +
                                         e.accel_odd_quadratic[k] * f * size + e.accel_third_order[k] * f * f * f);
    }
    reading.accel += cross_ * Vector3d(f_g[0] * f_g[1], f_g[0] * f_g[2], f_g[1] * f_g[2]);
  }
  if (has_motion_accel_) {
    for (int i = 0; i < 3; ++i) {
      const Vector3d arm = arms_m_.row(i).transpose();
      reading.accel[i] += (motion.acceleration_b.cross(arm) + w.cross(w.cross(arm)))[i];
    }
    reading.accel += delay_s_ * w.cross(motion.force_b);
  }
  if (has_standing_gyro_) {
    for (int i = 0; i < 3; ++i) {
      const std::size_t k = std::size_t(i);
      constexpr double reference_rate_radps = 10.0 * pi / 180.0;
      reading.gyro[i] += 1e-6 * std::abs(w[i]) *
                         (e.gyro_scale_asymmetry[k] + e.gyro_rate_nonlinearity[k] * w[i] / reference_rate_radps);
    }
  }
  if (has_matrix_gyro_) reading.gyro += g_sensitivity_ * f_g + magnetic_ * motion.field_b + (flexure_ * f_g).cross(w);
  const auto& periodic = outside_.gyro_angle_periodic;
  if (periodic.size_degph != 0.0) {
    // Computes sin(order * angle + phase) by angle addition, since only the sine and cosine of the axis are known.
    SinCos sum = sin_cos_deg(periodic.phase_deg);
    const SinCos& angle = axes[std::size_t(periodic.table_axis)].angle;
    for (int i = 0; i < periodic.order; ++i)
      sum = {sum.sin * angle.cos + sum.cos * angle.sin, sum.cos * angle.cos - sum.sin * angle.sin};
    reading.gyro[periodic.axis] += radps_per_degph * periodic.size_degph * sum.sin;
  }
  reading.accel[outside_.accel_hysteresis.axis] += mps2_per_ug * outside_.accel_hysteresis.size_ug * hysteresis_state;
  return reading;
}

void SensorEffects::add_running(const BodyMotion& motion, const RigMoment& moment, Reading& reading) const {
  const RigEffects& e = effects_;
  const double warmer_c = moment.temperature_c - reference_c_;
  const double time_h = moment.time_s / 3600.0;
  const double warm_up = any(e.gyro_warm_up) ? exp_of(-moment.time_s / e.gyro_warm_up_tau_s) : 0.0;
  const double relaxation = any(e.post_rotation_relaxation) && moment.since_motion_s >= 0.0
                                ? exp_of(-moment.since_motion_s / e.post_rotation_relaxation_tau_s)
                                : 0.0;
  for (int i = 0; i < 3; ++i) {
    const std::size_t k = std::size_t(i);
    reading.accel[i] += mps2_per_ug * (e.accel_bias_temperature[k] * warmer_c + e.accel_bias_drift[k] * time_h +
                                       e.accel_bias_temperature_rate[k] * moment.c_per_h) +
                        1e-6 * motion.force_b[i] *
                            (e.accel_scale_temperature[k] * warmer_c + e.post_rotation_relaxation[k] * relaxation);
    reading.gyro[i] +=
        radps_per_degph * (e.gyro_bias_temperature[k] * warmer_c + e.gyro_bias_drift[k] * time_h +
                           e.gyro_warm_up[k] * warm_up + e.gyro_bias_temperature_rate[k] * moment.c_per_h) +
        1e-6 * motion.rate_ib_b[i] * e.gyro_scale_temperature[k] * warmer_c;
  }
  const auto& gyro_step = outside_.gyro_bias_step;
  if (moment.time_s >= gyro_step.time_s) reading.gyro[gyro_step.axis] += radps_per_degph * gyro_step.size;
  const auto& accel_step = outside_.accel_bias_step;
  if (moment.time_s >= accel_step.time_s) reading.accel[accel_step.axis] += mps2_per_ug * accel_step.size;
  const auto& periodic = outside_.accel_time_periodic;
  if (periodic.size_ug != 0.0) {
    const double angle_deg = 360.0 * (moment.time_s / periodic.period_s) + periodic.phase_deg;
    reading.accel[periodic.axis] += mps2_per_ug * periodic.size_ug * sin_cos_deg(angle_deg).sin;
  }
}

double SensorEffects::next_hysteresis_state(const BodyMotion& motion, double state) const {
  const double f_g = motion.force_b[outside_.accel_hysteresis.axis] / standard_gravity_mps2;
  return f_g > 0.5 ? 1.0 : f_g < -0.5 ? -1.0 : state;
}

PulseCounter::PulseCounter(const Matrix3d& scale, const Vector3d& bias, double period_s, RigQuantisation quantisation)
    : inverse_(scale.inverse()), offset_(inverse_ * bias * period_s), quantisation_(quantisation) {}

std::array<double, 3> PulseCounter::count(const std::array<double, 3>& increment) {
  std::array<double, 3> pulses;
  for (std::size_t i = 0; i < 3; ++i) {
    const auto row = inverse_.row(Eigen::Index(i));
    const double real =
        row[0] * increment[0] + row[1] * increment[1] + row[2] * increment[2] + offset_[Eigen::Index(i)];
    if (quantisation_ == RigQuantisation::off) {
      pulses[i] = real;
    } else {
      rest_[i] += real;
      pulses[i] = floor_of(quantisation_ == RigQuantisation::floor ? rest_[i] : rest_[i] + 0.5);
      rest_[i] -= pulses[i];
    }
  }
  return pulses;
}

// ---- noise ----

TriadNoise::TriadNoise(const NoiseSize& size, double period_s, std::uint64_t seed, std::uint64_t triad)
    : period_s_(period_s),
      white_sigma_(size.white * std::sqrt(period_s)),
      drifts_(size.flicker > 0.0 || size.rate_walk > 0.0),
      white_(seed, 3 * triad + 1),
      flicker_(seed, 3 * triad + 2),
      walk_stream_(seed, 3 * triad + 3) {
  constexpr double ratio = 4.0;
  std::vector<double> constants_s;
  for (double tau_s = size.flicker_longest_s; tau_s > 0.125; tau_s /= ratio) constants_s.push_back(tau_s);
  if (size.flicker > 0.0 && !constants_s.empty()) {
    grid_ = std::max<std::int64_t>(1, std::int64_t(constants_s.back() / 16.0 / period_s));
    const double sigma = size.flicker * std::sqrt(log_of(ratio) / pi);
    std::int64_t every = grid_;
    for (std::size_t i = constants_s.size(); i-- > 0;) {  // from the fastest
      Markov process;
      process.every = every;
      process.decay = exp_of(-double(every) * period_s / constants_s[i]);
      process.kick = sigma * std::sqrt(1.0 - process.decay * process.decay);
      for (double& value : process.value) value = sigma * flicker_.normal();
      processes_.push_back(process);
      every *= std::int64_t(ratio);
    }
  } else {
    grid_ = std::max<std::int64_t>(1, std::int64_t(0.1 / period_s));
  }
  walk_every_ = grid_ * std::max<std::int64_t>(1, std::int64_t(0.1 / (double(grid_) * period_s)));
  walk_kick_ = size.rate_walk * std::sqrt(double(walk_every_) * period_s);
}

void TriadNoise::update_bias() {
  bias_ = {0.0, 0.0, 0.0};
  for (Markov& process : processes_) {
    // Processes start in their stationary state, so sample 0 needs no step.
    if (sample_ > 0 && sample_ % process.every == 0)
      for (double& value : process.value) value = process.decay * value + process.kick * flicker_.normal();
    for (std::size_t i = 0; i < 3; ++i) bias_[i] += process.value[i];
  }
  if (walk_kick_ > 0.0) {
    if (sample_ > 0 && sample_ % walk_every_ == 0)
      for (double& value : walk_) value += walk_kick_ * walk_stream_.normal();
    for (std::size_t i = 0; i < 3; ++i) bias_[i] += walk_[i];
  }
}

void TriadNoise::add(std::array<double, 3>& increment) {
  if (drifts_) {
    if (until_update_ == 0) {
      update_bias();
      until_update_ = grid_;
    }
    --until_update_;
    ++sample_;
    for (std::size_t i = 0; i < 3; ++i) increment[i] += bias_[i] * period_s_;
  }
  if (white_sigma_ > 0.0)
    for (double& value : increment) value += white_sigma_ * white_.normal();
}

}  // namespace turncal::rig_model
