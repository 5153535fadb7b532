#include "orchestrator/station/station_config.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <limits>

#include "imu_io/base/clock.h"
#include "imu_io/base/file_kind.h"
#include "imu_io/base/key_value.h"
#include "imu_io/base/text.h"

namespace turncal {

bool names_a_server(const std::string& database) {
  return database.starts_with("postgresql://") || database.starts_with("postgres://");
}

bool names_a_database(const std::string& path) {
  if (names_a_server(path)) return true;
  constexpr std::string_view magic = "SQLite format 3";
  std::string begin(magic.size(), ' ');
  std::error_code error;
  return std::filesystem::is_regular_file(path, error) &&
         std::ifstream(path, std::ios::binary).read(begin.data(), static_cast<std::streamsize>(begin.size())) &&
         begin == magic;
}

Status check_database_name(const std::string& database) {
  if (!names_a_server(database)) return {};
  const std::string address = database.substr(database.find("//") + 2);
  // User and password end at the last @, even when a slash in them was not written as %2F.
  const std::string user = address.substr(0, address.rfind('@') == std::string::npos ? 0 : address.rfind('@'));
  if (user.find(':') == std::string::npos && address.find("password=") == std::string::npos) return {};
  return input_error(
      "postgresql://...: a password in the name of a results database: expected postgresql://USER@HOST/NAME, and the "
      "password in ~/.pgpass, in the file that PGPASSFILE names, or in PGPASSWORD");
}

namespace {

constexpr double longest_time_s = 3600.0;  // for any time in the file; more is a typing mistake
constexpr std::size_t most_imu_places = 16;
constexpr NumberRange some_time{0.001, longest_time_s};
constexpr NumberRange time_or_zero = zero_or(some_time.min, some_time.max);
constexpr NumberRange angle{-3600.0, 3600.0};
// Wide limits that no real table or unit exceeds.
constexpr NumberRange some_rate{0.001, 1e4};
constexpr NumberRange some_acceleration{0.001, 1e6};
constexpr NumberRange winding = zero_or(1.0, 1e6);
constexpr NumberRange fine{1e-6, 1.0};  // deg or deg/s; no encoder resolves less
constexpr NumberRange stillness{1e-9, 100.0};

// Rejects an address that does not fit the link of `device` ("table" or "chamber"). `described`: the key to name when DEVICE.address is not given.
void check_address(KeyValueFile& file, const std::string& device, const std::string& described,
                   const TableLinkSettings& link) {
  if (link.tcp ? parse_line("tcp:" + link.address).has_value() : link.address.starts_with('/')) return;
  file.reject(file.has(device + ".address") ? device + ".address" : described,
              "a " + device + " at " + (link.tcp ? "HOST:PORT" : "a serial device, /dev/serial/by-id/...") +
                  ", not at " + link.address);
}

// Reads the table's keys. Errors in a map or dialect name that file and its line; errors in this file are kept by `file`.
Status read_table(KeyValueFile& file, TableConfig& table) {
  const std::string driver = file.one_of("table.driver", {"mock", "modbus", "serial", "manual"});
  KeyTable keys(file);
  // Any table may be turned by hand (run --manual).
  ManualSettings& manual = table.manual;
  keys.number("table.tolerance_deg", manual.tolerance_deg, between(1e-6, 10.0));
  keys.number("table.gravity_tolerance_deg", manual.gravity_tolerance_deg, between(0.01, 90.0));
  keys.number("table.answer_timeout_s", manual.answer_timeout_s, between(1.0, 86400.0));
  keys.number("table.pause_limit_s", manual.pause_limit_s, between(1.0, 86400.0));
  manual.language = file.one_of_or("operator.language", manual.language,
                                   {std::begin(operator_languages), std::end(operator_languages)});
  if (driver == "mock" || driver.empty()) return {};
  keys.flag("table.simulated", table.simulated);
  if (driver == "manual") {
    table.driver = TableDriver::manual;
    return {};
  }
  std::string address;
  keys.text("table.address", address);
  const bool modbus = driver == "modbus";
  table.driver = modbus ? TableDriver::modbus : TableDriver::serial;
  const std::string described = modbus ? "table.map" : "table.dialect", path = file.file_named(described);
  if (path.empty()) return {};
  const auto take = [&](auto& description) {
    if (!address.empty()) description.link.address = address;
    if (!description.link.address.empty()) check_address(file, "table", described, description.link);
    description.simulated = table.simulated;
  };
  if (modbus)
    take(table.map.emplace(TRY(read_register_map(path))));
  else
    take(table.dialect.emplace(TRY(read_dialect(path))));
  return {};
}

Status read_chamber_keys(KeyValueFile& file, StationConfig& station) {
  if (!file.has("chamber.file")) return {};  // any other chamber key is then an unknown key
  ChamberConfig& chamber = station.chamber.emplace();
  const std::string path = file.file_named("chamber.file");
  if (path.empty()) return {};
  chamber.described = TRY(read_chamber(path));
  KeyTable keys(file);
  std::string address;
  keys.text("chamber.address", address);
  if (!address.empty()) chamber.described.reach(address);
  if (chamber.described.language != ChamberDescription::Language::rig)
    check_address(file, "chamber", "chamber.file", chamber.described.link());
  chamber.limit_unit_c = file.number("chamber.limit_unit_c", between(-200.0, 300.0));
  keys.number("chamber.temperature_c", chamber.temperature_c, between(-200.0, 300.0));
  keys.number("chamber.band_c", chamber.band_c, between(0.01, 20.0));
  keys.number("chamber.settle_s", chamber.settle_s, between(1.0, 86400.0));
  keys.number("chamber.settle_limit_s", chamber.settle_limit_s, between(1.0, 604800.0));
  if (chamber.settle_limit_s <= chamber.settle_s)
    file.reject(file.has("chamber.settle_limit_s") ? "chamber.settle_limit_s" : "chamber.settle_s",
                "a settle_limit_s above settle_s");
  if (chamber.temperature_c)
    if (const Status fits = check_temperature(chamber, *chamber.temperature_c); !fits)
      file.reject("chamber.temperature_c", fits.error().message);
  return {};
}

void read_axes(KeyTable& keys, std::array<AxisLimits, 3>& axes) {
  for (const Axis axis : all_axes) {
    AxisLimits& limit = axes[index(axis)];
    const std::string prefix = "axis." + std::string(to_string(axis)) + ".";
    keys.number(prefix + "soft_min_deg", limit.soft_min_deg, angle);
    keys.number(prefix + "soft_max_deg", limit.soft_max_deg, angle);
    keys.number(prefix + "max_rate_degps", limit.max_rate_degps, some_rate);
    keys.number(prefix + "max_acceleration_degps2", limit.max_acceleration_degps2, some_acceleration);
    keys.number(prefix + "wrap_deg", limit.wrap_deg, winding);
  }
}

void read_motion(KeyTable& keys, MotionConfig& motion) {
  keys.number("motion.position_tolerance_deg", motion.position_tolerance_deg, fine);
  keys.number("motion.settle_rate_degps", motion.settle_rate_degps, fine);
  keys.number("motion.settle_s", motion.settle_s, time_or_zero);
  keys.number("motion.poll_moving_s", motion.poll_moving_s, some_time);
  keys.number("motion.poll_idle_s", motion.poll_idle_s, some_time);
  keys.number("motion.stall_s", motion.stall_s, some_time);
  keys.number("motion.deadline_margin_s", motion.deadline_margin_s, some_time);
}

void read_dwell(KeyTable& keys, DwellConfig& dwell) {
  keys.whole("dwell.max_repeats", dwell.max_repeats, 0, 100);
  keys.number("dwell.stillness_window_s", dwell.stillness_window_s, between(0.1, 60.0));
  keys.number("dwell.max_gyro_std_degps", dwell.max_gyro_std_degps, stillness);
  keys.number("dwell.max_gyro_peak_degps", dwell.max_gyro_peak_degps, stillness);
  keys.number("dwell.max_accel_std_mps2", dwell.max_accel_std_mps2, stillness);
  keys.number("dwell.max_accel_peak_mps2", dwell.max_accel_peak_mps2, stillness);
}

// Rejects two keys that contradict each other. Either may be at its default: the message names the one that is in the file and shows
// the other's value.
void contradiction(KeyValueFile& file, const std::string& key, double value, const std::string& relation,
                   const std::string& other_key, double other_value) {
  const std::string suffix = file.has(other_key) ? "" : ", its default";
  if (file.has(key)) {
    file.reject(key, "a number " + relation + " " + other_key + " (" + format_number(other_value) + suffix + ")");
  } else {
    file.reject(other_key,
                "a number such that " + key + " (" + format_number(value) + ", its default) is " + relation + " it");
  }
}

void reject_contradictions(KeyValueFile& file, const StationConfig& station) {
  const auto require = [&file](bool good, const std::string& key, double value, const std::string& relation,
                               const std::string& other_key, double other_value) {
    if (!good) contradiction(file, key, value, relation, other_key, other_value);
  };
  for (const Axis axis : all_axes) {
    const AxisLimits& limit = station.axis[index(axis)];
    const std::string prefix = "axis." + std::string(to_string(axis)) + ".";
    require(limit.soft_min_deg < limit.soft_max_deg, prefix + "soft_min_deg", limit.soft_min_deg, "below",
            prefix + "soft_max_deg", limit.soft_max_deg);
  }
  const MotionConfig& motion = station.motion;
  require(motion.poll_moving_s <= motion.poll_idle_s, "motion.poll_moving_s", motion.poll_moving_s, "not above",
          "motion.poll_idle_s", motion.poll_idle_s);
  // Progress shows only between two polls.
  require(motion.stall_s >= 2.0 * motion.poll_moving_s, "motion.stall_s", motion.stall_s, "at least twice",
          "motion.poll_moving_s", motion.poll_moving_s);
  // The settling happens inside the margin.
  require(motion.deadline_margin_s > motion.settle_s, "motion.deadline_margin_s", motion.deadline_margin_s, "above",
          "motion.settle_s", motion.settle_s);
  const DwellConfig& dwell = station.dwell;
  require(dwell.max_gyro_peak_degps >= dwell.max_gyro_std_degps, "dwell.max_gyro_peak_degps", dwell.max_gyro_peak_degps,
          "not below", "dwell.max_gyro_std_degps", dwell.max_gyro_std_degps);
  require(dwell.max_accel_peak_mps2 >= dwell.max_accel_std_mps2, "dwell.max_accel_peak_mps2", dwell.max_accel_peak_mps2,
          "not below", "dwell.max_accel_std_mps2", dwell.max_accel_std_mps2);
}

// Rejects contradictions between the table's own file and the station's.
void reject_table_contradictions(KeyValueFile& file, const StationConfig& station) {
  const TableConfig& table = station.table;
  const TableDescription* const described = table.described();
  const double plausible_rate_degps =
      described ? described->plausible_rate_degps : std::numeric_limits<double>::infinity();
  for (const Axis axis : all_axes) {
    const AxisLimits& limit = station.axis[index(axis)];
    if (limit.max_rate_degps <= plausible_rate_degps) continue;
    const std::string key = "axis." + std::string(to_string(axis)) + ".max_rate_degps";
    if (file.has(key)) {
      file.reject(key,
                  "at most plausible.rate_degps of the table's file (" + format_number(plausible_rate_degps) + ")");
    } else {
      file.reject(table.map ? "table.map" : "table.dialect",
                  "a file whose plausible.rate_degps (" + format_number(plausible_rate_degps) + ") is not below " +
                      key + " (" + format_number(limit.max_rate_degps) + ", its default)");
    }
  }
  // Any position that the operator may enter has to count as arrived.
  if (table.driver == TableDriver::manual && station.motion.position_tolerance_deg < table.manual.tolerance_deg)
    contradiction(file, "motion.position_tolerance_deg", station.motion.position_tolerance_deg, "not below",
                  "table.tolerance_deg", table.manual.tolerance_deg);
  // Heartbeats go out with the polls; with slower polls the drive would stop in the first dwell.
  if (table.map && table.map->heartbeat_address && 2.0 * station.motion.poll_idle_s > table.map->watchdog_s)
    file.reject(file.has("motion.poll_idle_s") ? "motion.poll_idle_s" : "table.map",
                "motion.poll_idle_s (" + format_number(station.motion.poll_idle_s) +
                    ") at most half of heartbeat.watchdog_s of the map (" + format_number(table.map->watchdog_s) + ")");
}

// Only twins may run faster than real time, and all of a station at the same speed.
void reject_clock_contradictions(KeyValueFile& file, StationConfig& station) {
  const bool twins = station.table.simulated && station.imu && station.imu->settings.simulated;
  if (station.clock_speed_up != 1.0 && !twins)
    file.reject("clock.speed_up", "1 unless table.simulated and imu.simulated are true");
  if (!station.imu) return;
  if (station.imu_timeout_s <= station.imu->frame.sample_period_s)
    file.reject("imu.timeout_s", "more than the time between two samples of the frame, " +
                                     format_number(station.imu->frame.sample_period_s));
  if (file.has("imu.speedup") && station.imu->settings.speedup != station.clock_speed_up)
    file.reject("imu.speedup", "clock.speed_up (" + format_number(station.clock_speed_up) + ")");
  station.imu->settings.speedup = station.clock_speed_up;
}

// Reads imu.2.device, imu.3.device, ...: contiguous, and every line only once.
void read_further_places(KeyValueFile& file, StationConfig& station) {
  const auto key = [](std::size_t place) { return "imu." + std::to_string(place) + ".device"; };
  std::vector<std::string> taken = {station.imu->settings.device};
  for (std::size_t place = 2; place <= most_imu_places; ++place) {
    if (!file.has(key(place))) continue;
    const std::string device = file.text(key(place));
    if (!parse_line(device) && !device.empty()) file.reject(key(place), "a line as in imu.device");
    if (place != taken.size() + 1) {
      file.reject(key(place), key(taken.size() + 1) + " before it: places are numbered without a gap");
      return;
    }
    if (std::ranges::find(taken, device) != taken.end()) {
      file.reject(key(place), "a line that no other place has");
      return;
    }
    taken.push_back(device);
  }
  station.further_imu_devices.assign(taken.begin() + 1, taken.end());
}

void read_parties(KeyTable& keys, Parties& parties) {
  keys.text("laboratory.name", parties.laboratory_name);
  keys.text("laboratory.address", parties.laboratory_address);
  keys.text("laboratory.accreditation", parties.laboratory_accreditation);
  keys.text("laboratory.signatory", parties.laboratory_signatory);
  keys.text("customer.name", parties.customer_name);
  keys.text("customer.address", parties.customer_address);
  keys.text("customer.order", parties.customer_order);
  keys.number("site.gravity_uncertainty_mps2", parties.gravity_uncertainty_mps2, zero_or(1e-9, 0.1));
  keys.number("site.latitude_uncertainty_deg", parties.latitude_uncertainty_deg, between(0.0, 1.0));
}

Result<StationConfig> station_from(KeyValueFile& file) {
  StationConfig station;
  KeyTable keys(file);
  station.file = file.file_name();
  file.integer("format", 1, 1);
  station.name = file.has("station.name") ? file.text("station.name") : "unnamed";
  station.latitude_deg = file.number("site.latitude_deg", site_latitude_deg);
  station.gravity_mps2 = file.number("site.gravity_mps2", site_gravity_mps2);
  TRY(read_table(file, station.table));
  TRY(read_chamber_keys(file, station));
  if (file.one_of("imu.driver", {"rig", "serial"}) == "serial") {
    station.imu = TRY(read_serial_imu_config(file));
    read_further_places(file, station);
  }
  keys.number("clock.speed_up", station.clock_speed_up, between(0.01, 1000.0));
  keys.number("imu.timeout_s", station.imu_timeout_s, some_time);
  read_axes(keys, station.axis);
  read_motion(keys, station.motion);
  read_dwell(keys, station.dwell);
  keys.number("resume.rest_s", station.resume_rest_s, zero_or(some_time.min, 86400.0));
  station.limits = read_limits(file);
  station.stop_sigma = read_stop_sigmas(file);
  keys.number("settle.minutes", station.settle_minutes, settling_minutes);
  station.diagnosis = read_diagnosis_policy(file);
  for (const auto& [event, command] : hook_events) keys.text(std::string("hook.") + event, station.hooks.*command);
  keys.number("hook.mount_time_s", station.hooks.mount_time_s, between(1.0, 86400.0));
  read_parties(keys, station.parties);
  keys.flag("verify.run", station.verify_run);
  keys.text("table.id", station.table_id);
  keys.text("table.calibration_due", station.table_calibration_due);
  if (!station.table_calibration_due.empty() && !parse_utc(station.table_calibration_due + "T00:00:00Z"))
    file.reject("table.calibration_due", "a day of the calendar, as 2026-12-31");
  const auto path_of = [&file](const char* key) { return file.has(key) ? file.beside(file.text(key)) : std::string(); };
  station.rig_file = path_of("rig.file");
  station.database = path_of("record.database");
  station.outbox = path_of("record.outbox");
  if (const std::string server = file.text_or("record.database", ""); names_a_server(server)) {
    station.database = server;
    if (Status s = check_database_name(server); !s)  // not error_at(), which would print a password
      return input_error("{}:{}: record.database: {}", station.file, file.line_of("record.database"),
                         s.error().message);
    if (station.outbox.empty()) station.outbox = station.file + ".outbox.db";
  } else if (!station.outbox.empty()) {
    file.reject("record.outbox", "with a server only: record.database = postgresql://USER@HOST/NAME");
  }
  station.store = path_of("record.store");
  // Unknown keys are reported first: a misspelt key would otherwise show up as a contradiction with a default.
  TRY(file.check_all_used());
  reject_contradictions(file, station);
  reject_table_contradictions(file, station);
  reject_clock_contradictions(file, station);
  TRY(file.status());
  station.keys = file;
  return station;
}

}  // namespace

SerialImuSettings StationConfig::imu_settings(std::size_t place) const {
  SerialImuSettings settings = imu->settings;
  if (place == 0) return settings;
  settings.device = further_imu_devices[place - 1];
  settings.unit_serial.clear();
  return settings;
}

Status check_temperature(const ChamberConfig& chamber, double temperature_c) {
  if (temperature_c > chamber.limit_unit_c)
    return input_error(format_number(temperature_c) + " C: expected at most chamber.limit_unit_c (" +
                       format_number(chamber.limit_unit_c) + ")");
  return check_set_point(chamber.described.limits, temperature_c, chamber.described.limits.ramp_c_per_min);
}

StationConfig default_station_config() {
  StationConfig station;
  station.latitude_deg = 29.53;
  station.gravity_mps2 = 9.7914;
  station.motion.settle_s = 0.5;
  // 3 sigma of a 300 s alignment with the rig's gyros (0.002 deg/sqrt(h)) is 0.034 deg. The default is the paper's, for better gyros.
  station.limits.heading_deg = 0.1;
  return station;
}

Result<StationConfig> read_station_config(const std::string& path) {
  if (path.empty()) return default_station_config();
  TRY(expect_file(path, FileKind::station));
  KeyValueFile file = TRY(KeyValueFile::read(path));
  return station_from(file);
}

Result<StationConfig> parse_station_config(const std::string& text, const std::string& file_name) {
  KeyValueFile file = TRY(KeyValueFile::parse(text, file_name));
  return station_from(file);
}

PlanLimits plan_limits(const StationConfig& station, double sample_period_s) {
  PlanLimits limits{.axis = station.axis, .settle_s = station.motion.settle_s, .sample_period_s = sample_period_s};
  return limits;
}

}  // namespace turncal
