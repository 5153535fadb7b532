#include "imu_io/recordings/csv_map_import.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <span>

#include <Eigen/Core>

#include <fmt/format.h>

#include "calib/statistics/clipping.h"
#include "calib/statistics/distributions.h"
#include "imu_io/base/file_kind.h"
#include "imu_io/base/format_number.h"
#include "imu_io/base/key_value.h"
#include "imu_io/base/posix_file.h"
#include "imu_io/base/text_pieces.h"
#include "imu_io/recordings/recording_check.h"
#include "imu_io/recordings/recording_writer.h"
#include "imu_io/recordings/ros_bag.h"

namespace turncal {
namespace {

// ---- the map ----

CsvTriad read_triad(KeyValueFile& file, const std::string& name, const std::vector<std::string_view>& units) {
  CsvTriad triad;
  const std::vector<std::string> columns = file.list(name + ".columns");
  if (columns.size() == 3)
    std::copy(columns.begin(), columns.end(), triad.columns.begin());
  else
    file.reject(name + ".columns", "three columns, by name or number");
  const InertialUnit* const unit = read_unit(file, name + ".unit", units);
  triad.scale = one_or_three(file, name + ".scale", 1.0, "one number or three");
  if (std::ranges::count(triad.scale, 0.0) > 0) file.reject(name + ".scale", "no zero");
  triad.offset = one_or_three(file, name + ".offset", 0.0, "one number or three");
  if (unit != nullptr) {
    triad.is_rate = unit->is_rate;
    for (double& scale : triad.scale) scale *= unit->si;
  }
  triad.axes = read_axes(file, name + ".axes", false, "x, y and z once each, with sign, as in +x, -z, +y");
  read_range(file, name + ".range", triad.range_low, triad.range_high, "the lower number before the higher");
  return triad;
}

Result<CsvMap> read_map(KeyValueFile& file) {
  CsvMap map;
  map.gyro = read_triad(file, "gyro", {"rad/s", "deg/s", "deg/h", "rad", "deg", "arcsec"});
  map.accel = read_triad(file, "accel", {"m/s^2", "g", "mg", "m/s"});
  const std::string delimiter = file.one_of_or("csv.delimiter", "comma", {"comma", "semicolon", "tab", "space"});
  map.format.delimiter = delimiter == "semicolon" ? ';' : delimiter == "tab" ? '\t' : delimiter == "space" ? ' ' : ',';
  map.format.decimal_comma = file.one_of_or("csv.decimal", "point", {"point", "comma"}) == "comma";
  if (map.format.decimal_comma && map.format.delimiter == ',')
    file.reject("csv.decimal", "point where csv.delimiter is comma");
  map.format.header_lines = static_cast<int>(file.integer_or("csv.header_lines", 1, 0, 1000));
  map.time_column = file.text_or("time.column", "");
  map.accel_time_column = file.text_or("accel.time.column", map.time_column);
  if (const auto step_s = parse_number(file.text_or("time.unit", "s")); step_s && *step_s > 0.0) {
    map.time_unit_s = *step_s;
  } else {
    const std::string unit = file.one_of_or("time.unit", "s", {"s", "ms", "us", "ns"});
    map.time_unit_s = unit == "ms" ? 1e-3 : unit == "us" ? 1e-6 : unit == "ns" ? 1e-9 : 1.0;
  }
  if (file.has("time.increments"))
    map.increments = file.one_of("time.increments", {"intervals", "period"}) == "period"
                         ? CsvMap::Increments::period
                         : CsvMap::Increments::intervals;
  map.gap = file.number_or("time.gap", 1.5, at_least(1.1));
  if (map.time_column.empty())
    map.rate_hz = file.number("rate_hz", between(0.1, 1e5));
  else if (file.has("rate_hz"))
    file.reject("rate_hz", "no rate beside time.column: the rate comes from the times");
  if (map.time_column.empty())
    for (const char* key : {"time.unit", "time.increments", "time.gap"})
      if (file.has(key)) file.reject(key, "time.column too");
  map.temperature_column = file.text_or("temperature.column", "");
  map.temperature_scale = file.number_or("temperature.scale", 1.0);
  map.temperature_offset = file.number_or("temperature.offset", 0.0);
  map.gravity_mps2 = file.number("gravity_mps2", recorded_gravity_mps2);
  map.latitude_deg = file.number_or("latitude_deg", 0.0, site_latitude_deg);
  map.unit_serial = file.text("unit_serial");
  map.started_utc_s = started_utc(file);
  map.topic = file.text_or("topic", "");
  TRY(file.check_all_used());
  return map;
}

// ---- the table ----

// What a row has, as in the file.
struct Row {
  double time = 0.0;
  Eigen::Vector3d gyro = Eigen::Vector3d::Zero(), accel = gyro;
  double temperature = std::numeric_limits<double>::quiet_NaN();
  std::int64_t position = 0;
  std::int64_t line = 0;
};

Eigen::Vector3d three_of(const NumberTable& table, std::size_t row, std::size_t first, std::size_t step) {
  return {table.columns[first][row], table.columns[first + step][row], table.columns[first + 2 * step][row]};
}

Error time_goes_back(const std::string& file, std::int64_t line, const std::string& column, double time) {
  return input_error(fmt::format("{}:{}: column {} = '{}': expected a time after that of the row before", file, line,
                                 quoted(column), format_number(time)));
}

// What time it is at a row by the stamps of it and those after it: their median, or the least where stamps come late and never early.
struct StampLevel {
  std::span<const double> times;
  double period = 0.0;
  std::size_t width = 8;
  bool least = false;
  double scatter = 0.0;  // of the difference of two levels
  double spread = 0.0;   // range of the stamps in a window

