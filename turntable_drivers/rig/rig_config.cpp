// Reads every key of RigConfig with its range. docs/rig.md lists the keys; a test compares the two.
#include <algorithm>
#include <cmath>

#include "imu_io/base/file_kind.h"
#include "imu_io/base/key_value.h"
#include "imu_io/recordings/recording_check.h"
#include "turntable_drivers/rig/rig_config.h"

namespace turncal {
namespace {

// Limit for every quantity of the rig in its unit. A larger value is a mistake and gives meaningless results.
constexpr double largest = 1e9;
constexpr NumberRange any_size{-largest, largest};
constexpr NumberRange above_zero{0.0, largest, true};
constexpr NumberRange zero_or_more{0.0, largest};
constexpr double last_utc_s = 253402300799.0;  // the end of the year 9999
constexpr std::int64_t most_counter = max_counter / 2;

const std::vector<std::string> table_axes = {"heading", "pitch", "roll"};  // in the order of Axis
const std::vector<std::string> sensor_axes = {"x", "y", "z"};

template <class Seed>
void read_seed(KeyValueFile& file, const std::string& key, Seed& seed) {
  if (file.has(key)) seed = std::uint64_t(file.integer(key, 0));
}

void read_general(KeyTable& keys, RigConfig& config) {
  read_seed(keys.file(), "seed", config.seed);
  read_seed(keys.file(), "noise.seed", config.noise_seed);
  keys.text("unit_serial", config.unit_serial);
  keys.whole("first_counter", config.first_counter, -most_counter, most_counter);
  keys.flag("random_truth", config.random_truth);
  keys.number("start_utc_s", config.start_utc_s, between(0.0, last_utc_s));
  keys.number("sample_period_s", config.sample_period_s, between(1e-5, 1.0));
  keys.whole("quadrature_substeps", config.quadrature_substeps, 1, 1000);
  keys.number("gyro_pulse_arcsec", config.gyro_pulse_arcsec, above_zero);
  keys.number("accel_pulse_mps", config.accel_pulse_mps, above_zero);
  keys.chosen("quantisation", config.quantisation, {"floor", "round", "off"});
  for (std::size_t i = 0; i < config.truth.size(); ++i)
    keys.number(std::string("truth.") + rig_truth_keys[i], config.truth[i]);

  keys.number("site.latitude_deg", config.site.latitude_deg, between(-90.0, 90.0));
  keys.number("site.gravity_mps2", config.site.gravity_mps2, above_zero);
  keys.number("site.earth_rate_radps", config.site.earth_rate_radps);
  const char* const directions[] = {"north", "up", "east"};
  for (std::size_t i = 0; i < 3; ++i)
    keys.number(std::string("site.magnetic_") + directions[i] + "_gauss", config.site.magnetic_field_gauss[i]);
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
  for (std::size_t i = 0; i < 3; ++i)
    keys.number("table_error.mounting_" + sensor_axes[i] + "_arcmin", errors.mounting_arcmin[i]);
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
  keys.chosen("outside.gyro_bias_step.axis", outside.gyro_bias_step.axis, sensor_axes);
  keys.number("outside.gyro_bias_step.time_s", outside.gyro_bias_step.time_s);
  keys.number("outside.gyro_bias_step.size_degph", outside.gyro_bias_step.size);
  keys.chosen("outside.accel_bias_step.axis", outside.accel_bias_step.axis, sensor_axes);
  keys.number("outside.accel_bias_step.time_s", outside.accel_bias_step.time_s);
  keys.number("outside.accel_bias_step.size_ug", outside.accel_bias_step.size);
  auto& angle = outside.gyro_angle_periodic;
  keys.chosen("outside.gyro_angle_periodic.axis", angle.axis, sensor_axes);
  keys.chosen("outside.gyro_angle_periodic.table_axis", angle.table_axis, table_axes);
  keys.whole("outside.gyro_angle_periodic.order", angle.order, 0, 1000);
  keys.number("outside.gyro_angle_periodic.size_degph", angle.size_degph);
  keys.number("outside.gyro_angle_periodic.phase_deg", angle.phase_deg);
  auto& time = outside.accel_time_periodic;
  keys.chosen("outside.accel_time_periodic.axis", time.axis, sensor_axes);
  keys.number("outside.accel_time_periodic.size_ug", time.size_ug);
  keys.number("outside.accel_time_periodic.period_s", time.period_s, above_zero);
  keys.number("outside.accel_time_periodic.phase_deg", time.phase_deg);
  keys.chosen("outside.accel_hysteresis.axis", outside.accel_hysteresis.axis, sensor_axes);
  keys.number("outside.accel_hysteresis.size_ug", outside.accel_hysteresis.size_ug);
}

// Asks only for the keys that apply to the kind of fault, so that others are reported as unknown.
void read_fault(KeyValueFile& file, const std::string& prefix, RigFault& fault) {
  KeyTable keys(file, any_size);
  const std::string word = file.text(prefix + "kind");
  const std::optional<RigFaultKind> named = enum_from<RigFaultKind>(word);
  if (!named)
    return file.reject(prefix + "kind",
                       "a kind of fault of docs/rig.md" + did_you_mean(word, words_of<RigFaultKind>()));
  using enum RigFaultKind;
  const RigFaultKind kind = fault.kind = *named;
  const auto is_any = [kind](std::initializer_list<RigFaultKind> kinds) {
    return std::ranges::find(kinds, kind) != kinds.end();
  };
  const auto key = [&prefix](const char* which) { return prefix + which; };
  const bool by_sample = concerns_unit(kind) && !is_any({imu_silent, imu_unplugged});
  if (concerns_unit(kind)) keys.whole(key("unit"), fault.unit, 1, 16);
  if (by_sample) fault.sample = file.integer(key("sample"), 0);
  if (!by_sample) fault.time_s = file.number(key("time_s"), zero_or_more);
  if (is_any({lost_sample, invalid_sample})) fault.count = file.integer_or(key("count"), 1, 1);
  if (is_any({gyro_glitch, velocity_knock})) keys.chosen(key("axis"), fault.axis, sensor_axes);
  if (is_any({table_moved, too_fast, never_in_position, stuck_axis, axis_fault}))
    keys.chosen(key("axis"), fault.axis, table_axes);
  if (is_any({gyro_glitch})) fault.size = file.number(key("size_mrad"), any_size);
  if (is_any({velocity_knock})) fault.size = file.number(key("size_mps"), any_size);
  if (is_any({table_moved})) {
    fault.size = file.number(key("size_deg"), any_size);
    keys.number(key("rate_degps"), fault.rate_degps, above_zero);
  }
  if (is_any({chamber_never_settles, chamber_overheats})) fault.size = file.number(key("size_c"), any_size);
  if (is_any({imu_silent})) fault.duration_s = file.number(key("duration_s"), above_zero);
  if (is_any({too_fast, never_in_position, emergency_stop, link_lost}) || kind >= chamber_never_settles)
    keys.number(key("duration_s"), fault.duration_s, zero_or_more);
  if (is_any({too_fast})) {
    keys.number(key("rate_factor"), fault.rate_factor, above_zero);
    keys.number(key("acceleration_factor"), fault.acceleration_factor, above_zero);
  }
  if (is_any({lost_sample, duplicated_sample, table_moved})) keys.flag(key("hidden"), fault.hidden);
}

void read_lot(KeyTable& keys, RigLot& lot) {
  read_seed(keys.file(), "lot.seed", lot.seed);
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

double determinant(const std::array<double, 9>& m) {
  return m[0] * (m[4] * m[8] - m[5] * m[7]) - m[1] * (m[3] * m[8] - m[5] * m[6]) + m[2] * (m[3] * m[7] - m[4] * m[6]);
}

Status check_truth(const RigConfig& config) {
  for (std::size_t first : {std::size_t{6}, std::size_t{15}}) {
    const double nominal = first == 6 ? config.gyro_pulse_arcsec : 1.0;
    std::array<double, 9> m;
    for (std::size_t i = 0; i < 9; ++i) m[i] = config.truth[first + i].value_or(i % 4 == 0 ? nominal : 0.0) / nominal;
    if (!(std::abs(determinant(m)) > 0.1))
      return input_error(std::string("rig: truth.") + (first == 6 ? "n" : "a") +
                         ": the matrix is singular or nearly so: expected a diagonal near its nominal value");
  }
  return {};
}

Result<RigConfig> config_from(KeyValueFile& file, RigConfig config) {
  file.integer_or("format", 1, 1, 1);
  KeyTable keys(file, any_size);
  read_general(keys, config);
  read_table_errors(keys, config.table_errors);
  read_table(keys, config.table);
  read_effects(keys, config.effects);
  read_outside(keys, config.outside);
  read_lot(keys, config.lot);
  read_faults(file, config.faults);
  TRY(file.check_all_used());
  if (Status status = check(config); !status) return input_error(file.file_name() + ": " + status.error().message);
  return config;
}

}  // namespace

bool concerns_unit(RigFaultKind kind) { return kind <= RigFaultKind::imu_unplugged; }

const std::array<const char*, 24> rig_truth_keys = {"N01", "N02", "N03", "A01", "A02", "A03", "n11", "n12",
                                                    "n13", "n21", "n22", "n23", "n31", "n32", "n33", "a11",
                                                    "a12", "a13", "a21", "a22", "a23", "a31", "a32", "a33"};

RigConfig rig_of_unit(const RigConfig& config, std::size_t unit) {
  RigConfig own = config;
  std::erase_if(own.faults,
                [unit](const RigFault& fault) { return concerns_unit(fault.kind) && fault.unit != int(unit) + 1; });
  if (unit == 0) return own;
  const std::uint64_t apart = std::uint64_t(unit) * 0xA0761D6478BD642FULL;  // odd factor: all units differ
  own.unit_seed = config.unit_seed.value_or(config.seed) ^ apart;
  own.noise_seed = config.noise_seed.value_or(config.seed) ^ apart;
  own.unit_serial.clear();
  return own;
}

Status check(const RigConfig& config) {
  for (Axis axis : all_axes) {
    const double low = config.table.limit_min_deg[index(axis)], high = config.table.limit_max_deg[index(axis)];
    if (!(low < high))
      return input_error(std::string("rig: table.") + to_string(axis) + ".limit_min_deg = " + format_number(low) +
                         ": expected a number below limit_max_deg = " + format_number(high));
  }
  return check_truth(config);
}

Result<RigConfig> read_rig_config(const std::string& path, const RigConfig& base) {
  TRY(expect_file(path, FileKind::rig));
  KeyValueFile file = TRY(KeyValueFile::read(path));
  return config_from(file, base);
}

Result<RigConfig> parse_rig_config(const std::string& text, const std::string& file_name) {
  KeyValueFile file = TRY(KeyValueFile::parse(text, file_name));
  return config_from(file, {});
}

}  // namespace turncal
