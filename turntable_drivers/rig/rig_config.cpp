#include "turntable_drivers/rig/rig_config.h"

#include <algorithm>
#include <cmath>

#include "imu_io/base/format_number.h"

namespace turncal {
namespace {

Status bad(const std::string& key, double value, const std::string& expected) {
  return input_error("rig: " + key + " = " + format_number(value) + ": expected " + expected);
}

Status positive_value(const std::string& key, double value) {
  return value > 0.0 && std::isfinite(value) ? Status() : bad(key, value, "a number > 0");
}

Status not_negative_value(const std::string& key, double value) {
  return value >= 0.0 && std::isfinite(value) ? Status() : bad(key, value, "a number >= 0");
}

double determinant(const std::array<double, 9>& m) {
  return m[0] * (m[4] * m[8] - m[5] * m[7]) - m[1] * (m[3] * m[8] - m[5] * m[6]) + m[2] * (m[3] * m[7] - m[4] * m[6]);
}

Status check_truth(const RigConfig& config) {
  for (std::size_t first : {std::size_t{6}, std::size_t{15}}) {
    const double nominal = first == 6 ? config.gyro_pulse_arcsec : 1.0;
    std::array<double, 9> m;
    for (std::size_t i = 0; i < 9; ++i) {
      m[i] = config.truth[first + i].value_or(i % 4 == 0 ? nominal : 0.0) / nominal;
    }
    if (!(std::abs(determinant(m)) > 0.1)) {
      return input_error(std::string("rig: truth.") + (first == 6 ? "n" : "a") +
                         ": the matrix is singular or nearly so: expected a diagonal near its nominal value");
    }
  }
  return {};
}

Status check_fault(const RigFault& fault, std::size_t number) {
  const std::string prefix = "fault." + std::to_string(number) + ".";
  if (fault.axis < 0 || fault.axis > 2) return bad(prefix + "axis", fault.axis, "0, 1 or 2");
  if (fault.sample < 0) return bad(prefix + "sample", static_cast<double>(fault.sample), "a whole number >= 0");
  if (fault.count < 1) return bad(prefix + "count", static_cast<double>(fault.count), "a whole number >= 1");
  if (Status status = not_negative_value(prefix + "time_s", fault.time_s); !status) return status;
  if (Status status = not_negative_value(prefix + "duration_s", fault.duration_s); !status) return status;
  if (fault.kind == RigFaultKind::imu_silent && !(fault.duration_s > 0.0)) {
    return bad(prefix + "duration_s", fault.duration_s, "a number > 0 for imu_silent");
  }
  if (!std::isfinite(fault.size)) return bad(prefix + "size", fault.size, "a finite number");
  return positive_value(prefix + "rate_degps", fault.rate_degps);
}

}  // namespace

const std::array<const char*, 24> rig_truth_keys = {"N01", "N02", "N03", "A01", "A02", "A03", "n11", "n12",
                                                    "n13", "n21", "n22", "n23", "n31", "n32", "n33", "a11",
                                                    "a12", "a13", "a21", "a22", "a23", "a31", "a32", "a33"};

RigConfig default_rig_config() { return {}; }

RigConfig rig_of_unit(const RigConfig& config, std::size_t unit) {
  RigConfig own = config;
  std::erase_if(own.faults, [unit](const RigFault& fault) {
    return concerns_unit(fault.kind) && fault.unit != static_cast<int>(unit) + 1;
  });
  if (unit == 0) return own;
  const std::uint64_t apart = static_cast<std::uint64_t>(unit) * 0xA0761D6478BD642FULL;  // odd: no two units the same
  own.unit_seed = config.unit_seed.value_or(config.seed) ^ apart;
  own.noise_seed = config.noise_seed.value_or(config.seed) ^ apart;
  own.unit_serial.clear();
  return own;
}

RigConfig perfect_rig_config() {
  RigConfig config;
  config.random_truth = false;
  config.quantisation = RigQuantisation::off;
  config.noise = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0, config.noise.flicker_longest_s};
  config.table_errors.random_arcmin = 0.0;
  return config;
}

