// The text form of RigConfig. docs/rig.md is the list of keys; a test holds the two against each other.
#include <cmath>

#include "imu_io/base/key_value.h"
#include "turntable_drivers/rig/rig_config.h"

namespace turncal {
namespace {

class Reader {
 public:
  explicit Reader(KeyValueFile& file) : file_(file) {}

  void read(RigConfig& config);

 private:
  void number(const std::string& key, double& value, NumberRange range = any_number) {
    value = file_.number_or(key, value, range);
  }
  void number(const std::string& key, std::optional<double>& value, NumberRange range = any_number) {
    if (const std::optional<double> given = file_.number_if(key, range)) value = given;
  }
  void whole(const std::string& key, int& value, int min, int max) {
    value = static_cast<int>(file_.integer_or(key, value, min, max));
  }
  void sensor_axis(const std::string& key, int& axis) {
    const std::string name = file_.one_of_or(key, axis == 0 ? "x" : axis == 1 ? "y" : "z", {"x", "y", "z"});
    axis = name == "x" ? 0 : name == "y" ? 1 : 2;
  }
  void table_axis(const std::string& key, int& axis) {
    const std::string name = file_.one_of_or(key, to_string(static_cast<Axis>(axis)), {"heading", "pitch", "roll"});
    axis = name == "heading" ? 0 : name == "pitch" ? 1 : 2;
  }
  void general(RigConfig& config);
  void table_errors(RigTableErrors& errors);
  void table(RigTableBehaviour& table);
  void outside(RigOutsideEffects& outside);
  void effects(RigEffects& effects);
  void faults(std::vector<RigFault>& faults);
  void fault(const std::string& prefix, RigFault& fault);

