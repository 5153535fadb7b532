// The checks that every recording must pass, whoever writes or reads it. Messages name the field; the caller puts the file
// before it.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "calib/types/axis.h"
#include "calib/types/recording_types.h"
#include "calib/types/status.h"
#include "imu_io/base/key_value.h"

namespace turncal {

// The sample period of a unit in s, for at most 100 kHz, and the weight of an accelerometer pulse in m/s.
inline constexpr NumberRange sample_period_range = between(1e-5, 10.0);
inline constexpr NumberRange accel_pulse_range = between(1e-9, 10.0);

// Counters stay within +-max_counter, so that differences and segment ends cannot overflow.
inline constexpr std::int64_t max_counter = std::int64_t{1} << 62;
constexpr bool is_counter(std::int64_t value) { return value >= -max_counter && value <= max_counter; }
inline constexpr const char* counter_words = "a whole number of at most 2^62 either way";

// Reads the required keys gyro_increment and accel_increment.
void read_increments(KeyValueFile& file, IncrementKind& gyro, IncrementKind& accel);

// A unit of increments or rates, and its value in SI.
struct InertialUnit {
  std::string_view name;
  double si;
  bool is_rate;
};
// Reads a required unit. Returns null for a word that is not in `names`, which is a defect, and for one that is no unit ("pulses").
const InertialUnit* read_unit(KeyValueFile& file, const std::string& key, const std::vector<std::string>& names);

// Reads three numbers, or one that stands for all three. `expected` is the message for anything else, also below.
std::array<double, 3> one_or_three(KeyValueFile& file, const std::string& key, double otherwise, const char* expected);
// Reads the body axes with axis_order(); x, y, z if the key is missing. `signs`: each axis needs a sign.
AxisOrder read_axes(KeyValueFile& file, const std::string& key, bool signs, const char* expected);
// Reads two numbers, the lower one first. If the key is missing they are left unchanged.
void read_range(KeyValueFile& file, const std::string& key, double& low, double& high, const char* expected);

// Reads the time of the first sample if the key is present. A value that is no time is rejected.
std::optional<std::int64_t> started_utc(KeyValueFile& file);

// Checks period, latitude, gravity, pulse weight and serial. `where` begins every message ("recording.conf").
Status check_info(const RecordingInfo& info, const std::string& where);

bool has_finite_angles(const Segment& segment);

// Checks that segments are contiguous, not empty, have finite angles and lie within first_counter..last_counter. An empty list is
// valid: the recording may not be segmented yet. where(i) begins the message on segment i ("segments.csv:7").
Status check_segments(const Segments& segments, std::int64_t first_counter, std::int64_t last_counter,
                      const std::function<std::string(std::size_t)>& where);

// True for a serial or other short text that can be a value in a text file: not empty, printable, without '#' and without
// blanks at its ends.
bool is_plain_text(const std::string& text);

// Checks a serial number: a plain text of at most 200 bytes. `where` begins the message.
Status check_serial(const std::string& serial, const std::string& where);

}  // namespace turncal
