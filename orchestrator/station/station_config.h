// The station: site, table, IMU and the numbers that judge motion and dwells. Read from a text file
// (orchestrator/stations/mock.station shows every key); the built-in rig station needs no file.
//
// Units as the suffix says: degrees, deg/s, deg/s^2, seconds, m/s^2. Every value has a default except the format, the site and the two
// drivers. An unknown key, a value out of range or a contradiction is an error of one line that names file, line and key.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "calib/types/status.h"
#include "imu_io/units/serial_imu.h"
#include "orchestrator/station/child_program.h"
#include "orchestrator/station/verdict.h"
#include "sequences/plan.h"
#include "turntable_drivers/ascii/dialect.h"
#include "turntable_drivers/chamber/described_chamber.h"
#include "turntable_drivers/manual/manual_turntable.h"
#include "turntable_drivers/modbus/register_map.h"

namespace turncal {

// A results database: the path of a file, or postgresql://USER@HOST:PORT/NAME for a server (docs/fleet.md).
bool names_a_server(const std::string& database);
// Returns whether `path` names a server or an existing SQLite file.
bool names_a_database(const std::string& path);

// Returns an input error when the name of a server contains a password: files and the list of processes would show it. The message does
// not repeat it.
Status check_database_name(const std::string& database);

enum class TableDriver {
  mock,    // the rig's own table: dry runs only
  modbus,  // table.map
  serial,  // table.dialect
  manual   // turned by hand
};

// Limits that decide when a move has arrived and when it is late, and how often the table is polled.
struct MotionConfig {
  double position_tolerance_deg = 0.01;  // abs(position - target)
  double settle_rate_degps = 0.01;       // abs(rate) below this for settle_s
  double settle_s = 1.0;
  double poll_moving_s = 0.1;
  double poll_idle_s = 0.5;
  double stall_s = 2.0;             // no progress for this long while commanded
  double deadline_margin_s = 10.0;  // deadline = angle/rate + 2 rate/acceleration + margin
};

// Limits that decide whether a dwell counts. Stillness is judged on the means of the IMU's own rates and specific forces over consecutive windows of
// stillness_window_s: their standard deviation over the dwell, and the largest deviation of one from the dwell's mean.
// (Means, because one pulse of a laser gyro in one 5 ms sample already amounts to 0.05 deg/s.)
struct DwellConfig {
  int max_repeats = 2;  // of one dwell, not counting the first attempt
  double stillness_window_s = 1.0;
  double max_gyro_std_degps = 0.002;
  double max_gyro_peak_degps = 0.01;
  double max_accel_std_mps2 = 0.005;
  double max_accel_peak_mps2 = 0.02;
};

// Minutes that a run may add to tell confounded effects apart (docs/sequences.md).
inline constexpr NumberRange settling_minutes = zero_or(1.0, 60.0);

// How the station reaches its table; orchestrator/devices/live_devices.h creates it. table.simulated: a twin answers, recordings are marked,
// and no production file is made from them.
struct TableConfig {
  TableDriver driver = TableDriver::mock;
  std::optional<RegisterMap> map;  // modbus; table.address, where given, replaces its link.address
  std::optional<Dialect> dialect;  // serial; likewise
  ManualSettings manual;
  bool simulated = false;

