#include "orchestrator/station_config.h"

#include <filesystem>

#include "imu_io/format_number.h"
#include "imu_io/key_value.h"

namespace turncal {

namespace {

constexpr double longest_time_s = 3600.0;  // of any time in the file; more is a typing mistake
constexpr NumberRange some_time{0.0, longest_time_s, true};
constexpr NumberRange time_or_zero{0.0, longest_time_s};
constexpr NumberRange angle{-3600.0, 3600.0};

void read_axes(KeyValueFile& file, std::array<AxisLimits, 3>& axes) {
  for (const Axis axis : all_axes) {
    AxisLimits& limit = axes[static_cast<std::size_t>(axis)];
    const std::string prefix = "axis." + std::string(to_string(axis)) + ".";
    limit.soft_min_deg = file.number_or(prefix + "soft_min_deg", limit.soft_min_deg, angle);
    limit.soft_max_deg = file.number_or(prefix + "soft_max_deg", limit.soft_max_deg, angle);
    limit.max_rate_degps = file.number_or(prefix + "max_rate_degps", limit.max_rate_degps, positive);
    limit.max_acceleration_degps2 =
        file.number_or(prefix + "max_acceleration_degps2", limit.max_acceleration_degps2, positive);
    limit.wrap_deg = file.number_or(prefix + "wrap_deg", limit.wrap_deg, not_negative);
  }
}

void read_motion(KeyValueFile& file, MotionConfig& motion) {
  motion.position_tolerance_deg =
      file.number_or("motion.position_tolerance_deg", motion.position_tolerance_deg, {0.0, 1.0, true});
  motion.settle_rate_degps = file.number_or("motion.settle_rate_degps", motion.settle_rate_degps, {0.0, 1.0, true});
  motion.settle_s = file.number_or("motion.settle_s", motion.settle_s, time_or_zero);
  motion.poll_moving_s = file.number_or("motion.poll_moving_s", motion.poll_moving_s, some_time);
  motion.poll_idle_s = file.number_or("motion.poll_idle_s", motion.poll_idle_s, some_time);
  motion.stall_s = file.number_or("motion.stall_s", motion.stall_s, some_time);
  motion.deadline_margin_s = file.number_or("motion.deadline_margin_s", motion.deadline_margin_s, some_time);
}

void read_dwell(KeyValueFile& file, DwellConfig& dwell) {
  dwell.max_repeats = static_cast<int>(file.integer_or("dwell.max_repeats", dwell.max_repeats, 0, 100));
  dwell.stillness_window_s = file.number_or("dwell.stillness_window_s", dwell.stillness_window_s, between(0.1, 60.0));
  dwell.max_gyro_std_degps = file.number_or("dwell.max_gyro_std_degps", dwell.max_gyro_std_degps, positive);
  dwell.max_gyro_peak_degps = file.number_or("dwell.max_gyro_peak_degps", dwell.max_gyro_peak_degps, positive);
  dwell.max_accel_std_mps2 = file.number_or("dwell.max_accel_std_mps2", dwell.max_accel_std_mps2, positive);
  dwell.max_accel_peak_mps2 = file.number_or("dwell.max_accel_peak_mps2", dwell.max_accel_peak_mps2, positive);
}

// Two keys that cannot both be meant. One may stand at its default, so the line names the one that is in the file and
// shows the other's value.
void contradiction(KeyValueFile& file, const std::string& key, double value, const std::string& relation,
                   const std::string& other_key, double other_value) {
  const std::string suffix = file.has(other_key) ? "" : ", its default";
  if (file.has(key)) {
    file.reject(key, "a number " + relation + " " + other_key + " (" + format_number(other_value) + suffix + ")");
  } else {
    file.reject(other_key, "a number such that " + key + " (" + format_number(value) + ", its default) is " + relation +
                               " it");
  }
}

void reject_contradictions(KeyValueFile& file, const StationConfig& station) {
  const auto require = [&file](bool good, const std::string& key, double value, const std::string& relation,
                               const std::string& other_key, double other_value) {
    if (!good) {
      contradiction(file, key, value, relation, other_key, other_value);
    }
  };
  for (const Axis axis : all_axes) {
    const AxisLimits& limit = station.axis[static_cast<std::size_t>(axis)];
    const std::string prefix = "axis." + std::string(to_string(axis)) + ".";
    require(limit.soft_min_deg < limit.soft_max_deg, prefix + "soft_min_deg", limit.soft_min_deg, "below",
            prefix + "soft_max_deg", limit.soft_max_deg);
  }
  const MotionConfig& motion = station.motion;
  require(motion.poll_moving_s <= motion.poll_idle_s, "motion.poll_moving_s", motion.poll_moving_s, "not above",
          "motion.poll_idle_s", motion.poll_idle_s);
  // Progress can only be seen between two polls.
  require(motion.stall_s >= 2.0 * motion.poll_moving_s, "motion.stall_s", motion.stall_s, "at least twice",
          "motion.poll_moving_s", motion.poll_moving_s);
  // The settling happens inside the margin.
  require(motion.deadline_margin_s > motion.settle_s, "motion.deadline_margin_s", motion.deadline_margin_s, "above",
          "motion.settle_s", motion.settle_s);
  const DwellConfig& dwell = station.dwell;
  require(dwell.max_gyro_peak_degps >= dwell.max_gyro_std_degps, "dwell.max_gyro_peak_degps",
          dwell.max_gyro_peak_degps, "not below", "dwell.max_gyro_std_degps", dwell.max_gyro_std_degps);
  require(dwell.max_accel_peak_mps2 >= dwell.max_accel_std_mps2, "dwell.max_accel_peak_mps2",
          dwell.max_accel_peak_mps2, "not below", "dwell.max_accel_std_mps2", dwell.max_accel_std_mps2);
}

bool is_date(const std::string& text) {
  if (text.size() != 10 || text[4] != '-' || text[7] != '-') return false;
  const auto month = parse_integer<int>(text.substr(5, 2)), day = parse_integer<int>(text.substr(8, 2));
  return parse_integer<int>(text.substr(0, 4)) && month && *month >= 1 && *month <= 12 && day && *day >= 1 && *day <= 31;
}

Result<StationConfig> station_from(KeyValueFile& file) {
  StationConfig station;
  station.file = file.file_name();
  file.integer("format", 1, 1);
  station.name = file.text_or("station.name", "unnamed");
  station.latitude_deg = file.number("site.latitude_deg", between(-90.0, 90.0));
  station.gravity_mps2 = file.number("site.gravity_mps2", between(9.7, 9.9));  // anywhere on the earth's surface
  file.one_of("table.driver", {"mock"});
  file.one_of("imu.driver", {"rig"});
  station.imu_timeout_s = file.number_or("imu.timeout_s", station.imu_timeout_s, some_time);
  read_axes(file, station.axis);
  read_motion(file, station.motion);
  read_dwell(file, station.dwell);
  station.resume_rest_s = file.number_or("resume.rest_s", station.resume_rest_s, {0.0, 86400.0});
  station.limits = read_limits(file);
  station.hooks.done = file.text_or("hook.done", "");
  station.hooks.fail = file.text_or("hook.fail", "");
  station.hooks.needs_operator = file.text_or("hook.needs_operator", "");
  station.table_id = file.text_or("table.id", "");
  station.table_calibration_due = file.text_or("table.calibration_due", "");
  if (!station.table_calibration_due.empty() && !is_date(station.table_calibration_due)) {
    file.reject("table.calibration_due", "a day as 2026-12-31");
  }
  const auto beside = [&file, &station](const char* key) -> std::string {
    if (!file.has(key)) return "";
    return (std::filesystem::path(station.file).parent_path() / file.text(key)).string();
  };
  station.rig_file = beside("rig.file");
  station.database = beside("record.database");
  station.store = beside("record.store");
  // An unknown key first: a misspelt one would show up as a contradiction with a default.
  if (Status status = file.check_all_used(); !status) {
    return status.error();
  }
  reject_contradictions(file, station);
  if (Status status = file.status(); !status) {
    return status.error();
  }
  return station;
}

}  // namespace

StationConfig default_station_config() {
  StationConfig station;
  station.latitude_deg = 29.53;
  station.gravity_mps2 = 9.7914;
  station.motion.settle_s = 0.5;
  return station;
}

Result<StationConfig> read_station_config(const std::string& path) {
  Result<KeyValueFile> file = KeyValueFile::read(path);
  if (!file) {
    return file.error();
  }
  return station_from(*file);
}

Result<StationConfig> parse_station_config(const std::string& text, const std::string& file_name) {
  Result<KeyValueFile> file = KeyValueFile::parse(text, file_name);
  if (!file) {
    return file.error();
  }
  return station_from(*file);
}

PlanLimits plan_limits(const StationConfig& station, double sample_period_s) {
  PlanLimits limits;
  limits.axis = station.axis;
  limits.settle_s = station.motion.settle_s;
  limits.sample_period_s = sample_period_s;
  return limits;
}

}  // namespace turncal
