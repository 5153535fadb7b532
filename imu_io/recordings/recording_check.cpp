#include "imu_io/recordings/recording_check.h"

#include <cmath>

#include "imu_io/base/clock.h"
#include "imu_io/base/format_number.h"
#include "imu_io/base/key_table.h"
#include "imu_io/base/text_pieces.h"

namespace turncal {
namespace {

Error defect(const std::string& where, const char* field, const std::string& value, const std::string& expected) {
  return input_error(where + ": " + field + " = '" + value + "': expected " + expected);
}

// To the end of the year 9999.
constexpr NumberRange civil_time_s = between(0.0, 253402300799.0);

}  // namespace

std::optional<std::int64_t> started_utc(KeyValueFile& file) {
  const std::string text = file.text_or("started_utc", "");
  if (text.empty()) return std::nullopt;
  const std::optional<double> utc_s = parse_utc(text);
  if (!utc_s) file.reject("started_utc", "a time as 2026-01-31T12:00:00Z");
  return utc_s ? std::optional(static_cast<std::int64_t>(*utc_s)) : std::nullopt;
}

bool is_plain_text(const std::string& text) {
  if (text.empty() || text.front() == ' ' || text.back() == ' ') return false;
  for (std::string_view remaining = text; !remaining.empty();) {
    const std::size_t length = printable_character(remaining);
    if (length == 0 || remaining.front() == '#') return false;
    remaining.remove_prefix(length);
  }
  return true;
}

Status check_serial(const std::string& serial, const std::string& where) {
  constexpr std::size_t longest = 200, shown = 60;
  if (is_plain_text(serial) && serial.size() <= longest) return {};
  const std::string found = serial.size() > longest
                                ? quoted(serial.substr(0, shown)) + "..., " + std::to_string(serial.size()) + " bytes"
                                : quoted(serial);
  return input_error(where + " " + found + ": expected a serial number of 1 to " + std::to_string(longest) +
                     " bytes, printable characters without '#'");
}

Status check_info(const RecordingInfo& info, const std::string& where) {
  if (!sample_period_range.contains(info.sample_period_s)) {
    return defect(where, "sample_period_s", format_number(info.sample_period_s), describe(sample_period_range));
  }
  if (!site_latitude_deg.contains(info.latitude_deg)) {
    return defect(where, "latitude_deg", format_number(info.latitude_deg), "a number between -90 and 90");
  }
  if (!recorded_gravity_mps2.contains(info.gravity_mps2)) {
    return defect(where, "gravity_mps2", format_number(info.gravity_mps2), "a number between 9 and 11");
  }
  const NumberRange pulse =
      info.accel_increment == IncrementKind::pulses ? accel_pulse_range : between(0.0, accel_pulse_range.max);
  if (!pulse.contains(info.accel_pulse_mps)) {
    return defect(where, "accel_pulse_mps", format_number(info.accel_pulse_mps), describe(pulse));
  }
  if (info.started_utc_s && !civil_time_s.contains(static_cast<double>(*info.started_utc_s)))
    return defect(where, "started_utc", std::to_string(*info.started_utc_s) + " s", "a time from 1970 to 9999");
  return check_serial(info.unit_serial, where + ": unit_serial");
}

Status check_segments(const Segments& segments, std::int64_t first_counter, std::int64_t last_counter,
                      const std::function<std::string(std::size_t)>& where) {
  for (std::size_t i = 0; i < segments.size(); ++i) {
    const Segment& segment = segments[i];
    const std::string start = std::to_string(segment.start_sample);
    const std::string end = std::to_string(segment.end_sample);
    if (i > 0 && segment.start_sample != segments[i - 1].end_sample) {
      return defect(where(i), "start_sample", start,
                    std::to_string(segments[i - 1].end_sample) + ", where the segment before ends");
    }
    if (segment.end_sample <= segment.start_sample) {
      return defect(where(i), "end_sample", end, "more than start_sample, " + start);
    }
    if (segment.start_sample < first_counter) {
      return defect(where(i), "start_sample", start, "at least the first sample, " + std::to_string(first_counter));
    }
    // Not last_counter + 1, which can overflow.
    if (segment.end_sample - 1 > last_counter) {
      return defect(where(i), "end_sample", end,
                    "at most one more than the last sample, " + std::to_string(last_counter));
    }
    if (!std::isfinite(segment.heading_deg) || !std::isfinite(segment.pitch_deg) || !std::isfinite(segment.roll_deg)) {
      return input_error(where(i) + ": an angle is not finite");
    }
  }
  return {};
}

}  // namespace turncal
