#include "turntable_drivers/rig/rig_state.h"

namespace turncal::rig_model {

using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

constexpr double arcsec = pi / 180.0 / 3600.0;

// Gauss-Legendre on (0, 1), exact for polynomials to degree 5. At 100 deg/s a sample turns half a degree, and the error
// of a sample is below 1e-19 of its increment.
constexpr std::array<double, 3> node = {0.11270166537925831148, 0.5, 0.88729833462074168852};
constexpr std::array<double, 3> weight = {5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0};

SiteVectors site_vectors(const RigConfig& config) {
  const SinCos latitude = sin_cos_deg(config.site.latitude_deg);
  SiteVectors site;
  site.earth_rate = config.site.earth_rate_radps * Vector3d(latitude.cos, latitude.sin, 0.0);
  site.specific_force = Vector3d(0.0, config.site.gravity_mps2, 0.0);
  const Triple& field = config.site.magnetic_field_gauss;
  const Nine& magnetic = config.effects.gyro_magnetic;
  const bool senses_field = std::any_of(magnetic.begin(), magnetic.end(), [](double m) { return m != 0.0; });
  site.field = senses_field ? Vector3d(field[0], field[1], field[2]) : Vector3d(0.0, 0.0, 0.0);
  site.earth_error = radps_per_degph * Vector3d(config.effects.earth_rate[0], config.effects.earth_rate[1], 0.0);
  return site;
}

Matrix3d matrix_at(const std::array<double, 24>& truth, std::size_t first) {
  Matrix3d m;
  for (std::size_t i = 0; i < 9; ++i) m(static_cast<int>(i / 3), static_cast<int>(i % 3)) = truth[first + i];
  return m;
}

bool is_table_event(RigFaultKind kind) {
  return kind == RigFaultKind::table_moved || kind == RigFaultKind::stuck_axis || kind == RigFaultKind::axis_fault ||
         kind == RigFaultKind::emergency_stop || kind == RigFaultKind::imu_unplugged;
}

NoiseSize gyro_noise(const RigNoise& noise) {
  return {noise.gyro_random_walk_deg_per_rt_h * (pi / 180.0) / 60.0,
          noise.gyro_bias_instability_degph * radps_per_degph, noise.flicker_longest_s,
          noise.gyro_rate_random_walk_degph_per_rt_h * radps_per_degph / 60.0};
}

NoiseSize accel_noise(const RigNoise& noise) {
  return {noise.accel_random_walk_ug_per_rt_hz * mps2_per_ug, noise.accel_bias_instability_ug * mps2_per_ug,
          noise.flicker_longest_s, noise.accel_acceleration_random_walk_ug_per_rt_h * mps2_per_ug / 60.0};
}

}  // namespace

RigState::RigState(const RigConfig& given)
    : config(given),
      period_s(given.sample_period_s),
      truth(draw_truth(given)),
      errors(draw_table_errors(given)),
      geometry(errors.geometry_angles(), site_vectors(given)),
      sensor_effects(given),
      gyro_counter(matrix_at(truth, 6) * arcsec, Vector3d(truth[0], truth[1], truth[2]) * radps_per_degph, period_s,
                   given.quantisation),
      accel_counter(matrix_at(truth, 15) * given.accel_pulse_mps,
                    Vector3d(truth[3], truth[4], truth[5]) * standard_gravity_mps2, period_s, given.quantisation),
      gyro_noise_source(gyro_noise(given.noise), period_s, given.noise_seed.value_or(given.seed), 0),
      accel_noise_source(accel_noise(given.noise), period_s, given.noise_seed.value_or(given.seed), 1) {
  for (std::size_t i = 0; i < 3; ++i) {
    const double power_on_deg = config.table.power_on_deg[i];
    axes[i] = RigAxis(power_on_deg, errors.encoder[i], config.table_errors.creep_arcsec[i] / 3600.0,
                      config.table_errors.creep_tau_s, period_s);
    commands[i].target_deg = power_on_deg;
  }
  for (const RigFault& fault : config.faults) {
    if (is_table_event(fault.kind)) {
      events.push_back({static_cast<std::int64_t>(std::ceil(fault.time_s / period_s - 1e-9)), fault});
    } else if (fault.kind == RigFaultKind::imu_silent) {
      RigFault silence = fault;
      silence.kind = RigFaultKind::lost_sample;
      silence.sample = static_cast<std::int64_t>(std::ceil(fault.time_s / period_s - 1e-9));
      silence.count = static_cast<std::int64_t>(std::ceil(fault.duration_s / period_s - 1e-9));
      silence.hidden = false;
      unit_faults.push_back(silence);
    } else if (concerns_unit(fault.kind)) {
      unit_faults.push_back(fault);
    }
  }
  std::stable_sort(events.begin(), events.end(), [](const Event& a, const Event& b) { return a.sample < b.sample; });
}

void RigState::apply_event(const RigFault& fault) {
  const std::size_t i = static_cast<std::size_t>(fault.axis);
  switch (fault.kind) {
    case RigFaultKind::table_moved: axes[i].slip(k, fault.size, fault.rate_degps, fault.hidden); break;
    case RigFaultKind::stuck_axis:
      commands[i].stuck = true;
      axes[i].halt(k);
      break;
    case RigFaultKind::axis_fault:
      commands[i].fault = true;
      axes[i].brake(k, commands[i].acceleration_degps2);
      break;
    case RigFaultKind::emergency_stop:
      emergency_stop = true;
      released = false;
      release_by_itself_s =
          fault.duration_s > 0.0 ? fault.time_s + fault.duration_s : std::numeric_limits<double>::infinity();
      for (RigAxis& axis : axes) axis.halt(k);
      break;
    case RigFaultKind::imu_unplugged: unplugged = true; break;
    default: break;
  }
  standing_is_known = false;
}