  double at(std::size_t row, std::size_t most, double* range = nullptr) const {
    std::array<double, 128> level{};
    const std::size_t rows = std::min({width, most, times.size() - row});
    for (std::size_t k = 0; k < rows; ++k) level[k] = times[row + k] - static_cast<double>(k) * period;
    const std::span<double> levels(level.data(), rows);
    const auto [first, last] = std::ranges::minmax(levels);
    if (range != nullptr) *range = last - first;
    return least ? first : median(levels);
  }
  // Of a few windows; some of them may have gaps.
  void find_scatter() {
    constexpr std::size_t enough = 512;
    std::vector<double> rises, spreads;
    for (std::size_t row = 0; row + 2 * width <= times.size(); row += std::max(width, times.size() / enough)) {
      double range = 0.0;
      const double here = at(row, width, &range);
      rises.push_back(at(row + width, width) - here);
      spreads.push_back(range);
    }
    if (rises.empty()) return;
    const double middle = median(rises);
    for (double& rise : rises) rise = std::abs(rise - middle);
    scatter = std::min(value_at_rank(rises, 3 * rises.size() / 4) / 1.15, period / 6.0);
    spread = median(spreads);
  }
};

// The narrowest of a few windows whose levels scatter by less than a twelfth of a period; else the one that scatters least.
StampLevel find_level(std::span<const double> times, double period) {
  StampLevel best{times, period};
  best.scatter = period;
  for (const std::size_t width : {8, 32, 128})
    for (const bool least : {false, true}) {
      if (best.scatter < period / 12.0 || (width > 8 && times.size() < 4 * width)) continue;
      StampLevel level{times, period, width, least};
      level.find_scatter();
      if (level.scatter < best.scatter) best = level;
    }
  return best;
}

// How many periods each row is after the one before: a gap is a rise of the level that lasts, whatever a single stamp does.
std::vector<std::int64_t> periods_between(const std::vector<double>& times, double period, double gap) {
  const std::size_t n = times.size();
  std::vector<std::int64_t> periods(n, 1);
  const StampLevel level = find_level(times, period);
  std::size_t last_gap = 0;
  const auto is_late = [&](std::size_t row) { return times[row] - times[row - 1] > gap * period; };
  const bool fine = level.width == StampLevel{}.width && level.spread < 0.6 * period;
  // From before a row, up to another one or itself.
  const auto rise = [&](std::size_t row, std::size_t to) {
    const std::size_t from = std::max(last_gap, row - std::min(row, level.width));
    return level.at(to, level.width) - level.at(from, fine ? row - from : level.width) -
           static_cast<double>(to - from) * period;
  };
  for (std::size_t row = 1; row < n; ++row) {
    if (!is_late(row)) continue;
    const auto seen = static_cast<double>(std::min({n - row, row - last_gap, level.width}));
    const double chance = 5.0 * level.scatter * std::sqrt(static_cast<double>(level.width) / seen);
    const double least = std::max(chance, n - row < level.width ? level.spread + 0.5 * period : 0.5 * period);
    if (rise(row, row) < least) continue;
    // A median sees a gap half a window before it: it is the longest interval there. Fine stamps say themselves which row it is.
    std::size_t at = row;
    for (std::size_t next = row + 1; !level.least && !fine && next < std::min(n, row + level.width / 2 + 1); ++next)
      if (times[next] - times[next - 1] > times[at] - times[at - 1]) at = next;
    const double missing = fine ? times[row] - times[row - 1] - period : rise(row, at);
    periods[at] += std::max<std::int64_t>(1, std::llround(missing / period));
    last_gap = row = at;
  }
  return periods;
}

class Importer {
 public:
  explicit Importer(const CsvMap& map) : map_(map) {}

