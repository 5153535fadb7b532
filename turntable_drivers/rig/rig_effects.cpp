#include "turntable_drivers/rig/rig_effects.h"

#include <span>

namespace turncal {
namespace {

struct Group {
  const char* name;
  std::span<double> values;
  std::span<const char* const> components;
};

constexpr const char* xyz[] = {"x", "y", "z"};
constexpr const char* pairs[] = {"xx", "xy", "xz", "yx", "yy", "yz", "zx", "zy", "zz"};
constexpr const char* products[] = {"x_xy", "x_xz", "x_yz", "y_xy", "y_xz", "y_yz", "z_xy", "z_xz", "z_yz"};
constexpr const char* arms[] = {"x_rx", "x_ry", "x_rz", "y_rx", "y_ry", "y_rz", "z_rx", "z_ry", "z_rz"};
constexpr const char* tau[] = {"tau"};
constexpr const char* north_up[] = {"north", "up"};

std::vector<Group> groups(RigEffects& e) {
  return {{"accel_second_order", e.accel_second_order, xyz},
          {"accel_scale_asymmetry", e.accel_scale_asymmetry, xyz},
          {"accel_odd_quadratic", e.accel_odd_quadratic, xyz},
          {"accel_third_order", e.accel_third_order, xyz},
          {"accel_cross_coupling", e.accel_cross_coupling, products},
          {"accel_size_effect", e.accel_size_effect, arms},
          {"accel_delay", std::span(&e.accel_delay, 1), tau},
          {"accel_bias_temperature", e.accel_bias_temperature, xyz},
          {"accel_scale_temperature", e.accel_scale_temperature, xyz},
          {"accel_bias_drift", e.accel_bias_drift, xyz},
          {"gyro_g_sensitivity", e.gyro_g_sensitivity, pairs},
          {"gyro_scale_asymmetry", e.gyro_scale_asymmetry, xyz},
          {"gyro_rate_nonlinearity", e.gyro_rate_nonlinearity, xyz},
          {"gyro_bias_temperature", e.gyro_bias_temperature, xyz},
          {"gyro_scale_temperature", e.gyro_scale_temperature, xyz},
          {"gyro_bias_drift", e.gyro_bias_drift, xyz},
          {"gyro_warm_up", e.gyro_warm_up, xyz},
          {"gyro_magnetic", e.gyro_magnetic, pairs},
          {"earth_rate", e.earth_rate, north_up},
          {"post_rotation_relaxation", e.post_rotation_relaxation, xyz},
          {"gyro_accel_flexure", e.gyro_accel_flexure, pairs},
          {"gyro_bias_temperature_rate", e.gyro_bias_temperature_rate, xyz},
          {"accel_bias_temperature_rate", e.accel_bias_temperature_rate, xyz}};
}

std::string key_of(const Group& group, std::size_t i) { return std::string(group.name) + "." + group.components[i]; }

}  // namespace

std::vector<std::string> rig_effect_keys() {
  RigEffects effects;
  std::vector<std::string> keys;
  for (const Group& group : groups(effects))
    for (std::size_t i = 0; i < group.values.size(); ++i) keys.push_back(key_of(group, i));
  return keys;
}

double* find_effect(RigEffects& effects, std::string_view key) {
  if (key == "gyro_warm_up.tau_s") return &effects.gyro_warm_up_tau_s;
  if (key == "post_rotation_relaxation.tau_s") return &effects.post_rotation_relaxation_tau_s;
  for (const Group& group : groups(effects))
    for (std::size_t i = 0; i < group.values.size(); ++i)
      if (key_of(group, i) == key) return &group.values[i];
  return nullptr;
}

std::vector<std::pair<std::string, double>> nonzero_effects(const RigEffects& effects) {
  RigEffects copy = effects;
  std::vector<std::pair<std::string, double>> list;
  for (const Group& group : groups(copy))
    for (std::size_t i = 0; i < group.values.size(); ++i)
      if (group.values[i] != 0.0) list.emplace_back(key_of(group, i), group.values[i]);
  return list;
}

}  // namespace turncal