  KeyValueFile& file_;
};

void Reader::general(RigConfig& config) {
  config.seed = static_cast<std::uint64_t>(file_.integer_or("seed", static_cast<std::int64_t>(config.seed), 0));
  if (file_.has("noise.seed")) config.noise_seed = static_cast<std::uint64_t>(file_.integer("noise.seed", 0));
  config.unit_serial = file_.text_or("unit_serial", config.unit_serial);
  number("start_utc_s", config.start_utc_s, not_negative);
  number("sample_period_s", config.sample_period_s, between(1e-5, 1.0));
  config.first_counter = file_.integer_or("first_counter", config.first_counter);
  whole("quadrature_substeps", config.quadrature_substeps, 1, 1000);
  number("gyro_pulse_arcsec", config.gyro_pulse_arcsec, positive);
  number("accel_pulse_mps", config.accel_pulse_mps, positive);
  const std::string quantisation = file_.one_of_or("quantisation", "floor", {"floor", "round", "off"});
  config.quantisation = quantisation == "floor"   ? RigQuantisation::floor
                        : quantisation == "round" ? RigQuantisation::round
                                                  : RigQuantisation::off;
  config.random_truth = file_.boolean_or("random_truth", config.random_truth);
  for (std::size_t i = 0; i < config.truth.size(); ++i) {
    number(std::string("truth.") + rig_truth_keys[i], config.truth[i]);
  }

  number("site.latitude_deg", config.site.latitude_deg, between(-90.0, 90.0));
  number("site.gravity_mps2", config.site.gravity_mps2, positive);
  number("site.earth_rate_radps", config.site.earth_rate_radps);
  const char* const directions[] = {"north", "up", "east"};
  for (std::size_t i = 0; i < 3; ++i) {
    number(std::string("site.magnetic_") + directions[i] + "_gauss", config.site.magnetic_field_gauss[i]);
  }
  RigNoise& noise = config.noise;
  number("noise.gyro_random_walk_deg_per_rt_h", noise.gyro_random_walk_deg_per_rt_h, not_negative);
  number("noise.accel_random_walk_ug_per_rt_hz", noise.accel_random_walk_ug_per_rt_hz, not_negative);
  number("noise.gyro_bias_instability_degph", noise.gyro_bias_instability_degph, not_negative);
  number("noise.accel_bias_instability_ug", noise.accel_bias_instability_ug, not_negative);
  number("noise.gyro_rate_random_walk_degph_per_rt_h", noise.gyro_rate_random_walk_degph_per_rt_h, not_negative);
  number("noise.accel_acceleration_random_walk_ug_per_rt_h", noise.accel_acceleration_random_walk_ug_per_rt_h,
         not_negative);
  number("noise.flicker_longest_s", noise.flicker_longest_s, positive);

  number("temperature.start_c", config.temperature.start_c);
  number("temperature.rise_c", config.temperature.rise_c);
  number("temperature.tau_s", config.temperature.tau_s, positive);
  number("temperature.reference_c", config.temperature.reference_c);
}

void Reader::table_errors(RigTableErrors& errors) {
  number("table_error.random_arcmin", errors.random_arcmin, between(0.0, 600.0));
  number("table_error.tilt_north_arcmin", errors.tilt_north_arcmin);
  number("table_error.tilt_east_arcmin", errors.tilt_east_arcmin);
  number("table_error.north_arcmin", errors.north_arcmin);
  number("table_error.heading_pitch_arcmin", errors.heading_pitch_arcmin);
  number("table_error.pitch_roll_arcmin", errors.pitch_roll_arcmin);
  const char* const body[] = {"x", "y", "z"};
  for (std::size_t i = 0; i < 3; ++i) {
    number(std::string("table_error.mounting_") + body[i] + "_arcmin", errors.mounting_arcmin[i]);
  }
  for (Axis axis : all_axes) {
    const std::size_t i = static_cast<std::size_t>(axis);
    const std::string prefix = std::string("table_error.") + to_string(axis) + ".";
    number(prefix + "encoder_offset_arcsec", errors.encoder[i].offset_arcsec);
    number(prefix + "encoder_scale_ppm", errors.encoder[i].scale_ppm);
    number(prefix + "encoder_harmonic_arcsec", errors.encoder[i].harmonic_arcsec);
    number(prefix + "encoder_phase_deg", errors.encoder[i].phase_deg);
    whole(prefix + "encoder_order", errors.encoder[i].order, 0, 10000);
    number(prefix + "creep_arcsec", errors.creep_arcsec[i]);
  }
  number("table_error.creep_tau_s", errors.creep_tau_s, positive);
}

void Reader::table(RigTableBehaviour& table) {
  for (Axis axis : all_axes) {
    const std::size_t i = static_cast<std::size_t>(axis);
    const std::string prefix = std::string("table.") + to_string(axis) + ".";
    number(prefix + "power_on_deg", table.power_on_deg[i]);
    number(prefix + "limit_min_deg", table.limit_min_deg[i]);
    number(prefix + "limit_max_deg", table.limit_max_deg[i]);
    number(prefix + "max_rate_degps", table.max_rate_degps[i], positive);
    number(prefix + "max_acceleration_degps2", table.max_acceleration_degps2[i], positive);
  }
  number("table.home_rate_degps", table.home_rate_degps, positive);
  number("table.home_acceleration_degps2", table.home_acceleration_degps2, positive);
  number("table.home_time_s", table.home_time_s, not_negative);
  number("table.encoder_resolution_deg", table.encoder_resolution_deg, not_negative);
  number("table.in_position_tolerance_deg", table.in_position_tolerance_deg, not_negative);
  number("table.in_position_time_s", table.in_position_time_s, not_negative);
  const std::string flag =
      file_.one_of_or("table.in_position", "honest", {"honest", "servo_on", "after_stop", "stale", "late", "flicker"});
  table.in_position = flag == "servo_on"     ? InPositionFlag::servo_on
                      : flag == "after_stop" ? InPositionFlag::after_stop
                      : flag == "stale"      ? InPositionFlag::stale
                      : flag == "late"       ? InPositionFlag::late
                      : flag == "flicker"    ? InPositionFlag::flicker
                                             : InPositionFlag::honest;
}

void Reader::effects(RigEffects& effects) {
  for (const std::string& key : rig_effect_keys()) number("effect." + key, *find_effect(effects, key));
  number("effect.gyro_warm_up.tau_s", effects.gyro_warm_up_tau_s, positive);
  number("effect.post_rotation_relaxation.tau_s", effects.post_rotation_relaxation_tau_s, positive);
}

void Reader::outside(RigOutsideEffects& outside) {
  sensor_axis("outside.gyro_bias_step.axis", outside.gyro_bias_step.axis);
  number("outside.gyro_bias_step.time_s", outside.gyro_bias_step.time_s);
  number("outside.gyro_bias_step.size_degph", outside.gyro_bias_step.size);
  sensor_axis("outside.accel_bias_step.axis", outside.accel_bias_step.axis);
  number("outside.accel_bias_step.time_s", outside.accel_bias_step.time_s);
  number("outside.accel_bias_step.size_ug", outside.accel_bias_step.size);
  auto& angle = outside.gyro_angle_periodic;
  sensor_axis("outside.gyro_angle_periodic.axis", angle.axis);
  int table_axis_number = static_cast<int>(angle.table_axis);
  table_axis("outside.gyro_angle_periodic.table_axis", table_axis_number);
  angle.table_axis = static_cast<Axis>(table_axis_number);
  whole("outside.gyro_angle_periodic.order", angle.order, 0, 1000);
  number("outside.gyro_angle_periodic.size_degph", angle.size_degph);
  number("outside.gyro_angle_periodic.phase_deg", angle.phase_deg);
  auto& time = outside.accel_time_periodic;
  sensor_axis("outside.accel_time_periodic.axis", time.axis);
  number("outside.accel_time_periodic.size_ug", time.size_ug);
  number("outside.accel_time_periodic.period_s", time.period_s, positive);
  number("outside.accel_time_periodic.phase_deg", time.phase_deg);
  sensor_axis("outside.accel_hysteresis.axis", outside.accel_hysteresis.axis);
  number("outside.accel_hysteresis.size_ug", outside.accel_hysteresis.size_ug);
}

// Only the keys that mean something for the kind are asked for, so that the others are unknown keys.
void Reader::fault(const std::string& prefix, RigFault& fault) {
  const std::string name = file_.text(prefix + "kind");
  if (!parse_rig_fault_kind(name, fault.kind)) {
    file_.reject(prefix + "kind", "a kind of fault of docs/rig.md, such as lost_sample");
    return;
  }
  const auto sample = [&] { fault.sample = file_.integer(prefix + "sample", 0); };
  const auto count = [&] { fault.count = file_.integer_or(prefix + "count", 1, 1); };
  const auto time = [&] { fault.time_s = file_.number(prefix + "time_s", not_negative); };
  const auto duration = [&] { number(prefix + "duration_s", fault.duration_s, not_negative); };
  const auto hidden = [&] { fault.hidden = file_.boolean_or(prefix + "hidden", false); };
  if (concerns_unit(fault.kind)) fault.unit = static_cast<int>(file_.integer_or(prefix + "unit", 1, 1, 16));
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
      sensor_axis(prefix + "axis", fault.axis);
      fault.size = file_.number(prefix + "size_mrad");
      break;
    case RigFaultKind::velocity_knock:
      sample();
      sensor_axis(prefix + "axis", fault.axis);
      fault.size = file_.number(prefix + "size_mps");
      break;
    case RigFaultKind::invalid_sample:
      sample();
      count();
      break;
    case RigFaultKind::imu_silent:
      time();
      fault.duration_s = file_.number(prefix + "duration_s", positive);
      break;
    case RigFaultKind::imu_unplugged: time(); break;
    case RigFaultKind::table_moved:
      time();
      table_axis(prefix + "axis", fault.axis);
      fault.size = file_.number(prefix + "size_deg");
      number(prefix + "rate_degps", fault.rate_degps, positive);
      hidden();
      break;
    case RigFaultKind::never_in_position:
      time();
      table_axis(prefix + "axis", fault.axis);
      duration();
      break;
    case RigFaultKind::stuck_axis:
    case RigFaultKind::axis_fault:
      time();
      table_axis(prefix + "axis", fault.axis);
      break;
    case RigFaultKind::emergency_stop:
    case RigFaultKind::link_lost:
      time();
      duration();
      break;
  }
}

void Reader::faults(std::vector<RigFault>& faults) {
  for (int number = 1; !file_.keys_with_prefix("fault." + std::to_string(number) + ".").empty(); ++number) {
    RigFault next;
    fault("fault." + std::to_string(number) + ".", next);
    faults.push_back(next);
  }
}

void Reader::read(RigConfig& config) {
  general(config);
  table_errors(config.table_errors);
  table(config.table);
  effects(config.effects);
  outside(config.outside);
  faults(config.faults);
}

Result<RigConfig> config_from(KeyValueFile& file) {
  RigConfig config;
  Reader(file).read(config);
  if (Status status = file.check_all_used(); !status) return status.error();
  if (Status status = check(config); !status) return input_error(file.file_name() + ": " + status.error().message);
  return config;
}

}  // namespace

Result<RigConfig> read_rig_config(const std::string& path) {
  Result<KeyValueFile> file = KeyValueFile::read(path);
  if (!file) return file.error();
  return config_from(*file);
}

Result<RigConfig> parse_rig_config(const std::string& text, const std::string& file_name) {
  Result<KeyValueFile> file = KeyValueFile::parse(text, file_name);
  if (!file) return file.error();
  return config_from(*file);
}

}  // namespace turncal