  Status read(const ColumnSource& source, bool with_accel) {
    file_name_ = source.file_name;
    result_.info.started_utc_s = map_.started_utc_s ? map_.started_utc_s : source.started_utc_s;
    std::vector<WantedColumn> wanted;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      wanted.push_back({map_.gyro.columns[axis]});
      if (with_accel) wanted.push_back({map_.accel.columns[axis]});
    }
    const std::size_t each = with_accel ? 2 : 1;
    const std::size_t time = wanted.size();
    if (timed()) wanted.push_back({map_.time_column});
    const std::size_t temperature = wanted.size();
    if (!map_.temperature_column.empty()) wanted.push_back({map_.temperature_column, true});
    NumberTable table = TRY(read_once_each(source, wanted));
    count_bad(table);
    rows_.resize(table.rows());
    // Stamps are numbers of 1.7e15 us: seconds of them would be rounded.
    if (timed() && !rows_.empty()) first_stamp_ = table.columns[time].front();
    for (std::size_t k = 0; k < rows_.size(); ++k) {
      Row& row = rows_[k];
      row.gyro = three_of(table, k, 0, each);
      if (with_accel) row.accel = three_of(table, k, 1, each);
      if (timed()) row.time = (table.columns[time][k] - first_stamp_) * map_.time_unit_s;
      if (temperature < wanted.size())
        row.temperature = (table.columns[temperature][k] - map_.temperature_offset) * map_.temperature_scale;
      row.position = table.position[k];
      row.line = table.line[k];
    }
    TRY(leave_out_doubles());
    choose();
    return order_rows();
  }

  Status read_accel(const ColumnSource& source) {
    const std::string& file_name = source.file_name;
    std::vector<WantedColumn> wanted;
    for (const std::string& name : map_.accel.columns) wanted.push_back({name});
    if (timed()) wanted.push_back({map_.accel_time_column});
    NumberTable table = TRY(read_once_each(source, wanted));
    count_bad(table);
    const std::size_t n = table.rows();
    const auto numbers = [&](std::size_t row) { return three_of(table, row, 0, 1); };
    const auto time = [&](std::size_t row) { return (table.columns[3][row] - first_stamp_) * map_.time_unit_s; };
    bool same = n == rows_.size();
    for (std::size_t k = 0; same && k < n; ++k)
      same = timed() ? time(k) == rows_[k].time : table.position[k] == rows_[k].position;
    if (same) {
      for (std::size_t k = 0; k < n; ++k) rows_[k].accel = numbers(k);
      return {};
    }
    if (!timed())
      return input_error(
          fmt::format("{}: {} rows: expected {}, as in {}, or time.column", file_name, n, rows_.size(), file_name_));
    for (std::size_t k = 1; k < n; ++k)
      if (!(time(k) > time(k - 1)))
        return time_goes_back(file_name, table.line[k], map_.accel_time_column, table.columns[3][k]);
    // The integral at the gyros' stamps; a number says the mean over the interval that it ends.
    const bool rate = map_.accel.is_rate;
    std::vector<Row> kept;
    std::size_t at = 1;
    Eigen::Vector3d sum = Eigen::Vector3d::Zero(), before = sum;
    for (std::size_t k = 0; k < rows_.size(); ++k) {
      const double t = rows_[k].time;
      if (n < 2 || t < time(0)) continue;
      for (; at < n && time(at) <= t; ++at) sum += numbers(at) * (rate ? time(at) - time(at - 1) : 1.0);
      if (at == n && t > time(n - 1)) break;
      Eigen::Vector3d here = sum;
      if (at < n) here += numbers(at) * (rate ? t - time(at - 1) : (t - time(at - 1)) / (time(at) - time(at - 1)));
      Row& row = rows_[k];
      if (kept.empty())
        row.accel = numbers(std::min(at, n - 1));
      else
        row.accel = (here - before) / (rate ? t - kept.back().time : 1.0);
      before = here;
      kept.push_back(row);
    }
    rows_ = std::move(kept);
    return {};
  }