void RigState::apply_events() {
  while (next_event < events.size() && events[next_event].sample <= k) apply_event(events[next_event++].fault);
}

void RigState::integrate_standing(std::array<double, 3>& gyro, std::array<double, 3>& accel) {
  if (!standing_is_known) {
    const std::array<TrueAxis, 3> now = true_axes(0.0);
    standing_motion = geometry.at(now);
    hysteresis_state = sensor_effects.next_hysteresis_state(standing_motion, hysteresis_state);
    standing_reading = sensor_effects.standing(standing_motion, now, hysteresis_state);
    standing_is_known = true;
  }
  Reading reading = standing_reading;
  if (sensor_effects.has_running()) sensor_effects.add_running(standing_motion, moment_at(0.5 * period_s), reading);
  for (std::size_t i = 0; i < 3; ++i) {
    gyro[i] = reading.gyro[static_cast<int>(i)] * period_s;
    accel[i] = reading.accel[static_cast<int>(i)] * period_s;
  }
}

void RigState::integrate_motion(std::array<double, 3>& gyro, std::array<double, 3>& accel) {
  standing_is_known = false;
  std::array<double, 3 * RigAxis::max_corners + 2> corners;
  corners[0] = 0.0;
  std::size_t count = 1;
  for (const RigAxis& axis : axes) count += axis.corners(k, std::span(corners).subspan(count, RigAxis::max_corners));
  corners[count++] = period_s;
  if (count > 2) std::sort(corners.begin() + 1, corners.begin() + static_cast<std::ptrdiff_t>(count - 1));

  Vector3d gyro_sum = Vector3d::Zero(), accel_sum = Vector3d::Zero();
  BodyMotion motion;
  const int substeps = config.quadrature_substeps;
  for (std::size_t piece = 0; piece + 1 < count; ++piece) {
    const double length_s = (corners[piece + 1] - corners[piece]) / substeps;
    if (!(length_s > 0.0)) continue;
    for (int sub = 0; sub < substeps; ++sub) {
      const double start_s = corners[piece] + sub * length_s;
      for (std::size_t i = 0; i < node.size(); ++i) {
        const double offset_s = start_s + node[i] * length_s;
        const std::array<TrueAxis, 3> now = true_axes(offset_s);
        motion = geometry.at(now);
        Reading reading = sensor_effects.standing(motion, now, hysteresis_state);
        if (sensor_effects.has_running()) sensor_effects.add_running(motion, moment_at(offset_s), reading);
        gyro_sum += (weight[i] * length_s) * reading.gyro;
        accel_sum += (weight[i] * length_s) * reading.accel;
      }
    }
  }
  if (sensor_effects.has_hysteresis()) {
    hysteresis_state = sensor_effects.next_hysteresis_state(motion, hysteresis_state);
  }
  for (std::size_t i = 0; i < 3; ++i) {
    gyro[i] = gyro_sum[static_cast<int>(i)];
    accel[i] = accel_sum[static_cast<int>(i)];
  }
}

bool RigState::step(ImuSample& sample) {
  apply_events();
  std::array<double, 3> gyro, accel;
  if (standing_is_known || all_standing()) {
    integrate_standing(gyro, accel);
  } else {
    integrate_motion(gyro, accel);
  }
  gyro_noise_source.add(gyro);
  accel_noise_source.add(accel);

  bool lost = false, lost_in_hiding = false;
  const RigFault* repeat = nullptr;
  sample.flags = 0;
  for (const RigFault& fault : unit_faults) {
    if (k < fault.sample || k >= fault.sample + fault.count) continue;
    const std::size_t i = static_cast<std::size_t>(fault.axis);
    switch (fault.kind) {
      case RigFaultKind::lost_sample:
        lost = true;
        lost_in_hiding = lost_in_hiding || fault.hidden;
        break;
      case RigFaultKind::duplicated_sample: repeat = &fault; break;
      case RigFaultKind::gyro_glitch: gyro[i] += 1e-3 * fault.size; break;
      case RigFaultKind::velocity_knock: accel[i] += fault.size; break;
      case RigFaultKind::invalid_sample: sample.flags |= sample_flag_invalid; break;
      default: break;
    }
  }
  sample.gyro = gyro_counter.count(gyro);
  sample.accel = accel_counter.count(accel);
  const double temperature_c = temperature_at(time_s() + 0.5 * period_s);
  sample.temperature_c = static_cast<float>(floor_of(temperature_c * 1000.0 + 0.5) / 1000.0);
  sample.counter = config.first_counter + k + counter_shift;
  ++k;
  if (lost) {
    if (lost_in_hiding) --counter_shift;
    return false;
  }
  if (repeat != nullptr) {
    duplicate = sample;
    if (repeat->hidden) {
      ++counter_shift;
      ++duplicate->counter;
    }
  }
  return true;
}

}  // namespace turncal::rig_model
