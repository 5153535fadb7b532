// What every recording must fulfil, whoever writes or reads it. Messages name the field; the caller puts the file in
// front.
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

// What a unit can send, in s: 100 kHz at most. What a pulse of an accelerometer can weigh, in m/s.
inline constexpr NumberRange sample_period_range = between(1e-5, 10.0);
inline constexpr NumberRange accel_pulse_range = between(1e-9, 10.0);

// Counters stay within +-max_counter, so that differences and ends cannot overflow.
inline constexpr std::int64_t max_counter = std::int64_t{1} << 62;
constexpr bool is_counter(std::int64_t value) { return value >= -max_counter && value <= max_counter; }
inline constexpr const char* counter_words = "a whole number of at most 2^62 either way";

// The required keys gyro_increment and accel_increment.
void read_increments(KeyValueFile& file, IncrementKind& gyro, IncrementKind& accel);

// A unit of increments or rates, and what one is in SI.
struct InertialUnit {
  std::string_view name;
  double si;
  bool is_rate;
};
// The unit at a required key; null where none of `names` is there, a defect, and for one of them that is no unit ("pulses").
const InertialUnit* read_unit(KeyValueFile& file, const std::string& key, const std::vector<std::string_view>& names);

// One number, which stands for three, or three. `expected` is what a message says of others, as below.
std::array<double, 3> one_or_three(KeyValueFile& file, const std::string& key, double otherwise, const char* expected);
// Body axes by axis_order(); x, y, z where the key is missing. `signs`: each has one.
AxisOrder read_axes(KeyValueFile& file, const std::string& key, bool signs, const char* expected);
// Two numbers, the first the lower; where the key is missing they stay as they are.
void read_range(KeyValueFile& file, const std::string& key, double& low, double& high, const char* expected);

// The key of that name, if it is there: when the first sample came. Another text than a time is rejected.
std::optional<std::int64_t> started_utc(KeyValueFile& file);

// Period, latitude, gravity, pulse weight, serial. `where` begins every message ("recording.conf").
Status check_info(const RecordingInfo& info, const std::string& where);

bool has_finite_angles(const Segment& segment);

// Segments contiguous, not empty, angles finite, inside the samples first_counter..last_counter. No segment at all is
// accepted: a recording may still have to be segmented. where(i) begins the message on segment i ("segments.csv:7").
Status check_segments(const Segments& segments, std::int64_t first_counter, std::int64_t last_counter,
                      const std::function<std::string(std::size_t)>& where);

// A serial or other short text that can stand as a value in a text file: not empty, printable, no '#', no blank at an
// end.
bool is_plain_text(const std::string& text);

// A serial number: such a text of 200 bytes at most. `where` begins the message.
Status check_serial(const std::string& serial, const std::string& where);

}  // namespace turncal
