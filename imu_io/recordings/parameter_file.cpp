#include "imu_io/recordings/parameter_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <unordered_set>

#include "imu_io/base/bytes.h"
#include "imu_io/base/crc.h"
#include "imu_io/base/data_text.h"
#include "imu_io/base/file_kind.h"
#include "imu_io/base/files.h"
#include "imu_io/base/key_value.h"
#include "imu_io/base/text.h"
#include "imu_io/recordings/recording_check.h"
#include "imu_io/recordings/recording_source.h"
#include "imu_io/recordings/recording_text.h"

namespace turncal {
namespace {

constexpr std::string_view trusted_key = "quality.trusted", reason_key = "quality.reason";
constexpr std::string_view title = "# turncal parameter file: w = n * counts - N0 (deg/h), f = a * counts - A0 (g)\n";

bool is_name(std::string_view name) {
  return !name.empty() && std::ranges::all_of(name, [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_';
  });
}

bool is_further_key(std::string_view key) {
  for (const std::string_view prefix : further_key_prefixes) {
    if (!key.starts_with(prefix)) continue;
    bool part_is_empty = true;
    for (const char c : key.substr(prefix.size())) {
      if (c == '.' ? part_is_empty : !is_name({&c, 1}) && c != '-') return false;
      part_is_empty = c == '.';
    }
    return !part_is_empty;
  }
  return false;
}

// Collects lines and remembers the first one that cannot be written.
struct Lines {
  void text(const std::string& key, const std::string& value) {
    if (!keys.insert(key).second) return fail(key, "occurs twice");
    if (!is_plain_text(value)) return fail(key, "= '" + value + "': expected printable text without '#', not empty");
    lines.text(key, value);
  }
  void number(const std::string& key, double value) {
    if (!std::isfinite(value)) return fail(key, "is not finite");
    text(key, format_number(value));
  }
  void sigma(const std::string& key, const std::optional<double>& value) {
    if (!value) return;
    if (!(*value >= 0.0)) return fail("sigma." + key, "expected a number >= 0");
    number("sigma." + key, *value);
  }
  void fail(const std::string& key, const std::string& what) {
    if (defect.empty()) defect = "parameter file: key '" + key + "' " + what;
  }
  Result<std::string> finish() {
    if (!defect.empty()) return Error{ErrorKind::internal, defect};
    return with_checksum(lines.take());
  }

