#include "imu_io/recordings/recording_check.h"

#include <algorithm>
#include <cmath>
#include <iterator>

#include <fmt/format.h>

#include "calib/model/parameters.h"
#include "imu_io/base/clock.h"
#include "imu_io/base/text.h"

namespace turncal {
namespace {

Error defect(const std::string& where, const char* field, const std::string& value, const std::string& expected) {
  return input_error(where + ": " + field + " = '" + value + "': expected " + expected);
}

constexpr InertialUnit inertial_units[] = {{"rad", 1.0, false},
                                           {"deg", rad_per_deg, false},
                                           {"arcsec", rad_per_arcsec, false},
                                           {"rad/s", 1.0, true},
                                           {"deg/s", rad_per_deg, true},
                                           {"deg/h", radps_per_degph, true},
                                           {"mrad/s", 1e-3, true},
                                           {"mdeg/s", 1e-3 * rad_per_deg, true},
                                           {"m/s", 1.0, false},
                                           {"ft/s", 0.3048, false},
                                           {"m/s^2", 1.0, true},
                                           {"cm/s^2", 1e-2, true},
                                           {"g", standard_gravity_mps2, true},
                                           {"mg", 1e-3 * standard_gravity_mps2, true}};

// Up to the end of the year 9999.
constexpr NumberRange civil_time_s = between(0.0, 253402300799.0);

}  // namespace

void read_increments(KeyValueFile& file, IncrementKind& gyro, IncrementKind& accel) {
  gyro = file.one_of("gyro_increment", {"pulses", "rad"}) == "pulses" ? IncrementKind::pulses : IncrementKind::physical;
  accel =
      file.one_of("accel_increment", {"pulses", "mps"}) == "pulses" ? IncrementKind::pulses : IncrementKind::physical;
}

const InertialUnit* read_unit(KeyValueFile& file, const std::string& key, const std::vector<std::string>& names) {
  const std::string name = ascii_units(file.has(key) ? file.text(key) : file.one_of(key, names));
  if (std::ranges::find(names, name) == names.end()) {
    if (file.has(key)) file.reject(key, one_of(name, names));
    return nullptr;
  }
  const auto unit = std::find_if(std::begin(inertial_units), std::end(inertial_units),
                                 [&](const InertialUnit& u) { return u.name == name; });
  return unit == std::end(inertial_units) ? nullptr : unit;
}

std::array<double, 3> one_or_three(KeyValueFile& file, const std::string& key, double otherwise, const char* expected) {
  const std::vector<double> values = file.numbers_or(key, {otherwise});
  if (values.size() == 3) return {values[0], values[1], values[2]};
  if (values.size() != 1) file.reject(key, expected);
  const double value = values.size() == 1 ? values[0] : otherwise;
  return {value, value, value};
}

AxisOrder read_axes(KeyValueFile& file, const std::string& key, bool signs, const char* expected) {
  const std::string text = file.text_or(key, "+x, +y, +z");
  if (signs) file.list_or(key, {});  // rejects an empty part
  const std::vector<std::string_view> axes = split(text, ',');
  const auto signed_letter = [](std::string_view axis) { return axis.size() == 2; };
  const std::optional<AxisOrder> order = axis_order(text);
  if (order && (!signs || std::ranges::all_of(axes, signed_letter))) return *order;
  file.reject(key, expected);
  return {};
}

void read_range(KeyValueFile& file, const std::string& key, double& low, double& high, const char* expected) {
  const std::vector<double> range = file.numbers_or(key, {low, high}, 2);
  low = range[0];
  high = range[1];
  if (!(low < high)) file.reject(key, expected);
}

std::optional<std::int64_t> started_utc(KeyValueFile& file) {
  const std::string text = file.text_or("started_utc", "");
  if (text.empty()) return std::nullopt;
  const std::optional<double> utc_s = parse_utc(text);
  if (!utc_s) file.reject("started_utc", "a time as 2026-01-31T12:00:00Z");
  return utc_s ? std::optional(std::int64_t(*utc_s)) : std::nullopt;
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
  const NumberRange pulse =
      info.accel_increment == IncrementKind::pulses ? accel_pulse_range : between(0.0, accel_pulse_range.max);
  const struct {
    const char* name;
    double value;
    NumberRange range;
  } numbers[] = {{"sample_period_s", info.sample_period_s, sample_period_range},
                 {"latitude_deg", info.latitude_deg, site_latitude_deg},
                 {"gravity_mps2", info.gravity_mps2, recorded_gravity_mps2},
                 {"accel_pulse_mps", info.accel_pulse_mps, pulse}};
  for (const auto& [name, value, range] : numbers)
    if (!range.contains(value)) return defect(where, name, format_number(value), describe(range));
  if (info.started_utc_s && !civil_time_s.contains(double(*info.started_utc_s)))
    return defect(where, "started_utc", std::to_string(*info.started_utc_s) + " s", "a time from 1970 to 9999");
  return check_serial(info.unit_serial, where + ": unit_serial");
}

bool has_finite_angles(const Segment& segment) {
  return std::isfinite(segment.heading_deg) && std::isfinite(segment.pitch_deg) && std::isfinite(segment.roll_deg);
}

Status check_segments(const Segments& segments, std::int64_t first_counter, std::int64_t last_counter,
                      const std::function<std::string(std::size_t)>& where) {
  for (std::size_t i = 0; i < segments.size(); ++i) {
    const Segment& segment = segments[i];
    const auto refuse = [&](bool start, const std::string& expected) {
      return defect(where(i), start ? "start_sample" : "end_sample",
                    std::to_string(start ? segment.start_sample : segment.end_sample), expected);
    };
    if (i > 0 && segment.start_sample != segments[i - 1].end_sample)
      return refuse(true, fmt::format("{}, where the segment before ends", segments[i - 1].end_sample));
    if (segment.end_sample <= segment.start_sample)
      return refuse(false, fmt::format("more than start_sample, {}", segment.start_sample));
    if (segment.start_sample < first_counter)
      return refuse(true, fmt::format("at least the first sample, {}", first_counter));
    // Not compared with last_counter + 1, which can overflow.
    if (segment.end_sample - 1 > last_counter)
      return refuse(false, fmt::format("at most one more than the last sample, {}", last_counter));
    if (!has_finite_angles(segment)) return input_error(where(i) + ": an angle is not finite");
  }
  return {};
}

}  // namespace turncal
