// What the columns of a table of an IMU are: the map that csv_map_import.h reads it by. Every key: docs/csv-maps.md.
#pragma once

#include <array>
#include <string>
#include <string_view>

#include "calib/types/axis.h"
#include "calib/types/status.h"
#include "imu_io/recordings/number_table.h"

namespace turncal {

struct CsvTriad {
  std::array<std::string, 3> columns;
  std::array<double, 3> scale{1.0, 1.0, 1.0};  // SI a number
  std::array<double, 3> offset{};
  AxisOrder axes;  // body axis k reads column from[k]
  bool is_rate = true;
  double range_low = -1e300;
  double range_high = 1e300;
};

struct CsvMap {
  TableFormat format;
  CsvTriad gyro;
  CsvTriad accel;
  std::string time_column;        // empty: rate_hz
  std::string accel_time_column;  // in a file of their own
  double time_unit_s = 1.0;
  bool measured_intervals = true;
  double gap = 1.5;
  double rate_hz = 0.0;
  std::string temperature_column;  // empty: none
  double temperature_scale = 1.0;
  double temperature_offset = 0.0;
  double gravity_mps2 = 0.0;
  double latitude_deg = 0.0;
  std::string unit_serial;
  std::optional<std::int64_t> started_utc_s;  // when its first row was measured
};
Result<CsvMap> read_csv_map(const std::string& path);
Result<CsvMap> parse_csv_map(std::string_view text, const std::string& file_name);

}  // namespace turncal