  Result<CsvImport> finish() {
    if (rows_.size() < 10)
      return input_error(file_name_ + ": expected at least 10 rows of data, found " + std::to_string(rows_.size()));
    make_intervals();
    RecordingInfo& info = result_.info;
    info.latitude_deg = map_.latitude_deg;
    info.gravity_mps2 = map_.gravity_mps2;
    info.unit_serial = map_.unit_serial;
    info.gyro_increment = info.accel_increment = IncrementKind::physical;
    info.has_temperature =
        std::any_of(rows_.begin(), rows_.end(), [](const Row& r) { return !std::isnan(r.temperature); });
    make_samples();
    result_.rows = static_cast<std::int64_t>(rows_.size()) + result_.bad_rows;
    if (result_.samples.empty())
      return input_error(file_name_ + ": every row is saturated; look at gyro.range and accel.range");
    TRY(check_info(info, file_name_));
    return std::move(result_);
  }

 private:
  bool timed() const { return !map_.time_column.empty(); }
  bool measured() const { return map_.increments == CsvMap::Increments::intervals; }
  std::vector<double> row_times() const {
    std::vector<double> times;
    for (const Row& row : rows_) times.push_back(row.time);
    return times;
  }

  Result<NumberTable> read_once_each(const ColumnSource& source, const std::vector<WantedColumn>& wanted) const {
    for (auto column = wanted.begin(); column != wanted.end(); ++column)
      if (std::ranges::find(wanted.begin(), column, column->name, &WantedColumn::name) != column)
        return input_error(source.file_name + ": the map uses column " + quoted(column->name) +
                           " twice: expected each column once");
    return source.read(wanted, map_.format);
  }

  void choose() {
    if (!timed() || map_.increments != CsvMap::Increments::chosen) return;
    const IncrementsChoice choice = choose_increments(row_times());
    map_.increments = choice.increments;
    result_.chosen = fmt::format("time.increments = {}: {}", measured() ? "intervals" : "period", choice.reason);
  }

  Status leave_out(const Error& error) {
    if (!map_.format.skip_bad_rows) return error;
    if (result_.bad_rows++ == 0) result_.first_bad = error.message;
    return {};
  }

  // Rows that were written twice: the stamp and the numbers of the row before. A coarse sensor at rest, whose stamps are coarse too, has such
  // rows of its own; it repeats its numbers at other stamps as often.
  Status leave_out_doubles() {
    if (!timed() || rows_.empty()) return {};
    const auto same_time = [&](std::size_t k) { return rows_[k].time == rows_[k - 1].time; };
    const auto same_numbers = [&](std::size_t k) {
      return rows_[k].gyro == rows_[k - 1].gyro && rows_[k].accel == rows_[k - 1].accel;
    };
    double stamps = 0.0, doubles = 0.0, repeats = 0.0;  // of rows with the stamp of the one before, and of others
    for (std::size_t k = 1; k < rows_.size(); ++k) {
      if (same_time(k)) stamps += 1.0;
      if (same_numbers(k)) (same_time(k) ? doubles : repeats) += 1.0;
    }
    if (doubles * (static_cast<double>(rows_.size() - 1) - stamps) <= 2.0 * repeats * stamps) return {};
    std::vector<Row> once{rows_.front()};
    for (std::size_t k = 1; k < rows_.size(); ++k) {
      if (same_time(k) && same_numbers(k)) {
        TRY(leave_out(input_error(fmt::format(
            "{}:{}: the row before again, time and numbers, as {} of {} rows: expected each row once; --skip-bad-rows "
            "leaves them out",
            file_name_, rows_[k].line, doubles, rows_.size()))));
        continue;
      }
      once.push_back(rows_[k]);
      once.back().position -= static_cast<std::int64_t>(k + 1 - once.size());  // nothing is missing
    }
    rows_ = std::move(once);
    return {};
  }

