// Reads any table of an IMU (CSV, .npy, .mat, HDF5: number_table.h; ROS bags: ros_bag.h) into a recording, by a map of its columns.
//
// The accelerometers may come in a file of their own: where its stamps are not those of the gyros its integral is interpolated at theirs, so that no
// velocity is lost or made. Rows at a time that the other has not, or lacks rows of, are left out.
//
// A rate becomes an increment by its interval, the time since the row before: a rate is taken as the mean over the interval it ends. Nothing is
// resampled. With `intervals` the measured interval goes into the increment, so that a turn keeps its size when the sampling jitters; with `period` the
// mean one does, which is right when the stamps jitter but the sensor does not (intervals would make noise of it: over a rest of 3 s 0.5 ms are
// 1.6 mm/s^2), and stamps may go back a little. Where the map does not say, the stamps do, and what a gap is (stamps.h). A gyro that repeats one extreme
// number is found clipped (clipping.h) before intervals blur that. The recording's sample_period_s is the mean interval, or the slope of the stamps. The
// counter steps by one a row, over a gap by as many periods as it lasts; a dropped row leaves its number out. Output: rad and m/s, body axes.
//
// A row with stamp and numbers of the one before was written twice, a defect; not where a coarse sensor repeats itself at other stamps as often.
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
#include "imu_io/recordings/number_table.h"

namespace turncal {

// The map: what the columns of a table are. Every key: docs/import.md.
struct CsvTriad {
  std::array<std::string, 3> columns;
  std::array<double, 3> scale{1.0, 1.0, 1.0};  // SI a number
  std::array<double, 3> offset{};
  AxisOrder axes;  // body axis k reads column from[k]
  bool is_rate = true;
  double range_low = -1e300;
  double range_high = 1e300;
};

// A column that is a part of a row's time, as seconds and nanoseconds are.
struct CsvClock {
  std::string column;
  double unit_s = 1.0;
};

struct CsvMap {
  TableFormat format;
  CsvTriad gyro;
  CsvTriad accel;
  std::vector<CsvClock> clocks;                 // a row's time is their sum; none: rate_hz
  std::vector<std::string> accel_time_columns;  // the same in a file of their own
  enum class Increments { chosen, intervals, period } increments = Increments::chosen;
  double gap = 1.5;
  double rate_hz = 0.0;
  std::string temperature_column;  // empty: none
  double temperature_scale = 1.0;
  double temperature_offset = 0.0;
  double gravity_mps2 = 0.0;
  double latitude_deg = 0.0;
  std::string unit_serial;
  std::optional<std::int64_t> started_utc_s;  // when its first row was measured
  std::string topic;                          // of a bag; empty: the only one
};
Result<CsvMap> read_csv_map(const std::string& path);
Result<CsvMap> parse_csv_map(std::string_view text, const std::string& file_name);

struct CsvImport {
  RecordingInfo info;
  std::vector<ImuSample> samples;
  std::int64_t rows = 0;
  std::int64_t without_accel = 0;       // of them, left out: the accelerometers' file has none there
  std::int64_t saturated = 0;           // rows at the end of a range
  std::vector<DataEvent> clipped_runs;  // of samples, from 0, that are found to repeat a gyro's extreme number
  std::int64_t clipped = 0;             // of `samples`, where these are marked
  std::int64_t bad_rows = 0;            // left out
  std::string first_bad;                // what was wrong with the first
  std::int64_t gaps = 0;
  double jitter_s = 0.0;  // rms of the intervals about their mean, gaps left out
  std::string chosen;     // "time.increments = period: ...", where the stamps said it
};

// A file that has columns, whatever its form.
struct ColumnSource {
  std::string file_name;
  // Hands the rows over from the first on, as often as wanted.
  std::function<Status(const std::vector<WantedColumn>&, const TableFormat&, const TableSink&)> read;
  std::uint64_t likely_rows = 0;    // at most, as it seems: memory for stamps
  std::vector<std::string> names;   // what can be wanted; of text none
  std::optional<std::string> head;  // of CSV: how it begins
  std::string topic, note;          // of a bag: which one, and what else there is to say
  std::optional<std::int64_t> started_utc_s;
};
// `topic`, `skip_bad`: of a bag (ros_bag.h).
Result<ColumnSource> open_columns(const std::string& path, const std::string& topic = {}, bool skip_bad = false);

Result<CsvImport> import_columns(const CsvMap& map, const ColumnSource& source, const ColumnSource* accel = nullptr);
Result<CsvImport> import_csv(const CsvMap& map, const std::string& path);

// The same, in memory for the stamps and later for nothing; clipped samples are not marked. Rows are read twice, for the stamps and for the
// samples. `begin` is told what is known before the first sample; what is returned has no samples.
using ImportBegin = std::function<void(const CsvImport& found)>;
Result<CsvImport> stream_columns(const CsvMap& map, const ColumnSource& source, const ColumnSource* accel,
                                 const ImportBegin& begin, const RecordingSource::Sink& sink);

}  // namespace turncal
