// Reads any table of an IMU (CSV, .npy, .mat, HDF5: number_table.h; ROS bags: ros_bag.h) into a recording, by a map that says what its
// columns are.
//
// The accelerometers may come in a file of their own. Where its stamps are those of the gyros its rows are taken as they are; else its
// integral is interpolated at the gyros' stamps, so that no velocity is lost or made. Rows outside the time that both have are left out.
//
// A rate becomes an increment by its interval, the time since the row before: a rate is taken as the mean over the interval it ends.
// Nothing is resampled. With `intervals` the measured interval goes into the increment, so that a turn keeps its size when the
// sampling jitters; with `period` the mean interval does, which is right when the stamps jitter but the sensor does not (then intervals
// would turn jitter of stamps into noise of the sensor: over a rest of 3 s 0.5 ms of it are 1.6 mm/s^2). With `period` stamps may even
// go back a little. A gap is then a rise that lasts of what the stamps are ahead of an even clock, by their median or least over 8, 32 or 128
// rows, as few as their jitter needs; the least is right of stamps that come late, also in bursts. A gyro that repeats one extreme number is found
// clipped (clipping.h) before intervals blur that. The recording's sample_period_s is the mean interval either way. The counter steps by
// one a row, over a gap by as many periods as it lasts; a dropped row leaves its number out. Output: rad and m/s, body axes.
//
// Where the map does not say, the stamps do. Let p be what they are ahead of an even clock. If every stamp is off by itself (a late
// interrupt, a host that was busy, rounding), the scatter of p[k + 2m] - 2 p[k + m] + p[k] is the same for every m; if every interval is what it says,
// it grows with the root of m. Up to the geometric mean of both, over 32 rows, it is `period`; and so it is, too, for a sensor that was truly read
// at those times, since what one interval has too much the next has too little. Beyond it, or where the rate changes by more than 200 ppm
// (six times what the jitter explains, and twice the steps in which the stamps are written) from one sixteenth of the record to the next, it is
// `intervals`. A scatter below those steps is theirs. Not looked for: an even sensor behind a host's clock that is itself in steps; gaps within four
// rows of another one where stamps jitter by more than a third of the period.
//
// A row with the stamp and the numbers of the one before was written twice, and is a defect; not where a coarse sensor repeats itself at other
// stamps as often.
//
// The whole file is held in memory (of a bag: the columns). Errors: one line with file, line, column, value and what was expected.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

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

struct CsvMap {
  TableFormat format;
  CsvTriad gyro;
  CsvTriad accel;
  std::string time_column;        // empty: rate_hz
  std::string accel_time_column;  // in a file of their own
  double time_unit_s = 1.0;
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
  std::int64_t saturated = 0;  // rows at the end of a range
  std::int64_t clipped = 0;    // samples found to repeat a gyro's extreme number
  std::int64_t bad_rows = 0;   // left out
  std::string first_bad;       // what was wrong with the first
  std::int64_t gaps = 0;
  double jitter_s = 0.0;  // rms of the intervals about their mean, gaps left out
  std::string chosen;     // "time.increments = period: ...", where the stamps said it
};

// A file that has columns, whatever its form.
struct ColumnSource {
  std::string file_name;
  // Of a bag once.
  std::function<Result<NumberTable>(const std::vector<WantedColumn>&, const TableFormat&)> read;
  std::vector<std::string> names;           // what can be wanted; of text none
  std::shared_ptr<const std::string> text;  // of CSV
  std::string topic, note;                  // of a bag: which one, and what else there is to say
  std::optional<std::int64_t> started_utc_s;
};
// `topic`, `skip_bad`: of a bag (ros_bag.h).
Result<ColumnSource> open_columns(const std::string& path, const std::string& topic = {}, bool skip_bad = false);

// Of what is held as a text.
ColumnSource columns_of_text(std::string content, const std::string& file_name);

Result<CsvImport> import_columns(const CsvMap& map, const ColumnSource& source, const ColumnSource* accel = nullptr);
Result<CsvImport> import_csv(const CsvMap& map, const std::string& path);

// The interval that most rows keep, whatever the gaps and the jitter: the mean over 16 of them, less those that are far from the median.
double typical_interval(const std::vector<double>& times);
// Why `period`, or `intervals`, is right for them (above).
struct IncrementsChoice {
  CsvMap::Increments increments = CsvMap::Increments::period;
  std::string reason;
};
IncrementsChoice choose_increments(const std::vector<double>& times_s);

// Writes `content` as a binary recording without segments, whole or not at all; `path` must not exist.
Status write_recording(const CsvImport& content, const std::string& path);

}  // namespace turncal
