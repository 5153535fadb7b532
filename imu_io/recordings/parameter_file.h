// The file with the result of a calibration: the 24 parameters, their standard deviations, added effects, and what
// identifies the recording they belong to. Format: docs/files.md.
//
// A file that is read and written again has the same bytes: numbers have their shortest round-trip form, the order is fixed,
// and the last line is a checksum (crc.h).
#pragma once

#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "calib/model/parameters.h"
#include "calib/types/recording_types.h"
#include "calib/types/status.h"

namespace turncal {

// One component of an effect; names and units: docs/diagnosis.md.
struct EffectValue {
  std::string name;       // accel_size_effect
  std::string component;  // x_rx
  double value = 0.0;
  std::optional<double> sigma;
  bool operator==(const EffectValue&) const = default;
};

// The parameters at other temperatures (docs/thermal.md): p + c_1 x + c_2 x^2 + c_3 x^3 with the file's p and x = T - reference_c.
struct TemperaturePolynomials {
  using Orders = Eigen::Matrix<double, parameter_count, 3>;
  double reference_c = 0.0, low_c = 0.0, high_c = 0.0;  // temperature range of the data behind them
  Orders coefficient = Orders::Constant(std::numeric_limits<double>::quiet_NaN()), sigma = coefficient;  // NaN: none
  ParameterVector at(const ParameterVector& reference, double temperature_c) const;  // clamped to the range
};

struct ParameterFile {
  ParameterVector parameters = to_vector(Parameters{});        // units and order: calib/model/parameters.h
  std::array<std::optional<double>, parameter_count> sigma{};  // the same units; empty: not estimated
  std::vector<EffectValue> effects;                            // in the order of being added
  std::optional<double> reference_temperature_c;               // reference temperature of the temperature effects
  std::optional<TemperaturePolynomials> temperature;           // keys temperature.*

  std::string unit_serial;
  std::string recording_hash;
  std::string model;   // base, extended
  std::string method;  // closed-form, joint
  std::string software_version;
  std::string time_utc;  // format_utc of imu_io/base/clock.h
  double latitude_deg = 0.0;
  double gravity_mps2 = 0.0;
  double sample_period_s = 0.0;
  IncrementKind gyro_increment = IncrementKind::pulses;
  IncrementKind accel_increment = IncrementKind::pulses;
  double accel_pulse_mps = 0.0;
  bool simulated = false;  // from simulated data: not for a real unit

  // Further keys in their order, for noise estimates and records. Each begins with one of further_key_prefixes.
  std::vector<std::pair<std::string, std::string>> further;

  void add_further(std::string key, std::string value) { further.emplace_back(std::move(key), std::move(value)); }
  void add_further(std::string key, double value);
};

inline constexpr std::array<std::string_view, 4> further_key_prefixes = {"noise.", "quality.", "record.", "verdict."};

// Copies the site, unit and increments of a recording.
void describe_recording(const RecordingInfo& info, ParameterFile& file);

// Returns an error when a value is not finite, a text cannot be stored in the file, or a key occurs twice.
Result<std::string> format_parameter_file(const ParameterFile& file);
Status write_parameter_file(const ParameterFile& file, const std::string& path);

// The parameters that the calibration did not determine, as keys separated by blanks. Their values are meaningless.
inline constexpr std::string_view undetermined_key = "quality.undetermined";

// Returns the value of a further key, or null.
const std::string* find_further(const ParameterFile& file, std::string_view key);

// Reads a file for the record, whatever its contents.
Result<ParameterFile> parse_parameter_file(std::string_view text, const std::string& file_name);
// Reads a file for use: undetermined parameters are also an error.
Result<ParameterFile> read_parameter_file(const std::string& path);

// Returns the hash (hash_of_text) of the file without its `verdict.` lines and its checksum: it identifies what was verified, whatever the verdict.
Result<std::string> calibration_hash(ParameterFile file);

// Writes quality.trusted and quality.reason: whether the sigmas can be trusted, and if not, why. With an empty `why_not` a file with an
// undetermined parameter is still not trusted. Earlier statements of this kind in the file are replaced.
void describe_trust(const std::string& why_not, ParameterFile& file);
bool is_trusted(const ParameterFile& file);              // true if the file does not say
std::string why_not_trusted(const ParameterFile& file);  // empty: trusted

// Whether two recordings, or a recording and parameters, have the same sample rate. Each period was measured with its own clock: a crystal is off
// by up to 50 ppm, and a millisecond of jitter in time stamps over ten seconds is another 100 ppm. A difference of 200 ppm changes a rate by
// 200 ppm, and also a scale factor if the unit gives rates; counted increments do not change.
inline constexpr double sample_period_tolerance = 200e-6;
inline bool same_sample_period(double a_s, double b_s) { return std::abs(a_s - b_s) <= sample_period_tolerance * b_s; }

// Returns an error unless the parameters may be applied to this recording: same unit, same period (same_sample_period), same increments and pulse
// weight, and no simulated parameters on a real unit. `file_name` is for the message.
Status check_applicable(const ParameterFile& file, const std::string& file_name, const RecordingInfo& info);

// Return the file in other forms for navigation computers: a binary block with a checksum, a C header, YAML. Formats:
// docs/files.md. Numbers keep the values and units of the file; C and YAML have their shortest form that reads back as
// the same double. Every form says when a file is simulated or not trusted.
std::string format_parameter_block(const ParameterFile& file);
std::string format_parameter_header(const ParameterFile& file);
std::string format_parameter_yaml(const ParameterFile& file);

}  // namespace turncal