  // Times must increase; with `period` they may jitter back by a few rows.
  Status order_rows() {
    if (!timed() || rows_.size() < 2) return {};
    std::vector<double> steps;
    for (std::size_t k = 1; k < rows_.size(); ++k) steps.push_back(std::abs(rows_[k].time - rows_[k - 1].time));
    const double back = measured() ? 0.0 : 5.0 * median(steps);
    std::size_t kept = 1;
    for (std::size_t k = 1; k < rows_.size(); ++k) {
      const Row& row = rows_[k];
      const double least = rows_[kept - 1].time - back;
      if (measured() ? row.time > least : row.time >= least) {
        rows_[kept++] = row;
        continue;
      }
      TRY(leave_out(
          time_goes_back(file_name_, row.line, map_.time_column, first_stamp_ + row.time / map_.time_unit_s)));
    }
    rows_.resize(kept);
    return {};
  }

  void make_intervals() {
    step_.assign(rows_.size(), 1);
    if (!rows_.empty()) step_[0] = 0;
    if (!timed()) {
      result_.info.sample_period_s = median_s_ = 1.0 / map_.rate_hz;
      for (std::size_t k = 1; k < rows_.size(); ++k) step_[k] = rows_[k].position - rows_[k - 1].position;
      return;
    }
    const std::vector<double> times = row_times();
    std::vector<double> intervals(times.size());
    std::adjacent_difference(times.begin(), times.end(), intervals.begin());  // to each row from the one before
    intervals.erase(intervals.begin());
    std::vector<double> rearranged = intervals;
    median_s_ = measured() ? median(rearranged) : typical_interval(times);
    double sum = 0.0, squares = 0.0, count = 0.0;
    std::vector<std::size_t> gaps;
    const std::vector<std::int64_t> periods =
        measured() ? std::vector<std::int64_t>() : periods_between(times, median_s_, map_.gap);
    for (std::size_t k = 0; k < intervals.size(); ++k) {
      const double interval = intervals[k];
      const std::int64_t dropped = rows_[k + 1].position - rows_[k].position - 1;
      const std::int64_t steps = !measured() ? periods[k + 1] : interval > map_.gap * median_s_ ? 2 : 1;
      if (std::max(steps, dropped) > 1) {
        step_[k + 1] = std::max(steps, dropped + 1);
        gaps.push_back(k + 1);
        continue;
      }
      sum += interval;
      squares += interval * interval;
      count += 1.0;
    }
    double period = sum / count;
    result_.jitter_s = std::sqrt(std::max(0.0, squares / count - period * period));
    // What is before a gap is then no interval that could be left out.
    if (!measured() && result_.jitter_s > 0.2 * period)
      period =
          (times.back() - times.front()) / static_cast<double>(std::accumulate(periods.begin(), periods.end(), -1LL));
    result_.info.sample_period_s = period;
    if (measured())
      for (const std::size_t k : gaps)
        step_[k] = std::max<std::int64_t>(step_[k], std::llround(intervals[k - 1] / period));
    result_.gaps = static_cast<std::int64_t>(gaps.size());
  }

