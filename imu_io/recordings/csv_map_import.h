// Reads any table of an IMU (CSV, .npy, .mat, HDF5: number_table.h; ROS bags: ros_bag.h) into a recording, by a map of its columns.
//
// The accelerometers may come in a file of their own. If its stamps are not the gyros', its integral is interpolated at the gyros' stamps, so that no
// velocity is lost or made. Rows at times that the other file does not have, or where it lacks rows, are left out.
//
// A rate is taken as the mean over the interval that it ends, the time since the row before, and becomes an increment by it. Nothing is resampled. With
// `intervals` the measured interval is used, so that a turn keeps its size when the sampling jitters. With `period` the mean one is used, which is right
// when the stamps jitter but the sensor does not (`intervals` would make noise of it: 0.5 ms are 1.6 mm/s^2 over a rest of 3 s); stamps may then go back
// a little. If the map does not choose, the stamps do, and they say what a gap is (stamps.h). A gyro that repeats one extreme number is found clipped
// (clipping.h) before intervals blur it. The sample_period_s of the recording is the mean interval, or the slope of the stamps. The counter steps by one
// in each row, and over a gap by its length in periods; a dropped row leaves its number out. Output: rad and m/s, body axes.
//
// A row with the stamp and numbers of the one before was written twice, which is a defect, unless a coarse sensor repeats itself as often at new stamps.
//
// Errors: one line with file, line, column, value and what was expected.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "calib/statistics/data_screen.h"
#include "calib/types/axis.h"
#include "calib/types/recording_types.h"
#include "calib/types/status.h"
#include "imu_io/base/key_value.h"
#include "imu_io/recordings/number_table.h"

namespace turncal {

inline constexpr NumberRange sample_rate_hz = between(0.1, 4e4);

// The map says what the columns of a table are. Every key: docs/import.md.
struct CsvTriad {
  std::array<std::string, 3> columns;
  std::array<double, 3> scale{1.0, 1.0, 1.0};  // SI units of one number
  std::array<double, 3> offset{};
  AxisOrder axes;  // body axis k reads column from[k]
  bool is_rate = true;
  double range_low = -1e300;
  double range_high = 1e300;
};

// A column that gives a part of a row's time, such as seconds or nanoseconds.
struct CsvClock {
  std::string column;
  double unit_s = 1.0;
};

struct CsvMap {
  TableFormat format;
  CsvTriad gyro;
  CsvTriad accel;
  std::vector<CsvClock> clocks;                 // a row's time is their sum; without any it follows from rate_hz
  std::vector<std::string> accel_time_columns;  // the same in the accelerometers' own file
  enum class Increments { chosen, intervals, period } increments = Increments::chosen;
  double gap = 1.5;
  double rate_hz = 0.0;
  std::string temperature_column;  // empty: none
  double temperature_scale = 1.0;
  double temperature_offset = 0.0;
  double gravity_mps2 = 0.0;
  double latitude_deg = 0.0;
  std::string unit_serial;
  std::optional<std::int64_t> started_utc_s;  // when the first row was measured
  std::string topic;                          // of a bag; empty: its only one
};
Result<CsvMap> read_csv_map(const std::string& path);
Result<CsvMap> parse_csv_map(std::string_view text, const std::string& file_name);

struct CsvImport {
  RecordingInfo info;
  std::vector<ImuSample> samples;
  std::int64_t rows = 0;
  std::int64_t without_accel = 0;       // of them, left out because the accelerometers' file has no data there
  std::int64_t saturated = 0;           // rows with a number at the end of a range
  std::vector<DataEvent> clipped_runs;  // samples, from 0, that repeat a gyro's extreme number
  std::int64_t clipped = 0;             // of `samples`, which are marked
  std::int64_t bad_rows = 0;            // left out
  std::string first_bad;                // the defect of the first of them
  std::int64_t gaps = 0;
  double jitter_s = 0.0;  // rms of the intervals about their mean, without gaps
  std::string note;       // about the source
  std::string chosen;     // "time.increments = period: ..." if the stamps decided
};

// A file with columns, in any form.
struct ColumnSource {
  std::string file_name;
  // Hands the rows over from the first on, any number of times.
  std::function<Status(const std::vector<WantedColumn>&, const TableFormat&, const TableSink&)> read;
  std::uint64_t likely_rows = 0;    // about the most rows; memory for stamps is reserved by it
  std::vector<std::string> names;   // names that can be wanted; of text none
  std::optional<std::string> head;  // the beginning of a CSV file
  std::string topic, note;          // of a bag: the topic, and what else is to be said
  std::optional<std::int64_t> started_utc_s;
};
// `topic` and `skip_bad` are for bags (ros_bag.h).
Result<ColumnSource> open_columns(const std::string& path, const std::string& topic = {}, bool skip_bad = false);

Result<CsvImport> import_columns(const CsvMap& map, const ColumnSource& source, const ColumnSource* accel = nullptr);
Result<CsvImport> import_csv(const CsvMap& map, const std::string& path);

// Imports in memory for the stamps only, and returns no samples. Rows are read twice, for the stamps and for the samples. `begin` is told what is known
// before the first sample. Clipped samples are not marked.
using ImportBegin = std::function<void(const CsvImport& found)>;
Result<CsvImport> stream_columns(const CsvMap& map, const ColumnSource& source, const ColumnSource* accel,
                                 const ImportBegin& begin, const RecordingSource::Sink& sink);

}  // namespace turncal
