// A parameter file in other forms, for whoever loads it into a navigation computer: a C header, a binary block with a checksum, YAML.
//
// Formats: docs/parameter-forms.md. All numbers are those of the parameter file, in its units (calib/model/parameters.h); C and YAML
// have them in the shortest form that reads back as the same double. Simulated and untrusted files say so in every form.
#pragma once

#include <array>
#include <cstddef>
#include <limits>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "calib/types/status.h"
#include "imu_io/recordings/parameter_file.h"

namespace turncal {

// What the binary block holds.
struct ParameterBlock {
  bool gyro_pulses = true, accel_pulses = true;
  bool simulated = false;
  bool trusted = true;
  double sample_period_s = 0.0;
  double accel_pulse_mps = 0.0;
  double latitude_deg = 0.0;
  double gravity_mps2 = 0.0;
  double reference_temperature_c = std::numeric_limits<double>::quiet_NaN();  // NaN: none
  std::array<double, parameter_count> value{};
  std::array<double, parameter_count> sigma{};  // NaN: not estimated
  std::string unit_serial;
  std::vector<std::pair<std::string, double>> effects;  // "accel_size_effect.x_rx" and its value
};
ParameterBlock block_of(const ParameterFile& file);

std::vector<std::byte> format_parameter_block(const ParameterBlock& block);
// Errors name `file_name`: no such block, another version, cut off, a wrong checksum.
Result<ParameterBlock> parse_parameter_block(std::span<const std::byte> bytes, const std::string& file_name);

std::string format_parameter_header(const ParameterFile& file);
std::string format_parameter_yaml(const ParameterFile& file);

}  // namespace turncal
