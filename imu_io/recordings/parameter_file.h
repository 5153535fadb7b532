// The result of a calibration as a file: the 24 parameters, their standard deviations, added effects, and what is
// needed to know what they belong to. Format: docs/files.md.
//
// Writing what was read gives the same bytes: numbers are written in their shortest round-trip form, in fixed order;
// the last line is a checksum (crc.h).
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

// The parameters at other temperatures (docs/thermal.md): p + c_1 x + c_2 x^2 + c_3 x^3, x = T - reference_c, p the 24 of the file.
struct TemperaturePolynomials {
  using Orders = Eigen::Matrix<double, parameter_count, 3>;
  double reference_c = 0.0, low_c = 0.0, high_c = 0.0;  // the range that they were made from
  Orders coefficient = Orders::Constant(std::numeric_limits<double>::quiet_NaN()), sigma = coefficient;  // NaN: none
  ParameterVector at(const ParameterVector& reference, double temperature_c) const;  // clamped to the range
};

struct ParameterFile {
  ParameterVector parameters = to_vector(Parameters{});        // units and order: calib/model/parameters.h
  std::array<std::optional<double>, parameter_count> sigma{};  // the same units; empty: not estimated
  std::vector<EffectValue> effects;                            // in the order in which they were added
  std::optional<double> reference_temperature_c;               // what temperature effects are referred to
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
  bool simulated = false;  // made from simulated data: not for a real unit

  // Further keys in order, for noise estimates and records. Each begins with one of further_key_prefixes.
  std::vector<std::pair<std::string, std::string>> further;

  void add_further(std::string key, std::string value) { further.emplace_back(std::move(key), std::move(value)); }
  void add_further(std::string key, double value);
};

inline constexpr std::array<std::string_view, 4> further_key_prefixes = {"noise.", "quality.", "record.", "verdict."};

// The site, unit and increments of a recording, taken over.
void describe_recording(const RecordingInfo& info, ParameterFile& file);

// An error when a value is not finite, a text cannot stand in the file, or a key occurs twice.
Result<std::string> format_parameter_file(const ParameterFile& file);
Status write_parameter_file(const ParameterFile& file, const std::string& path);

// What a calibration did not determine, keys with a space between: such a value means nothing by itself.
inline constexpr std::string_view undetermined_key = "quality.undetermined";

// The value of a further key; null where there is none.
const std::string* find_further(const ParameterFile& file, std::string_view key);

// For the record: whatever was written.
Result<ParameterFile> parse_parameter_file(std::string_view text, const std::string& file_name);
// To be used: an error, too, where parameters are not determined.
Result<ParameterFile> read_parameter_file(const std::string& path);

// What was judged, whatever the verdict then said: the hash (hash_of_text) of the file without its lines `verdict.` and `checksum`.
Result<std::string> calibration_hash(ParameterFile file);

// Whether the sigmas can be believed, and why not where they cannot: quality.trusted, quality.reason. An empty `why_not` of a file in which a
// parameter is not determined is not trusted either. What the file said of it before is replaced.
void describe_trust(const std::string& why_not, ParameterFile& file);
bool is_trusted(const ParameterFile& file);              // true where the file does not say
std::string why_not_trusted(const ParameterFile& file);  // empty: it is

// Whether two recordings, or one and parameters, are of one sample rate. Each period is measured by a clock of its own, a crystal that is off by
// up to 50 ppm, and by stamps: a millisecond of jitter over ten seconds is another 100 ppm. What a difference of 200 ppm does: the same share of
// a rate, and of a scale factor where the unit gives rates; nothing to increments that are counted.
inline constexpr double sample_period_tolerance = 200e-6;
inline bool same_sample_period(double a_s, double b_s) { return std::abs(a_s - b_s) <= sample_period_tolerance * b_s; }

// Whether the parameters may be applied to this recording: same unit, same period (same_sample_period), increments and pulse weight, and not
// simulated parameters on a real unit. `file_name` is for the message.
Status check_applicable(const ParameterFile& file, const std::string& file_name, const RecordingInfo& info);

// In other forms, for whoever loads it into a navigation computer: a C header, a binary block with a checksum, YAML. Formats:
// docs/files.md. All numbers are those of the file, in its units; C and YAML have them in the shortest form that reads back as
// the same double. Simulated and untrusted files say so in every form.
std::string format_parameter_block(const ParameterFile& file);
std::string format_parameter_header(const ParameterFile& file);
std::string format_parameter_yaml(const ParameterFile& file);

}  // namespace turncal