  // On the numbers of the file, where a clipped gyro repeats itself whatever the intervals are.
  void mark_clipping(std::vector<std::uint32_t>& flags) const {
    ClippingFinder finder;
    for (std::size_t k = 0; k < rows_.size(); ++k) {
      ImuSample sample;
      sample.counter = static_cast<std::int64_t>(k);
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const int from = map_.gyro.axes.from[axis];
        sample.gyro[axis] = rows_[k].gyro[from] - map_.gyro.offset[static_cast<std::size_t>(from)];
      }
      finder.add(sample);
    }
    for (const DataEvent& run : finder.finish())
      for (std::int64_t k = run.sample; k < run.sample + run.count; ++k)
        flags[static_cast<std::size_t>(k)] |= gyro_clipped_flag(run.axis);
  }

  void make_samples() {
    const double period = result_.info.sample_period_s;
    const auto saturated = [](const CsvTriad& triad, double x) {
      return x <= triad.range_low || x >= triad.range_high;
    };
    const auto increment = [](const CsvTriad& triad, const Eigen::Vector3d& numbers, std::size_t body, double dt) {
      const auto from = static_cast<std::size_t>(triad.axes.from[body]);
      return triad.axes.sign[body] * (numbers[triad.axes.from[body]] - triad.offset[from]) * triad.scale[from] *
             (triad.is_rate ? dt : 1.0);
    };
    std::vector<std::uint32_t> flags(rows_.size(), 0);
    mark_clipping(flags);
    std::int64_t counter = 0;
    result_.samples.reserve(rows_.size());
    for (std::size_t k = 0; k < rows_.size(); ++k) {
      const Row& row = rows_[k];
      counter += step_[k];
      if (flags[k] != 0) ++result_.clipped;
      bool full = false;
      for (std::size_t axis = 0; axis < 3; ++axis)
        if (saturated(map_.gyro, row.gyro[map_.gyro.axes.from[axis]])) {
          flags[k] |= gyro_clipped_flag(static_cast<int>(axis));
          full = true;
        }
      const bool dropped =
          std::any_of(row.accel.begin(), row.accel.end(), [&](double x) { return saturated(map_.accel, x); });
      if (full || dropped) ++result_.saturated;
      if (dropped) continue;
      const bool is_measured = timed() && measured() && k > 0 && step_[k] == 1;
      const double dt = is_measured ? row.time - rows_[k - 1].time : period;
      ImuSample sample;
      sample.counter = counter;
      sample.flags =
          flags[k] == 0 ? 0 : flags[k] | sample_flag_invalid;  // whoever knows no axis sets its turn aside too
      for (std::size_t axis = 0; axis < 3; ++axis) {
        sample.gyro[axis] = increment(map_.gyro, row.gyro, axis, dt);
        sample.accel[axis] = increment(map_.accel, row.accel, axis, dt);
      }
      sample.temperature_c = static_cast<float>(row.temperature);
      result_.samples.push_back(sample);
    }
  }

  void count_bad(const NumberTable& table) {
    if (result_.bad_rows == 0) result_.first_bad = table.first_bad;
    result_.bad_rows += table.bad_rows;
  }

  CsvMap map_;
  std::string file_name_;
  double first_stamp_ = 0.0;  // in the unit of the map
  std::vector<Row> rows_;
  std::vector<std::int64_t> step_;  // of the counter before each row
  double median_s_ = 0.0;
  CsvImport result_;
};

ColumnSource columns_of_bag(const std::string& path, BagImu bag) {
  ColumnSource source;
  source.topic = bag.topic;
  source.note = "topic " + quoted(bag.topic);
  source.file_name = path + ", " + source.note;
  if (!bag.temperature_topic.empty()) source.note += ", temperature of " + quoted(bag.temperature_topic);
  if (bag.recording_times) source.note += ", times of recording: no header.stamp is set";
  source.started_utc_s = bag.started_utc_s;
  for (const NumberColumn& column : bag.columns) source.names.push_back(column.name);
  source.read = [bag = std::make_shared<BagImu>(std::move(bag)), name = source.file_name, names = source.names](
                    const std::vector<WantedColumn>& wanted, const TableFormat&) -> Result<NumberTable> {
    NumberTable table;
    for (const WantedColumn& column : wanted) {
      const auto at = std::ranges::find(bag->columns, column.name, &NumberColumn::name);
      if (at == bag->columns.end())
        return input_error(
            fmt::format("{}: no column {}: it has {}", name, quoted(column.name), fmt::join(names, ", ")));
      table.columns.push_back(std::move(at->values));
    }
    table.position = table.line = bag->message;
    for (std::int64_t& line : table.line) ++line;
    table.bad_rows = bag->bad;
    table.first_bad = bag->first_bad;
    return table;
  };
  return source;
}

}  // namespace

