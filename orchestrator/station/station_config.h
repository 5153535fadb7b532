// The station: site, table, IMU and the numbers that judge motion and dwells. Read from a text file
// (orchestrator/stations/mock.station shows every key); the built-in rig station needs no file.
//
// Units as the suffix says: degrees, deg/s, deg/s^2, seconds, m/s^2. Every value has a default except format, those of the site and the two
// drivers. An unknown key, a value out of range and options that contradict each other are errors of one line that name file, line and key.
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
// A server's name, or the path of an SQLite file that is there.
bool names_a_database(const std::string& path);

// An input error, which does not repeat it, when a password is in the name of a server: it would be seen in files and by whoever lists
// the processes.
Status check_database_name(const std::string& database);

enum class TableDriver {
  mock,    // the rig's own table: dry runs only
  modbus,  // table.map
  serial,  // table.dialect
  manual   // turned by hand
};

// When a move has arrived, when it is late, and how often the table is asked.
struct MotionConfig {
  double position_tolerance_deg = 0.01;  // abs(position - target)
  double settle_rate_degps = 0.01;       // abs(rate) below this for settle_s
  double settle_s = 1.0;
  double poll_moving_s = 0.1;
  double poll_idle_s = 0.5;
  double stall_s = 2.0;             // no progress for this long while commanded
  double deadline_margin_s = 10.0;  // deadline = angle/rate + 2 rate/acceleration + margin
};

// When a dwell counts. Stillness is judged on the means of the IMU's own rates and accelerations over consecutive
// windows of stillness_window_s: their standard deviation over the dwell, and the largest distance of one from the
// dwell's mean.
// (Means, since one pulse of a laser gyro in one 5 ms sample is already 0.05 deg/s.)
struct DwellConfig {
  int max_repeats = 2;  // of one dwell, after the first attempt
  double stillness_window_s = 1.0;
  double max_gyro_std_degps = 0.002;
  double max_gyro_peak_degps = 0.01;
  double max_accel_std_mps2 = 0.005;
  double max_accel_peak_mps2 = 0.02;
};

// Minutes that a run may add to tell confounded effects apart (docs/sequences.md).
inline constexpr NumberRange settling_minutes = zero_or(1.0, 60.0);

// How the station reaches its table; orchestrator/devices/live_devices.h makes it. table.simulated says that a twin answers: recordings are
// marked and never make a production file.
struct TableConfig {
  TableDriver driver = TableDriver::mock;
  std::optional<RegisterMap> map;  // modbus; its link.address is table.address where that is given
  std::optional<Dialect> dialect;  // serial; the same
  ManualSettings manual;
  bool simulated = false;

  // What its map or dialect says, and its line; null: it has neither.
  const TableDescription* described() const {
    return map ? static_cast<const TableDescription*>(&*map) : dialect ? &*dialect : nullptr;
  }
  const TableLinkSettings* link() const {
    return map ? static_cast<const TableLinkSettings*>(&map->link) : dialect ? &dialect->link : nullptr;
  }
};

// A temperature chamber about the unit: docs/thermal.md.
struct ChamberConfig {
  ChamberDescription described;         // chamber.file, reached at chamber.address where that is given
  std::optional<double> temperature_c;  // of a run; empty: it leaves the chamber alone
  double limit_unit_c = 0.0;            // the unit warmer than that, by its own thermometer: heaters off
  double band_c = 0.5;                  // about the set point
  double settle_s = 1800.0;             // within the band for so long: settled
  double settle_limit_s = 14400.0;      // not settled after so long: a fault
};

// Who calibrates, for whom, and how well the site is known: for the certificate alone (docs/report.md). Empty: not given.
struct Parties {
  std::string laboratory_name, laboratory_address, laboratory_accreditation, laboratory_signatory;
  std::string customer_name, customer_address, customer_order;
  double gravity_uncertainty_mps2 = 0.0, latitude_uncertainty_deg = 0.0;  // standard uncertainties
};

struct StationConfig {
  std::string file;  // empty: built in
  std::string name = "built-in rig";
  double latitude_deg = 0.0;
  double gravity_mps2 = 0.0;
  TableConfig table;
  std::optional<ChamberConfig> chamber;
  // imu.driver = serial: units on serial lines, this one at the first place; rig: empty, the rig's own, coupled to its table, for dry runs only.
  std::optional<SerialImuConfig> imu;
  std::vector<std::string> further_imu_devices;  // the lines of the places 2, 3, ...: same frame, same settings
  double clock_speed_up = 1.0;       // seconds of the station a second of the wall clock; 1 unless twins answer
  std::array<AxisLimits, 3> axis{};  // indexed by Axis
  MotionConfig motion;
  DwellConfig dwell;
  double imu_timeout_s = 2.0;    // no sample for this long: the link is lost
  double resume_rest_s = 600.0;  // after an interruption, before the first dwell: unit and table come to temperature
  HookCommands hooks;
  VerdictLimits limits;
  StopSigmas stop_sigma{};      // when a run that may end early knows enough
  double settle_minutes = 0.0;  // that a run may add to tell apart what its diagnosis cannot; 0: none
  DiagnosisPolicy diagnosis;
  bool verify_run = false;  // every calibration is followed by a north seeking (docs/verification.md)
  Parties parties;
  std::string table_id;  // for the record; empty: not given
  std::string
      table_calibration_due;  // "2026-12-31"; a run after that day is refused unless overridden; empty: not given
  std::string database;  // results (results_database.h); empty: none; a file is relative to the station file's folder
  std::string outbox;    // where the database is a server: the file that keeps rows until it has them
  std::string store;     // parameter files in use (parameter_store.h); the same
  std::string rig_file;  // empty: the built-in rig configuration; relative to the station file's folder
  std::size_t imu_places() const { return imu ? 1 + further_imu_devices.size() : 0; }
  SerialImuSettings imu_settings(std::size_t place) const;  // from 0; only the first unit may have imu.unit_serial
  // Of a live run: a twin answers, at one end at least.
  bool simulated() const { return table.simulated || (imu && imu->settings.simulated); }
};

// The built-in station of a dry run: 29.53 deg, 9.7914 m/s^2, mock table and rig IMU, settle_s 0.5, limit.heading_deg 0.1.
StationConfig default_station_config();

// An error unless the chamber may be brought there, and the unit with it.
Status check_temperature(const ChamberConfig& chamber, double temperature_c);

Result<StationConfig> read_station_config(const std::string& path);  // empty: the built-in one
Result<StationConfig> parse_station_config(const std::string& text, const std::string& file_name);

// What the planner needs of a station.
PlanLimits plan_limits(const StationConfig& station, double sample_period_s);

// The fourteen steps and the north seeking, compiled into the program, so that it runs wherever it is copied to. The texts are those
// of sequences/fourteen_step.seq and sequences/verify.seq at build time.
extern const std::string_view builtin_sequence_text;
inline constexpr const char* builtin_sequence_name = "built-in fourteen_step.seq";

extern const std::string_view builtin_verify_text;
// Given for a file it means that text; in a journal, too.
inline constexpr const char* builtin_verify_name = "built-in verify.seq";

}  // namespace turncal
