#include "imu_io/recordings/parameter_file.h"

#include <algorithm>
#include <cmath>
#include <unordered_set>

#include "imu_io/base/atomic_file.h"
#include "imu_io/base/crc.h"
#include "imu_io/base/data_text.h"
#include "imu_io/base/format_number.h"
#include "imu_io/base/key_table.h"
#include "imu_io/base/key_value.h"
#include "imu_io/base/posix_file.h"
#include "imu_io/recordings/recording_check.h"
#include "imu_io/recordings/recording_source.h"
#include "imu_io/recordings/recording_text.h"

namespace turncal {
namespace {

constexpr std::string_view title = "# turncal parameter file: w = n * counts - N0 (deg/h), f = a * counts - A0 (g)\n";
constexpr double same_period = 1e-6;  // relative: a text may have rounded it

bool is_name(std::string_view name) {
  return !name.empty() && std::all_of(name.begin(), name.end(), [](char c) {
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

// Lines, and the first thing that cannot be written.
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

// What is read must be fit to be written again.
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

}  // namespace

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
    lines.number(std::string(parameter_keys[i]), file.parameters[static_cast<Eigen::Index>(i)]);
  for (std::size_t i = 0; i < parameter_keys.size(); ++i) lines.sigma(std::string(parameter_keys[i]), file.sigma[i]);
  if (file.reference_temperature_c) lines.number("reference_temperature_c", *file.reference_temperature_c);
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
  return write_file_atomically(path, text);
}

Result<ParameterFile> parse_parameter_file(std::string_view text, const std::string& file_name) {
  // The checksum first: nothing in a damaged file is worth a message of its own.
  const std::string_view above = TRY(without_checksum(text, file_name));

  KeyValueFile input = TRY(KeyValueFile::parse(above, file_name));
  ParameterFile file;
  for (std::size_t i = 0; i < parameter_keys.size(); ++i) {
    file.parameters[static_cast<Eigen::Index>(i)] = input.number(parameter_keys[i]);
    file.sigma[i] = input.number_if("sigma." + std::string(parameter_keys[i]), not_negative);
  }
  file.reference_temperature_c = input.number_if("reference_temperature_c");
  read_effects(input, file);
  file.unit_serial = plain_text(input, "unit_serial");
  file.recording_hash = plain_text(input, "recording_hash");
  file.model = plain_text(input, "model");
  file.method = plain_text(input, "method");
  file.latitude_deg = input.number("latitude_deg", site_latitude_deg);
  file.gravity_mps2 = input.number("gravity_mps2", positive);
  file.sample_period_s = input.number("sample_period_s", sample_period_range);
  using enum IncrementKind;
  file.gyro_increment = input.one_of("gyro_increment", {"pulses", "rad"}) == "pulses" ? pulses : physical;
  file.accel_increment = input.one_of("accel_increment", {"pulses", "mps"}) == "pulses" ? pulses : physical;
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

bool is_trusted(const ParameterFile& file) {
  const std::string* const value = find_further(file, "quality.trusted");
  return value == nullptr || *value == "true";
}

Status check_applicable(const ParameterFile& file, const std::string& file_name, const RecordingInfo& info) {
  const auto refuse = [&](const std::string& key, const std::string& value, const std::string& expected) {
    return input_error(file_name + ": key '" + key + "' = '" + value + "': expected " + expected +
                       ", as in the recording");
  };
  if (file.unit_serial != info.unit_serial)
    return refuse("unit_serial", file.unit_serial, "'" + info.unit_serial + "'");
  if (std::abs(file.sample_period_s - info.sample_period_s) > same_period * info.sample_period_s)
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

}  // namespace turncal