Result<CsvMap> read_csv_map(const std::string& path) {
  TRY(expect_file(path, FileKind::table_map));
  KeyValueFile file = TRY(KeyValueFile::read(path));
  return read_map(file);
}

Result<CsvMap> parse_csv_map(std::string_view text, const std::string& file_name) {
  KeyValueFile file = TRY(KeyValueFile::parse(text, file_name));
  return read_map(file);
}

double typical_interval(const std::vector<double>& times) {
  std::vector<double> intervals;
  const auto over = [&](std::size_t span) {
    intervals.clear();
    for (std::size_t k = span; k < times.size(); ++k)
      intervals.push_back((times[k] - times[k - span]) / static_cast<double>(span));
    return intervals.empty() ? 0.0 : median(intervals);
  };
  const double one = over(1);
  std::vector<double> single = intervals;
  double middle = 0.0;
  std::size_t span = 16;
  for (;; span *= 4) {
    span = std::clamp<std::size_t>(times.size() / 4, 1, span);
    middle = over(span);
    if (middle > 0.0 || span == 256 || span == std::max<std::size_t>(times.size() / 4, 1)) break;
  }
  if (!(middle > 0.0)) return middle;
  // Stamps in coarse steps are right in the mean only, and of rows that come in bursts whole bursts.
  const bool bursts = one < 0.5 * middle;
  for (double& interval : single) interval = std::abs(interval - (bursts ? 0.0 : one));
  const std::size_t rank = single.size() - 1 - single.size() / (bursts ? 50 : 20);
  const double step = std::max(0.4 * middle, value_at_rank(single, rank));
  const double near = 1.2 * step / static_cast<double>(span);
  const auto end =
      std::partition(intervals.begin(), intervals.end(), [&](double x) { return std::abs(x - middle) <= near; });
  return std::accumulate(intervals.begin(), end, 0.0) / static_cast<double>(end - intervals.begin());
}

// The steps in which stamps are written, where they are coarse: the least by which intervals differ.
double resolution_of(const std::vector<double>& times, double period) {
  std::vector<double> intervals;
  for (std::size_t k = 1; k < times.size(); k += 1 + times.size() / 4096)
    if (const double interval = times[k] - times[k - 1]; interval < 1.5 * period) intervals.push_back(interval);
  std::ranges::sort(intervals);
  double least = period;
  for (std::size_t k = 1; k < intervals.size(); ++k)
    if (const double step = intervals[k] - intervals[k - 1]; step > 1e-6 * period) least = std::min(least, step);
  return least < period ? least : 0.0;
}