  KeyValues lines{title};
  std::string defect;
  std::unordered_set<std::string> keys;
};

// Reads a text that could also be written.
std::string plain_text(KeyValueFile& input, std::string_view key) {
  std::string value = input.text(key);
  if (!is_plain_text(value)) input.reject(key, "printable text");
  return value;
}

void read_effects(KeyValueFile& input, ParameterFile& file) {
  constexpr std::string_view prefix = "effect.";
  for (const std::string& key : input.keys_with_prefix(prefix)) {
    const std::string remaining = key.substr(prefix.size());
    const std::size_t dot = remaining.find('.');
    EffectValue effect;
    effect.name = remaining.substr(0, dot);
    if (dot != std::string::npos) effect.component = remaining.substr(dot + 1);
    if (!is_name(effect.name) || !is_name(effect.component)) {
      input.reject(key, "a key effect.<name>.<component>");
      return;
    }
    effect.value = input.number(key);
    effect.sigma = input.number_if("sigma." + key, not_negative);
    file.effects.push_back(std::move(effect));
  }
}

std::string temperature_key(int parameter, int order) {
  return "temperature." + parameter_key(parameter) + "." + std::to_string(order);
}

// Calls f(key, coefficient, sigma) for all of them, in order.
template <class Polynomials, class F>
void each_temperature_key(Polynomials& t, const F& f) {
  for (int k = 0; k < parameter_count; ++k)
    for (int order = 1; order <= 3; ++order)
      f(temperature_key(k, order), t.coefficient(k, order - 1), t.sigma(k, order - 1));
}

void write_temperature(const TemperaturePolynomials& t, Lines& lines) {
  lines.number("temperature.reference_c", t.reference_c);
  lines.text("temperature.range_c", format_number(t.low_c) + ", " + format_number(t.high_c));
  each_temperature_key(t, [&](const std::string& key, double value, double sigma) {
    if (std::isnan(value)) return;
    lines.number(key, value);
    if (!std::isnan(sigma)) lines.sigma(key, sigma);
  });
}

std::optional<TemperaturePolynomials> read_temperature(KeyValueFile& input) {
  if (input.keys_with_prefix("temperature.").empty()) return std::nullopt;
  TemperaturePolynomials t;
  t.reference_c = input.number("temperature.reference_c");
  const std::vector<double> range = input.numbers("temperature.range_c", 2);
  if (range.size() == 2) t.low_c = range[0], t.high_c = range[1];
  if (!(t.low_c <= t.reference_c && t.reference_c <= t.high_c && t.low_c < t.high_c))
    input.reject("temperature.range_c", "the lower, then the higher end of a range that temperature.reference_c is in");
  each_temperature_key(t, [&](const std::string& key, double& value, double& sigma) {
    if (!input.has(key)) return;
    value = input.number(key);
    sigma = input.number_if("sigma." + key, not_negative).value_or(sigma);
  });
  return t;
}

constexpr std::string_view block_magic = "TCPB";
constexpr std::uint32_t block_version = 1;

constexpr double not_a_number = std::numeric_limits<double>::quiet_NaN();

// Formats a double for C and for every YAML reader: with a decimal point, also before an exponent.
std::string literal(double value) {
  std::string text = format_number(value);
  if (text.find('.') == std::string::npos) text.insert(std::min(text.find('e'), text.size()), ".0");
  return text;
}

// Returns a C string. Characters that are not plain become three octal digits, including '?' (trigraphs).
std::string in_c_quotes(std::string_view text) {
  std::string result = "\"";
  for (const char c : text) {
    const bool plain = c >= ' ' && c < 127 && c != '"' && c != '\\' && c != '?';
    result += plain ? std::string(1, c) : fmt::format("\\{:03o}", static_cast<unsigned char>(c));
  }
  return result + "\"";
}

// Returns a single-quoted YAML scalar, in which only single quotes need doubling. Texts of a parameter file are printable.
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

std::string orders_of(const TemperaturePolynomials& t, int first, int count) {
  std::vector<std::string> rows;
  for (int k = first; k < first + count; ++k) {
    const auto c = [&](int order) {
      return literal(std::isnan(t.coefficient(k, order)) ? 0.0 : t.coefficient(k, order));
    };
    rows.push_back(fmt::format("{{{}, {}, {}}}", c(0), c(1), c(2)));
  }
  return fmt::format("{{{}}}", fmt::join(rows, ", "));
}

}  // namespace

ParameterVector TemperaturePolynomials::at(const ParameterVector& reference, double temperature_c) const {
  const double x = std::clamp(temperature_c, low_c, high_c) - reference_c;
  const auto there = coefficient.array().isNaN().select(0.0, coefficient);
  return reference + there * Eigen::Vector3d(x, x * x, x * x * x);
}

const std::string* find_further(const ParameterFile& file, std::string_view key) {
  for (const auto& [name, value] : file.further)
    if (name == key) return &value;
  return nullptr;
}

void ParameterFile::add_further(std::string key, double value) { add_further(std::move(key), format_number(value)); }

void describe_recording(const RecordingInfo& info, ParameterFile& file) {
  file.unit_serial = info.unit_serial;
  file.latitude_deg = info.latitude_deg;
  file.gravity_mps2 = info.gravity_mps2;
  file.sample_period_s = info.sample_period_s;
  file.gyro_increment = info.gyro_increment;
  file.accel_increment = info.accel_increment;
  file.accel_pulse_mps = info.accel_pulse_mps;
  file.simulated = info.simulated;
}

Result<std::string> format_parameter_file(const ParameterFile& file) {
  Lines lines;
  for (std::size_t i = 0; i < parameter_keys.size(); ++i)
    lines.number(std::string(parameter_keys[i]), file.parameters[Eigen::Index(i)]);
  for (std::size_t i = 0; i < parameter_keys.size(); ++i) lines.sigma(std::string(parameter_keys[i]), file.sigma[i]);
  if (file.reference_temperature_c) lines.number("reference_temperature_c", *file.reference_temperature_c);
  if (file.temperature) write_temperature(*file.temperature, lines);
  for (const EffectValue& effect : file.effects) {
    const std::string key = "effect." + effect.name + "." + effect.component;
    if (!is_name(effect.name) || !is_name(effect.component)) lines.fail(key, "expected effect.<name>.<component>");
    lines.number(key, effect.value);
    lines.sigma(key, effect.sigma);
  }
  lines.text("unit_serial", file.unit_serial);
  lines.text("recording_hash", file.recording_hash);
  lines.text("model", file.model);
  lines.text("method", file.method);
  lines.number("latitude_deg", file.latitude_deg);
  lines.number("gravity_mps2", file.gravity_mps2);
  lines.number("sample_period_s", file.sample_period_s);
  lines.text("gyro_increment", gyro_increment_name(file.gyro_increment));
  lines.text("accel_increment", accel_increment_name(file.accel_increment));
  lines.number("accel_pulse_mps", file.accel_pulse_mps);
  if (file.simulated) lines.text("simulated", "true");
  lines.text("software_version", file.software_version);
  lines.text("time_utc", file.time_utc);
  for (const auto& [key, value] : file.further) {
    if (!is_further_key(key)) lines.fail(key, "expected one that begins with noise., quality., record. or verdict.");
    lines.text(key, value);
  }
  return lines.finish();
}

Status write_parameter_file(const ParameterFile& file, const std::string& path) {
  const std::string text = TRY(format_parameter_file(file));
  TRY(check_replaceable(path, title.substr(0, title.find(':'))));
  return write_file_atomically(path, text);
}

Result<ParameterFile> parse_parameter_file(std::string_view text, const std::string& file_name) {
  // The checksum comes first: a damaged file needs no other message.
  const std::string_view above = TRY(without_checksum(text, file_name));

  KeyValueFile input = TRY(KeyValueFile::parse(above, file_name));
  ParameterFile file;
  for (std::size_t i = 0; i < parameter_keys.size(); ++i) {
    file.parameters[Eigen::Index(i)] = input.number(parameter_keys[i]);
    file.sigma[i] = input.number_if("sigma." + std::string(parameter_keys[i]), not_negative);
  }
  file.reference_temperature_c = input.number_if("reference_temperature_c");
  file.temperature = read_temperature(input);
  read_effects(input, file);
  file.unit_serial = plain_text(input, "unit_serial");
  file.recording_hash = plain_text(input, "recording_hash");
  file.model = plain_text(input, "model");
  file.method = plain_text(input, "method");
  file.latitude_deg = input.number("latitude_deg", site_latitude_deg);
  file.gravity_mps2 = input.number("gravity_mps2", positive);
  file.sample_period_s = input.number("sample_period_s", sample_period_range);
  read_increments(input, file.gyro_increment, file.accel_increment);
  file.accel_pulse_mps =
      input.number("accel_pulse_mps", file.accel_increment == IncrementKind::pulses ? positive : not_negative);
  file.simulated = input.boolean_or("simulated", false);
  file.software_version = plain_text(input, "software_version");
  file.time_utc = plain_text(input, "time_utc");
  for (const std::string& key : input.keys())
    if (is_further_key(key)) file.further.emplace_back(key, plain_text(input, key));
  TRY(input.check_all_used());
  return file;
}

Result<ParameterFile> read_parameter_file(const std::string& path) {
  TRY(expect_file(path, FileKind::parameters));
  const std::string text = TRY(read_whole_file(path));
  if (text.empty()) return input_error(path + ": empty file: expected a parameter file");
  Result<ParameterFile> file = parse_parameter_file(text, path);
  if (!file) return file;
  if (const std::string* const keys = find_further(*file, undetermined_key))
    return input_error(path + ": its calibration did not determine " + *keys + ": expected one that did");
  return file;
}

Result<std::string> calibration_hash(ParameterFile file) {
  std::erase_if(file.further, [](const auto& entry) { return entry.first.starts_with("verdict."); });
  const std::string text = TRY(format_parameter_file(file));
  return hash_of_text(TRY(without_checksum(text, "parameter file")));
}

void describe_trust(const std::string& why_not, ParameterFile& file) {
  const std::string* const open = find_further(file, undetermined_key);
  const std::string reason = why_not.empty() && open != nullptr ? "not determined: " + *open : why_not;
  std::erase_if(file.further, [](const auto& key) { return key.first == trusted_key || key.first == reason_key; });
  file.add_further(std::string(trusted_key), std::string(reason.empty() ? "true" : "false"));
  if (!reason.empty()) file.add_further(std::string(reason_key), reason);
}

bool is_trusted(const ParameterFile& file) {
  const std::string* const value = find_further(file, trusted_key);
  return value == nullptr || *value == "true";
}

std::string why_not_trusted(const ParameterFile& file) {
  const std::string* const reason = find_further(file, reason_key);
  return reason != nullptr ? *reason : is_trusted(file) ? "" : "its file does not say why";
}

Status check_applicable(const ParameterFile& file, const std::string& file_name, const RecordingInfo& info) {
  const auto refuse = [&](const std::string& key, const std::string& value, const std::string& expected) {
    return input_error("{}: key '{}' = '{}': expected {}, as in the recording", file_name, key, value, expected);
  };
  if (file.unit_serial != info.unit_serial) return refuse("unit_serial", file.unit_serial, quoted(info.unit_serial));
  if (!same_sample_period(file.sample_period_s, info.sample_period_s))
    return refuse("sample_period_s", format_number(file.sample_period_s), format_number(info.sample_period_s));
  if (file.gyro_increment != info.gyro_increment)
    return refuse("gyro_increment", gyro_increment_name(file.gyro_increment), gyro_increment_name(info.gyro_increment));
  if (file.accel_increment != info.accel_increment)
    return refuse("accel_increment", accel_increment_name(file.accel_increment),
                  accel_increment_name(info.accel_increment));
  if (file.accel_increment == IncrementKind::pulses && file.accel_pulse_mps != info.accel_pulse_mps)
    return refuse("accel_pulse_mps", format_number(file.accel_pulse_mps), format_number(info.accel_pulse_mps));
  if (file.simulated && !info.simulated)
    return input_error(file_name + ": simulated parameters: expected those of a real calibration for this recording");
  return {};
}

// ---- other forms ----

std::string format_parameter_block(const ParameterFile& file) {
  std::vector<std::byte> out;
  append_bytes(out, block_magic);
  append_bytes(out, block_version);
  for (const bool flag : {file.gyro_increment == IncrementKind::pulses, file.accel_increment == IncrementKind::pulses,
                          file.simulated, is_trusted(file)})
    append_bytes(out, std::uint8_t(flag ? 1 : 0));
  for (const double value : {file.sample_period_s, file.accel_pulse_mps, file.latitude_deg, file.gravity_mps2,
                             file.reference_temperature_c.value_or(not_a_number)})
    append_bytes(out, value);
  for (const double value : file.parameters) append_bytes(out, value);
  for (const std::optional<double>& value : file.sigma) append_bytes(out, value.value_or(not_a_number));
  append_text(out, file.unit_serial);
  append_bytes(out, std::uint32_t(file.effects.size()));
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
      "the value, by rows; -1: not estimated. */\n";
  if (file.temperature)
    text +=
        "/* At the temperature t (C), limited to turncal_temperature_range_c, each number p of N0, A0, n and a is\n"
        "     p + c[0] x + c[1] x^2 + c[2] x^3,  x = t - turncal_temperature_reference_c\n"
        "   with c of turncal_temperature_N0_degph, _A0_g, _n and _a: a row a number, n and a by rows. */\n";
  if (file.simulated) text += "/* SIMULATED: not of a real unit. */\n";
  if (!is_trusted(file)) text += "/* NOT TRUSTED: turncal_reason says why. */\n";
  text += "#ifndef TURNCAL_PARAMETERS_H\n#define TURNCAL_PARAMETERS_H\n\n";
  const auto constant = [&text](const std::string& type, const std::string& name, const std::string& value) {
    text += fmt::format("static const {} turncal_{} = {};\n", type, name, value);
  };
  constant("char", "unit_serial[]", in_c_quotes(file.unit_serial));
  constant("char", "time_utc[]", in_c_quotes(file.time_utc));
  constant("char", "recording_hash[]", in_c_quotes(file.recording_hash));
  constant("int", "simulated", file.simulated ? "1" : "0");
  constant("int", "trusted", is_trusted(file) ? "1" : "0");
  constant("char", "reason[]", in_c_quotes(why_not_trusted(file)));
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
  if (const auto& t = file.temperature) {
    constant("double", "temperature_reference_c", literal(t->reference_c));
    constant("double", "temperature_range_c[2]", fmt::format("{{{}, {}}}", literal(t->low_c), literal(t->high_c)));
    constant("double", "temperature_N0_degph[3][3]", orders_of(*t, 0, 3));
    constant("double", "temperature_A0_g[3][3]", orders_of(*t, 3, 3));
    constant("double", "temperature_n[9][3]", orders_of(*t, 6, 9));
    constant("double", "temperature_a[9][3]", orders_of(*t, 15, 9));
  }
  for (const EffectValue& effect : file.effects)
    constant("double", "effect_" + effect.name + "_" + effect.component, literal(effect.value));
  return text + "\n#endif\n";
}

std::string format_parameter_yaml(const ParameterFile& file) {
  std::string text = "# Parameters of an inertial measurement unit, as YAML.\n";  // unique among our files
  if (file.simulated) text += "# Simulated data: a dry run, or a twin.\n";
  const auto line = [&text](const std::string& key, const std::string& value) { text += key + ": " + value + "\n"; };
  const std::pair<const char*, const std::string&> texts[] = {
      {"unit_serial", file.unit_serial}, {"recording_hash", file.recording_hash},     {"model", file.model},
      {"method", file.method},           {"software_version", file.software_version}, {"time_utc", file.time_utc}};
  for (const auto& [key, value] : texts) line(key, in_yaml_quotes(value));
  line("simulated", file.simulated ? "true" : "false");
  line("trusted", is_trusted(file) ? "true" : "false");
  if (!is_trusted(file)) line("reason", in_yaml_quotes(why_not_trusted(file)));
  line("latitude_deg", literal(file.latitude_deg));
  line("gravity_mps2", literal(file.gravity_mps2));
  line("sample_period_s", literal(file.sample_period_s));
  line("accel_pulse_mps", literal(file.accel_pulse_mps));
  line("gyro_increment", gyro_increment_name(file.gyro_increment));
  line("accel_increment", accel_increment_name(file.accel_increment));
  if (file.reference_temperature_c) line("reference_temperature_c", literal(*file.reference_temperature_c));
  text += "parameters:\n";
  for (std::size_t k = 0; k < std::size_t(parameter_count); ++k)
    line("  " + std::string(parameter_keys[k]), literal(file.parameters[Eigen::Index(k)]));
  text += "sigma:\n";
  for (std::size_t k = 0; k < std::size_t(parameter_count); ++k)
    line("  " + std::string(parameter_keys[k]), file.sigma[k] ? literal(*file.sigma[k]) : "null");
  if (file.temperature) {
    const TemperaturePolynomials& t = *file.temperature;
    text += fmt::format("temperature:\n  reference_c: {}\n  range_c: [{}, {}]\n", literal(t.reference_c),
                        literal(t.low_c), literal(t.high_c));
    each_temperature_key(t, [&](const std::string& key, double value, double) {
      if (!std::isnan(value)) line("  " + key.substr(key.find('.') + 1), literal(value));
    });
  }
  text += file.effects.empty() ? "effects: {}\n" : "effects:\n";
  for (const EffectValue& effect : file.effects)
    line("  " + effect.name + "." + effect.component, literal(effect.value));
  return text;
}

}  // namespace turncal