  // The description of the table and its link, from its map or dialect; null when it has neither.
  const TableDescription* described() const {
    return map ? static_cast<const TableDescription*>(&*map) : dialect ? &*dialect : nullptr;
  }
  const TableLinkSettings* link() const {
    return map ? static_cast<const TableLinkSettings*>(&map->link) : dialect ? &dialect->link : nullptr;
  }
};

// The temperature chamber around the unit: docs/thermal.md.
struct ChamberConfig {
  ChamberDescription described;         // chamber.file; chamber.address, where given, replaces its address
  std::optional<double> temperature_c;  // set point of a run; empty: the run leaves the chamber alone
  double limit_unit_c = 0.0;            // heaters go off when the unit's own thermometer reads more
  double band_c = 0.5;                  // half-width, about the set point
  double settle_s = 1800.0;             // time within the band until it counts as settled
  double settle_limit_s = 14400.0;      // a fault when it has not settled by then
};

// Who calibrates, for whom, and how well the site is known; used by the certificate alone (docs/report.md). Empty: not given.
struct Parties {
  std::string laboratory_name, laboratory_address, laboratory_accreditation, laboratory_signatory;
  std::string customer_name, customer_address, customer_order;
  double gravity_uncertainty_mps2 = 0.0, latitude_uncertainty_deg = 0.0;  // standard uncertainties
};

struct StationConfig {
  std::string file;   // empty: built in
  KeyValueFile keys;  // of that file, for messages
  std::string name = "built-in rig";
  double latitude_deg = 0.0;
  double gravity_mps2 = 0.0;
  TableConfig table;
  std::optional<ChamberConfig> chamber;
  // imu.driver = serial: units on serial lines, of which this is the first. imu.driver = rig: empty; the rig's own unit, for dry runs only.
  std::optional<SerialImuConfig> imu;
  std::vector<std::string> further_imu_devices;  // lines of the places 2, 3, ... with the same frame and settings
  double clock_speed_up = 1.0;                   // station seconds per second of wall clock; 1 unless twins answer
  std::array<AxisLimits, 3> axis{};              // indexed by Axis
  MotionConfig motion;
  DwellConfig dwell;
  double imu_timeout_s = 2.0;    // no sample for this long: the link is lost
  double resume_rest_s = 600.0;  // after an interruption, before the first dwell, to warm up
  HookCommands hooks;
  VerdictLimits limits;
  StopSigmas stop_sigma{};      // when a run may end early
  double settle_minutes = 0.0;  // that a run may add to separate confounded effects; 0: none
  DiagnosisPolicy diagnosis;
  bool verify_run = false;  // a north seeking follows every calibration (docs/verification.md)
  Parties parties;
  std::string table_id;  // for the record; empty: not given
  std::string
      table_calibration_due;  // "2026-12-31"; a run after that day is refused unless overridden; empty: not given
  std::string database;       // results database; empty: none; a file is relative to the station file's folder
  std::string outbox;         // for a server: the file that keeps rows until the server has them
  std::string store;          // parameter files in use (parameter_store.h); path as above
  std::string rig_file;       // empty: the built-in rig configuration; relative to the station file's folder
  std::size_t imu_places() const { return imu ? 1 + further_imu_devices.size() : 0; }
  SerialImuSettings imu_settings(std::size_t place) const;  // from 0; only the first unit may have imu.unit_serial
  // Returns whether a twin stands in for the table or the unit of a live run.
  bool simulated() const { return table.simulated || (imu && imu->settings.simulated); }
};

// The built-in station of a dry run: 29.53 deg, 9.7914 m/s^2, mock table and rig IMU, settle_s 0.5, limit.heading_deg 0.1.
StationConfig default_station_config();

// Returns an error unless the limits of chamber and unit allow that temperature.
Status check_temperature(const ChamberConfig& chamber, double temperature_c);

Result<StationConfig> read_station_config(const std::string& path);  // empty: the built-in one
Result<StationConfig> parse_station_config(const std::string& text, const std::string& file_name);

// Returns what the planner needs to know of a station.
PlanLimits plan_limits(const StationConfig& station, double sample_period_s);

// The fourteen steps and the north seeking, compiled in so that the program runs wherever it is copied. The texts are those of
// sequences/fourteen_step.seq and sequences/verify.seq at build time.
extern const std::string_view builtin_sequence_text;
inline constexpr const char* builtin_sequence_name = "built-in fourteen_step.seq";

extern const std::string_view builtin_verify_text;
// In place of a file name, on the command line or in a journal, these names mean the built-in texts.
inline constexpr const char* builtin_verify_name = "built-in verify.seq";

}  // namespace turncal