IncrementsChoice choose_increments(const std::vector<double>& times_s) {
  using Increments = CsvMap::Increments;
  constexpr std::size_t fewest = 40, parts = 16;
  const std::size_t n = times_s.size();
  if (n < fewest) return {Increments::intervals, "too few rows to tell whether the stamps jitter"};
  const double period = typical_interval(times_s);
  if (!(period > 0.0)) return {Increments::intervals, "the times do not grow"};
  // By what the stamps are ahead of an even clock; periods that are missing are gaps.
  const std::vector<std::int64_t> periods = periods_between(times_s, period, 1.5);
  std::vector<double> ahead(n, 0.0);
  for (std::size_t k = 1; k < n; ++k)
    ahead[k] = ahead[k - 1] + times_s[k] - times_s[k - 1] - static_cast<double>(periods[k]) * period;
  // Rms without the largest hundredth: knocks of the host, gaps that were not whole periods.
  const auto scatter = [&](std::size_t m) {
    std::vector<double> squares;
    for (std::size_t k = 2 * m; k < n; ++k) {
      const double bend = ahead[k] - 2.0 * ahead[k - m] + ahead[k - 2 * m];
      squares.push_back(bend * bend);
    }
    const auto largest = squares.end() - static_cast<std::ptrdiff_t>(squares.size() / 100 + 1);
    std::nth_element(squares.begin(), largest, squares.end());
    squares.erase(largest, squares.end());
    return std::sqrt(std::accumulate(squares.begin(), squares.end(), 0.0) / static_cast<double>(squares.size()));
  };
  const std::size_t far = std::min<std::size_t>(n / 8, 32);
  const double jitter = scatter(1) / std::sqrt(6.0);  // of a stamp, if each is off by itself
  const double resolution = resolution_of(times_s, period);
  const double growth = jitter > 1e-9 * period ? scatter(far) / std::max(scatter(1), resolution) : 0.0;
  // Of the rate from a sixteenth to the next, by the means of both.
  const std::size_t length = n / parts;
  const auto rows = static_cast<double>(length);
  std::vector<double> means, rates;
  for (std::size_t part = 0; part < parts; ++part) {
    const std::span<const double> rows_of = std::span(ahead).subspan(part * length, length);
    means.push_back(std::accumulate(rows_of.begin(), rows_of.end(), 0.0) / rows);
    if (part > 0) rates.push_back((means[part] - means[part - 1]) / (rows * period));
  }
  std::ranges::sort(rates);
  const double change = rates[parts - 3] - rates[1];
  const double spread = std::max(jitter, scatter(far) / std::sqrt(6.0)) * std::sqrt(static_cast<double>(far) / rows);
  const double explained = (6.0 * spread + 2.0 * resolution) / (rows * period);
  const std::string said =
      fmt::format("over {} rows the scatter of the stamps is {:.2g} times that over one", far, growth);
  if (growth > std::pow(static_cast<double>(far), 0.25))
    return {Increments::intervals, said + ": it adds up, the intervals are real"};
  if (change > std::max(2e-4, explained))
    return {Increments::intervals, fmt::format("the rate changes by {:.2g} % within the record", 100.0 * change)};
  if (growth == 0.0) return {Increments::period, "the stamps are even"};
  return {Increments::period, said + ": it does not add up, the sampling is even and the stamps jitter"};
}

ColumnSource columns_of_text(std::string content, const std::string& file_name) {
  ColumnSource source;
  source.file_name = file_name;
  source.text = std::make_shared<const std::string>(std::move(content));
  source.read = [held = source.text, file_name](const std::vector<WantedColumn>& wanted, const TableFormat& format) {
    return read_number_table(*held, file_name, wanted, format);
  };
  return source;
}

Result<ColumnSource> open_columns(const std::string& path, const std::string& topic, bool skip_bad) {
  const FileKind kind = recognise_file(path);
  if (is_bag(kind)) return columns_of_bag(path, TRY(read_bag(path, topic, skip_bad)));
  if (!topic.empty()) return input_error(path + ": topic " + quoted(topic) + ": expected a ROS bag");
  TRY(expect_file(path, FileKind::csv));
  // A library reads .mat and HDF5, whatever their size.
  constexpr std::size_t most_bytes = std::size_t{4} << 30;
  ColumnSource source = columns_of_text(kind == FileKind::mat    ? "MATLAB "
                                        : kind == FileKind::hdf5 ? "\x89HDF\r\n\x1a\n"
                                                                 : TRY(read_whole_file(path, most_bytes)),
                                        path);
  if (is_text_table(*source.text)) return source;
  source.names = TRY(column_names(*source.text, path));
  source.text.reset();
  return source;
}

Result<CsvImport> import_columns(const CsvMap& map, const ColumnSource& source, const ColumnSource* accel) {
  Importer importer(map);
  TRY(importer.read(source, accel == nullptr));
  if (accel != nullptr) TRY(importer.read_accel(*accel));
  return importer.finish();
}

Result<CsvImport> import_csv(const CsvMap& map, const std::string& path) {
  const ColumnSource source = TRY(open_columns(path, map.topic, map.format.skip_bad_rows));
  return import_columns(map, source);
}

Status write_recording(const CsvImport& content, const std::string& path) {
  RecordingWriter writer = TRY(RecordingWriter::create(path, content.info));
  TRY(writer.add(content.samples));
  return writer.finish();
}

}  // namespace turncal