Status check(const RigConfig& config) {
  const std::initializer_list<std::pair<const char*, double>> positives = {
      {"sample_period_s", config.sample_period_s},
      {"gyro_pulse_arcsec", config.gyro_pulse_arcsec},
      {"accel_pulse_mps", config.accel_pulse_mps},
      {"site.gravity_mps2", config.site.gravity_mps2},
      {"noise.flicker_longest_s", config.noise.flicker_longest_s},
      {"temperature.tau_s", config.temperature.tau_s},
      {"table_error.creep_tau_s", config.table_errors.creep_tau_s},
      {"table.home_rate_degps", config.table.home_rate_degps},
      {"table.home_acceleration_degps2", config.table.home_acceleration_degps2},
      {"effect.gyro_warm_up.tau_s", config.effects.gyro_warm_up_tau_s},
      {"effect.post_rotation_relaxation.tau_s", config.effects.post_rotation_relaxation_tau_s},
      {"outside.accel_time_periodic.period_s", config.outside.accel_time_periodic.period_s}};
  for (const auto& [key, value] : positives) {
    if (Status status = positive_value(key, value); !status) return status;
  }
  const std::initializer_list<std::pair<const char*, double>> not_negatives = {
      {"noise.gyro_random_walk_deg_per_rt_h", config.noise.gyro_random_walk_deg_per_rt_h},
      {"noise.accel_random_walk_ug_per_rt_hz", config.noise.accel_random_walk_ug_per_rt_hz},
      {"noise.gyro_bias_instability_degph", config.noise.gyro_bias_instability_degph},
      {"noise.accel_bias_instability_ug", config.noise.accel_bias_instability_ug},
      {"noise.gyro_rate_random_walk_degph_per_rt_h", config.noise.gyro_rate_random_walk_degph_per_rt_h},
      {"noise.accel_acceleration_random_walk_ug_per_rt_h", config.noise.accel_acceleration_random_walk_ug_per_rt_h},
      {"table_error.random_arcmin", config.table_errors.random_arcmin},
      {"table.home_time_s", config.table.home_time_s},
      {"table.encoder_resolution_deg", config.table.encoder_resolution_deg},
      {"table.in_position_tolerance_deg", config.table.in_position_tolerance_deg},
      {"table.in_position_time_s", config.table.in_position_time_s}};
  for (const auto& [key, value] : not_negatives) {
    if (Status status = not_negative_value(key, value); !status) return status;
  }
  if (!(std::abs(config.site.latitude_deg) <= 90.0)) {
    return bad("site.latitude_deg", config.site.latitude_deg, "a number between -90 and 90");
  }
  if (config.quadrature_substeps < 1) {
    return bad("quadrature_substeps", config.quadrature_substeps, "a whole number >= 1");
  }
  for (Axis axis : all_axes) {
    const std::size_t i = static_cast<std::size_t>(axis);
    const std::string name = to_string(axis);
    if (!(config.table.limit_min_deg[i] < config.table.limit_max_deg[i])) {
      return bad("table." + name + ".limit_min_deg", config.table.limit_min_deg[i],
                 "a number below limit_max_deg = " + format_number(config.table.limit_max_deg[i]));
    }
    if (Status status = positive_value("table." + name + ".max_rate_degps", config.table.max_rate_degps[i]); !status) {
      return status;
    }
    if (Status status =
            positive_value("table." + name + ".max_acceleration_degps2", config.table.max_acceleration_degps2[i]);
        !status) {
      return status;
    }
  }
  const RigOutsideEffects& outside = config.outside;
  for (int axis : {outside.gyro_bias_step.axis, outside.accel_bias_step.axis, outside.gyro_angle_periodic.axis,
                   outside.accel_time_periodic.axis, outside.accel_hysteresis.axis}) {
    if (axis < 0 || axis > 2) return bad("outside: axis", axis, "0, 1 or 2");
  }
  if (outside.gyro_angle_periodic.order < 0 || outside.gyro_angle_periodic.order > 1000) {
    return bad("outside.gyro_angle_periodic.order", outside.gyro_angle_periodic.order,
               "a whole number between 0 and 1000");
  }
  for (std::size_t i = 0; i < config.faults.size(); ++i) {
    if (Status status = check_fault(config.faults[i], i + 1); !status) return status;
  }
  return check_truth(config);
}

}  // namespace turncal
