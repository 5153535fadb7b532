// Every key of RigConfig once, with its range: read from a file, or checked in a configuration that was made otherwise.
// docs/rig.md is the list of keys; a test holds the two against each other.
#include <algorithm>
#include <cmath>

#include "imu_io/base/format_number.h"
#include "imu_io/base/key_table.h"
#include "imu_io/recordings/recording_check.h"
#include "turntable_drivers/rig/rig_config.h"

namespace turncal {
namespace {

// No quantity of the rig is larger in its unit: more is a slip, and what is computed of it means nothing.
constexpr double largest = 1e9;
constexpr NumberRange any_size{-largest, largest};
constexpr NumberRange above_zero{0.0, largest, true};
constexpr NumberRange zero_or_more{0.0, largest};
constexpr double last_utc_s = 253402300799.0;  // the end of the year 9999
constexpr std::int64_t most_counter = max_counter / 2;

const std::initializer_list<std::string_view> table_axes = {"heading", "pitch", "roll"};  // as Axis

void read_sensor_axis(KeyTable& keys, const std::string& key, int& axis) { keys.chosen(key, axis, {"x", "y", "z"}); }

void read_general(KeyTable& keys, RigConfig& config) {
  if (KeyValueFile* const file = keys.file()) {
    config.seed = static_cast<std::uint64_t>(file->integer_or("seed", static_cast<std::int64_t>(config.seed), 0));
    if (file->has("noise.seed")) config.noise_seed = static_cast<std::uint64_t>(file->integer("noise.seed", 0));
  }
  keys.text("unit_serial", config.unit_serial);
  keys.whole("first_counter", config.first_counter, -most_counter, most_counter);
  keys.flag("random_truth", config.random_truth);
  keys.number("start_utc_s", config.start_utc_s, between(0.0, last_utc_s));
  keys.number("sample_period_s", config.sample_period_s, between(1e-5, 1.0));
  keys.whole("quadrature_substeps", config.quadrature_substeps, 1, 1000);
  keys.number("gyro_pulse_arcsec", config.gyro_pulse_arcsec, above_zero);
  keys.number("accel_pulse_mps", config.accel_pulse_mps, above_zero);
  keys.chosen("quantisation", config.quantisation, {"floor", "round", "off"});
  for (std::size_t i = 0; i < config.truth.size(); ++i) {
    keys.number(std::string("truth.") + rig_truth_keys[i], config.truth[i]);
  }

  keys.number("site.latitude_deg", config.site.latitude_deg, between(-90.0, 90.0));
  keys.number("site.gravity_mps2", config.site.gravity_mps2, above_zero);
  keys.number("site.earth_rate_radps", config.site.earth_rate_radps);
  const char* const directions[] = {"north", "up", "east"};
  for (std::size_t i = 0; i < 3; ++i) {
    keys.number(std::string("site.magnetic_") + directions[i] + "_gauss", config.site.magnetic_field_gauss[i]);
  }
  RigNoise& noise = config.noise;
  keys.number("noise.gyro_random_walk_deg_per_rt_h", noise.gyro_random_walk_deg_per_rt_h, zero_or_more);
  keys.number("noise.accel_random_walk_ug_per_rt_hz", noise.accel_random_walk_ug_per_rt_hz, zero_or_more);
  keys.number("noise.gyro_bias_instability_degph", noise.gyro_bias_instability_degph, zero_or_more);
  keys.number("noise.accel_bias_instability_ug", noise.accel_bias_instability_ug, zero_or_more);
  keys.number("noise.gyro_rate_random_walk_degph_per_rt_h", noise.gyro_rate_random_walk_degph_per_rt_h, zero_or_more);
  keys.number("noise.accel_acceleration_random_walk_ug_per_rt_h", noise.accel_acceleration_random_walk_ug_per_rt_h,
              zero_or_more);
  keys.number("noise.flicker_longest_s", noise.flicker_longest_s, between(1.0, 1e9));

  keys.number("temperature.start_c", config.temperature.start_c);
  keys.number("temperature.rise_c", config.temperature.rise_c);
  keys.number("temperature.tau_s", config.temperature.tau_s, above_zero);
  keys.number("temperature.reference_c", config.temperature.reference_c);
}

void read_table_errors(KeyTable& keys, RigTableErrors& errors) {
  keys.number("table_error.random_arcmin", errors.random_arcmin, between(0.0, 600.0));
  keys.number("table_error.tilt_north_arcmin", errors.tilt_north_arcmin);
  keys.number("table_error.tilt_east_arcmin", errors.tilt_east_arcmin);
  keys.number("table_error.north_arcmin", errors.north_arcmin);
  keys.number("table_error.heading_pitch_arcmin", errors.heading_pitch_arcmin);
  keys.number("table_error.pitch_roll_arcmin", errors.pitch_roll_arcmin);
  const char* const body[] = {"x", "y", "z"};
  for (std::size_t i = 0; i < 3; ++i) {
    keys.number(std::string("table_error.mounting_") + body[i] + "_arcmin", errors.mounting_arcmin[i]);
  }
  for (Axis axis : all_axes) {
    const std::size_t i = index(axis);
    const std::string prefix = std::string("table_error.") + to_string(axis) + ".";
    keys.number(prefix + "encoder_offset_arcsec", errors.encoder[i].offset_arcsec);
    keys.number(prefix + "encoder_scale_ppm", errors.encoder[i].scale_ppm);
    keys.number(prefix + "encoder_harmonic_arcsec", errors.encoder[i].harmonic_arcsec);
    keys.number(prefix + "encoder_phase_deg", errors.encoder[i].phase_deg);
    keys.whole(prefix + "encoder_order", errors.encoder[i].order, 0, 10000);
    keys.number(prefix + "creep_arcsec", errors.creep_arcsec[i]);
  }
  keys.number("table_error.creep_tau_s", errors.creep_tau_s, above_zero);
}

void read_table(KeyTable& keys, RigTableBehaviour& table) {
  for (Axis axis : all_axes) {
    const std::size_t i = index(axis);
    const std::string prefix = std::string("table.") + to_string(axis) + ".";
    keys.number(prefix + "power_on_deg", table.power_on_deg[i]);
    keys.number(prefix + "limit_min_deg", table.limit_min_deg[i]);
    keys.number(prefix + "limit_max_deg", table.limit_max_deg[i]);
    keys.number(prefix + "max_rate_degps", table.max_rate_degps[i], above_zero);
    keys.number(prefix + "max_acceleration_degps2", table.max_acceleration_degps2[i], above_zero);
  }
  keys.flag("table.absolute_encoder", table.absolute_encoder);
  keys.number("table.home_rate_degps", table.home_rate_degps, above_zero);
  keys.number("table.home_acceleration_degps2", table.home_acceleration_degps2, above_zero);
  keys.number("table.home_time_s", table.home_time_s, zero_or_more);
  keys.number("table.encoder_resolution_deg", table.encoder_resolution_deg, zero_or_more);
  keys.number("table.in_position_tolerance_deg", table.in_position_tolerance_deg, zero_or_more);
  keys.number("table.in_position_time_s", table.in_position_time_s, zero_or_more);
  keys.chosen("table.in_position", table.in_position, {"honest", "servo_on", "after_stop", "stale", "late", "flicker"});
}

void read_effects(KeyTable& keys, RigEffects& effects) {
  for (const std::string& key : rig_effect_keys()) keys.number("effect." + key, *find_effect(effects, key));
  keys.number("effect.gyro_warm_up.tau_s", effects.gyro_warm_up_tau_s, above_zero);
  keys.number("effect.post_rotation_relaxation.tau_s", effects.post_rotation_relaxation_tau_s, above_zero);
}

void read_outside(KeyTable& keys, RigOutsideEffects& outside) {
  read_sensor_axis(keys, "outside.gyro_bias_step.axis", outside.gyro_bias_step.axis);
  keys.number("outside.gyro_bias_step.time_s", outside.gyro_bias_step.time_s);
  keys.number("outside.gyro_bias_step.size_degph", outside.gyro_bias_step.size);
  read_sensor_axis(keys, "outside.accel_bias_step.axis", outside.accel_bias_step.axis);
  keys.number("outside.accel_bias_step.time_s", outside.accel_bias_step.time_s);
  keys.number("outside.accel_bias_step.size_ug", outside.accel_bias_step.size);
  auto& angle = outside.gyro_angle_periodic;
  read_sensor_axis(keys, "outside.gyro_angle_periodic.axis", angle.axis);
  keys.chosen("outside.gyro_angle_periodic.table_axis", angle.table_axis, table_axes);
  keys.whole("outside.gyro_angle_periodic.order", angle.order, 0, 1000);
  keys.number("outside.gyro_angle_periodic.size_degph", angle.size_degph);
  keys.number("outside.gyro_angle_periodic.phase_deg", angle.phase_deg);
  auto& time = outside.accel_time_periodic;
  read_sensor_axis(keys, "outside.accel_time_periodic.axis", time.axis);
  keys.number("outside.accel_time_periodic.size_ug", time.size_ug);
  keys.number("outside.accel_time_periodic.period_s", time.period_s, above_zero);
  keys.number("outside.accel_time_periodic.phase_deg", time.phase_deg);
  read_sensor_axis(keys, "outside.accel_hysteresis.axis", outside.accel_hysteresis.axis);
  keys.number("outside.accel_hysteresis.size_ug", outside.accel_hysteresis.size_ug);
}

// Only the keys that mean something for the kind are asked for, so that the others are unknown keys.
void read_fault(KeyValueFile& file, const std::string& prefix, RigFault& fault) {
  KeyTable keys(file, any_size);
  const std::string name = file.text(prefix + "kind");
  if (!parse_rig_fault_kind(name, fault.kind)) {
    file.reject(prefix + "kind", "a kind of fault of docs/rig.md, such as lost_sample");
    return;
  }
  const auto sample = [&] { fault.sample = file.integer(prefix + "sample", 0); };
  const auto count = [&] { fault.count = file.integer_or(prefix + "count", 1, 1); };
  const auto time = [&] { fault.time_s = file.number(prefix + "time_s", zero_or_more); };
  const auto duration = [&] { keys.number(prefix + "duration_s", fault.duration_s, zero_or_more); };
  const auto hidden = [&] { keys.flag(prefix + "hidden", fault.hidden); };
  if (concerns_unit(fault.kind)) keys.whole(prefix + "unit", fault.unit, 1, 16);
  switch (fault.kind) {
    case RigFaultKind::lost_sample:
      sample();
      count();
      hidden();
      break;
    case RigFaultKind::duplicated_sample:
      sample();
      hidden();
      break;
    case RigFaultKind::gyro_glitch:
      sample();
      read_sensor_axis(keys, prefix + "axis", fault.axis);
      fault.size = file.number(prefix + "size_mrad", any_size);
      break;
    case RigFaultKind::velocity_knock:
      sample();
      read_sensor_axis(keys, prefix + "axis", fault.axis);
      fault.size = file.number(prefix + "size_mps", any_size);
      break;
    case RigFaultKind::invalid_sample:
      sample();
      count();
      break;
    case RigFaultKind::imu_silent:
      time();
      fault.duration_s = file.number(prefix + "duration_s", above_zero);
      break;
    case RigFaultKind::imu_unplugged: time(); break;
    case RigFaultKind::table_moved:
      time();
      keys.chosen(prefix + "axis", fault.axis, table_axes);
      fault.size = file.number(prefix + "size_deg", any_size);
      keys.number(prefix + "rate_degps", fault.rate_degps, above_zero);
      hidden();
      break;
    case RigFaultKind::too_fast:
      time();
      keys.chosen(prefix + "axis", fault.axis, table_axes);
      duration();
      keys.number(prefix + "rate_factor", fault.rate_factor, above_zero);
      keys.number(prefix + "acceleration_factor", fault.acceleration_factor, above_zero);
      break;
    case RigFaultKind::never_in_position:
      time();
      keys.chosen(prefix + "axis", fault.axis, table_axes);
      duration();
      break;
    case RigFaultKind::stuck_axis:
    case RigFaultKind::axis_fault:
      time();
      keys.chosen(prefix + "axis", fault.axis, table_axes);
      break;
    case RigFaultKind::emergency_stop:
    case RigFaultKind::link_lost:
      time();
      duration();
      break;
  }
}

void read_lot(KeyTable& keys, RigLot& lot) {
  if (KeyValueFile* const file = keys.file(); file && file->has("lot.seed"))
    lot.seed = static_cast<std::uint64_t>(file->integer("lot.seed", 0));
  keys.number("lot.faulty", lot.faulty, between(0.0, 1.0));
  keys.number("lot.between_h", lot.between_h, between(0.0, 1000.0));
  keys.number("lot.turn_on_gyro_degph", lot.turn_on_gyro_degph, zero_or_more);
  keys.number("lot.turn_on_accel_ug", lot.turn_on_accel_ug, zero_or_more);
  keys.number("lot.month_gyro_degph", lot.month_gyro_degph, zero_or_more);
  keys.number("lot.month_accel_ug", lot.month_accel_ug, zero_or_more);
}

void read_faults(KeyValueFile& file, std::vector<RigFault>& faults) {
  for (int number = 1; !file.keys_with_prefix("fault." + std::to_string(number) + ".").empty(); ++number) {
    RigFault next;
    read_fault(file, "fault." + std::to_string(number) + ".", next);
    faults.push_back(next);
  }
}

void read(KeyTable& keys, RigConfig& config) {
  read_general(keys, config);
  read_table_errors(keys, config.table_errors);
  read_table(keys, config.table);
  read_effects(keys, config.effects);
  read_outside(keys, config.outside);
  read_lot(keys, config.lot);
  if (keys.file()) read_faults(*keys.file(), config.faults);
}

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
  TRY(not_negative_value(prefix + "time_s", fault.time_s));
  TRY(not_negative_value(prefix + "duration_s", fault.duration_s));
  if (fault.kind == RigFaultKind::imu_silent && !(fault.duration_s > 0.0)) {
    return bad(prefix + "duration_s", fault.duration_s, "a number > 0 for imu_silent");
  }
  if (!std::isfinite(fault.size)) return bad(prefix + "size", fault.size, "a finite number");
  TRY(positive_value(prefix + "rate_factor", fault.rate_factor));
  TRY(positive_value(prefix + "acceleration_factor", fault.acceleration_factor));
  return positive_value(prefix + "rate_degps", fault.rate_degps);
}

Result<RigConfig> config_from(KeyValueFile& file, RigConfig config) {
  KeyTable keys(file, any_size);
  read(keys, config);
  TRY(file.check_all_used());
  if (Status status = check(config); !status) return input_error(file.file_name() + ": " + status.error().message);
  return config;
}

}  // namespace

Status check(const RigConfig& config) {
  RigConfig copy = config;
  KeyTable keys("rig", any_size);
  read(keys, copy);
  if (!keys.status()) return keys.status();
  for (Axis axis : all_axes) {
    const std::size_t i = index(axis);
    if (!(config.table.limit_min_deg[i] < config.table.limit_max_deg[i])) {
      return bad(std::string("table.") + to_string(axis) + ".limit_min_deg", config.table.limit_min_deg[i],
                 "a number below limit_max_deg = " + format_number(config.table.limit_max_deg[i]));
    }
  }
  for (std::size_t i = 0; i < config.faults.size(); ++i) {
    TRY(check_fault(config.faults[i], i + 1));
  }
  return check_truth(config);
}

Result<RigConfig> read_rig_config(const std::string& path, const RigConfig& base) {
  KeyValueFile file = TRY(KeyValueFile::read(path));
  return config_from(file, base);
}

Result<RigConfig> parse_rig_config(const std::string& text, const std::string& file_name) {
  KeyValueFile file = TRY(KeyValueFile::parse(text, file_name));
  return config_from(file, {});
}

}  // namespace turncal
