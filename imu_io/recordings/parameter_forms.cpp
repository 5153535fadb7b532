#include "imu_io/recordings/parameter_forms.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>

#include "imu_io/base/bytes.h"
#include "imu_io/base/crc.h"
#include "imu_io/base/format_number.h"
#include "imu_io/base/text_pieces.h"
#include "imu_io/recordings/recording_text.h"

namespace turncal {
namespace {

constexpr std::string_view block_magic = "TCPB";
constexpr std::uint32_t block_version = 1;

constexpr double not_a_number = std::numeric_limits<double>::quiet_NaN();

// A double as C and every YAML reader have it: with a point, before an exponent too.
std::string literal(double value) {
  std::string text = format_number(value);
  if (text.find('.') == std::string::npos) text.insert(std::min(text.find('e'), text.size()), ".0");
  return text;
}

// A C string: what is not plain as an octal number of three digits, '?' too (trigraphs).
std::string in_c_quotes(std::string_view text) {
  std::string result = "\"";
  for (const char c : text) {
    const bool plain = c >= ' ' && c < 127 && c != '"' && c != '\\' && c != '?';
    result += plain ? std::string(1, c) : fmt::format("\\{:03o}", static_cast<unsigned char>(c));
  }
  return result + "\"";
}

// A YAML scalar: between single quotes only they themselves need anything, and are doubled. Texts of a parameter file are printable.
std::string in_yaml_quotes(std::string_view text) {
  std::string result = "'";
  for (const char c : text) result += c == '\'' ? "''" : std::string(1, c);
  return result + "'";
}

std::string vector_of(const ParameterFile& file, int first) {
  const auto& p = file.parameters;
  return fmt::format("{{{}, {}, {}}}", literal(p[first]), literal(p[first + 1]), literal(p[first + 2]));
}

std::string matrix_of(const ParameterFile& file, int first) {
  return fmt::format("{{{}, {}, {}}}", vector_of(file, first), vector_of(file, first + 3), vector_of(file, first + 6));
}

std::string sigmas_of(const ParameterFile& file, std::size_t first, std::size_t count) {
  std::vector<std::string> texts;
  for (std::size_t k = first; k < first + count; ++k) texts.push_back(literal(file.sigma[k].value_or(-1.0)));
  return fmt::format("{{{}}}", fmt::join(texts, ", "));
}

}  // namespace

std::string format_parameter_block(const ParameterFile& file) {
  std::vector<std::byte> out;
  append_bytes(out, block_magic);
  append_bytes(out, block_version);
  for (const bool flag : {file.gyro_increment == IncrementKind::pulses, file.accel_increment == IncrementKind::pulses,
                          file.simulated, is_trusted(file)})
    append_bytes(out, static_cast<std::uint8_t>(flag ? 1 : 0));
  for (const double value : {file.sample_period_s, file.accel_pulse_mps, file.latitude_deg, file.gravity_mps2,
                             file.reference_temperature_c.value_or(not_a_number)})
    append_bytes(out, value);
  for (const double value : file.parameters) append_bytes(out, value);
  for (const std::optional<double>& value : file.sigma) append_bytes(out, value.value_or(not_a_number));
  append_text(out, file.unit_serial);
  append_bytes(out, static_cast<std::uint32_t>(file.effects.size()));
  for (const EffectValue& effect : file.effects) {
    append_text(out, effect.name + "." + effect.component);
    append_bytes(out, effect.value);
  }
  append_bytes(out, crc32c(std::span<const std::byte>(out)));
  return {reinterpret_cast<const char*>(out.data()), out.size()};
}

std::string format_parameter_header(const ParameterFile& file) {
  const bool gyro_pulses = file.gyro_increment == IncrementKind::pulses;
  const bool accel_pulses = file.accel_increment == IncrementKind::pulses;
  std::string text =
      "/* Calibration of an inertial measurement unit, made by turncal " + file.software_version +
      ".\n   Of a sample that lasts T = turncal_sample_period_s, with " +
      (gyro_pulses ? "gyro counts c (n in arcsec per count):\n     angle (arcsec)  = n c - N0 T"
                   : "gyro increments c in rad (n a number):\n     angle (rad)     = n c - N0 T pi/648000") +
      "  (N0 in deg/h, which is arcsec/s)\n   and with " +
      (accel_pulses
           ? "accelerometer counts c of turncal_accel_pulse_mps:\n     velocity (m/s)  = a c turncal_accel_pulse_mps"
           : "accelerometer increments c in m/s (a a number):\n     velocity (m/s)  = a c") +
      " - A0 9.80665 T  (A0 in g)\n   Body axes: x front, y up, z right. sigma: one standard deviation in the unit of "
      "the value, by rows; -1: "
      "not estimated. */\n";
  if (file.simulated) text += "/* SIMULATED: not of a real unit. */\n";
  if (!is_trusted(file)) text += "/* NOT TRUSTED: the model does not fit the data that it was made from. */\n";
  text += "#ifndef TURNCAL_PARAMETERS_H\n#define TURNCAL_PARAMETERS_H\n\n";
  const auto constant = [&text](const std::string& type, const std::string& name, const std::string& value) {
    text += fmt::format("static const {} turncal_{} = {};\n", type, name, value);
  };
  constant("char", "unit_serial[]", in_c_quotes(file.unit_serial));
  constant("char", "time_utc[]", in_c_quotes(file.time_utc));
  constant("char", "recording_hash[]", in_c_quotes(file.recording_hash));
  constant("int", "simulated", file.simulated ? "1" : "0");
  constant("int", "trusted", is_trusted(file) ? "1" : "0");
  constant("double", "sample_period_s", literal(file.sample_period_s));
  constant("double", "accel_pulse_mps", literal(file.accel_pulse_mps));
  constant("double", "N0_degph[3]", vector_of(file, 0));
  constant("double", "A0_g[3]", vector_of(file, 3));
  constant("double", "n[3][3]", matrix_of(file, 6));
  constant("double", "a[3][3]", matrix_of(file, 15));
  if (file.reference_temperature_c)
    constant("double", "reference_temperature_c", literal(*file.reference_temperature_c));
  constant("char", "gyro_increment[]", in_c_quotes(gyro_increment_name(file.gyro_increment)));
  constant("char", "accel_increment[]", in_c_quotes(accel_increment_name(file.accel_increment)));
  constant("double", "latitude_deg", literal(file.latitude_deg));
  constant("double", "gravity_mps2", literal(file.gravity_mps2));
  constant("double", "sigma_N0_degph[3]", sigmas_of(file, 0, 3));
  constant("double", "sigma_A0_g[3]", sigmas_of(file, 3, 3));
  constant("double", "sigma_n[9]", sigmas_of(file, 6, 9));
  constant("double", "sigma_a[9]", sigmas_of(file, 15, 9));
  for (const EffectValue& effect : file.effects)
    constant("double", "effect_" + effect.name + "_" + effect.component, literal(effect.value));
  return text + "\n#endif\n";
}

std::string format_parameter_yaml(const ParameterFile& file) {
  std::string text = "# Parameters of an inertial measurement unit, as YAML.\n";  // no other file of ours begins so
  if (file.simulated) text += "# Simulated data: a dry run, or a twin.\n";
  const auto line = [&text](const std::string& key, const std::string& value) { text += key + ": " + value + "\n"; };
  const std::pair<const char*, const std::string&> texts[] = {
      {"unit_serial", file.unit_serial}, {"recording_hash", file.recording_hash},     {"model", file.model},
      {"method", file.method},           {"software_version", file.software_version}, {"time_utc", file.time_utc}};
  for (const auto& [key, value] : texts) line(key, in_yaml_quotes(value));
  line("simulated", file.simulated ? "true" : "false");
  line("trusted", is_trusted(file) ? "true" : "false");
  line("latitude_deg", literal(file.latitude_deg));
  line("gravity_mps2", literal(file.gravity_mps2));
  line("sample_period_s", literal(file.sample_period_s));
  line("accel_pulse_mps", literal(file.accel_pulse_mps));
  line("gyro_increment", gyro_increment_name(file.gyro_increment));
  line("accel_increment", accel_increment_name(file.accel_increment));
  if (file.reference_temperature_c) line("reference_temperature_c", literal(*file.reference_temperature_c));
  text += "parameters:\n";
  for (std::size_t k = 0; k < static_cast<std::size_t>(parameter_count); ++k)
    line("  " + std::string(parameter_keys[k]), literal(file.parameters[static_cast<Eigen::Index>(k)]));
  text += "sigma:\n";
  for (std::size_t k = 0; k < static_cast<std::size_t>(parameter_count); ++k)
    line("  " + std::string(parameter_keys[k]), file.sigma[k] ? literal(*file.sigma[k]) : "null");
  text += file.effects.empty() ? "effects: {}\n" : "effects:\n";
  for (const EffectValue& effect : file.effects)
    line("  " + effect.name + "." + effect.component, literal(effect.value));
  return text;
}

}  // namespace turncal
