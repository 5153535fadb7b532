#include "imu_io/recordings/csv_map_import.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <span>

#include <Eigen/Core>

#include <fmt/format.h>

#include "calib/statistics/clipping.h"
#include "calib/statistics/numerics.h"
#include "imu_io/base/file_kind.h"
#include "imu_io/base/files.h"
#include "imu_io/base/key_value.h"
#include "imu_io/base/text.h"
#include "imu_io/recordings/recording_check.h"
#include "imu_io/recordings/ros_bag.h"
#include "imu_io/recordings/stamps.h"

namespace turncal {
namespace {

// ---- the map ----

CsvTriad read_triad(KeyValueFile& file, const std::string& name, const std::vector<std::string>& units) {
  CsvTriad triad;
  const std::vector<std::string> columns = file.list(name + ".columns");
  if (columns.size() == 3)
    std::ranges::copy(columns, triad.columns.begin());
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

const std::map<std::string, double> unit_seconds = {{"s", 1.0}, {"ms", 1e-3}, {"us", 1e-6}, {"ns", 1e-9}};

void read_clocks(KeyValueFile& file, CsvMap& map) {
  const std::vector<std::string> columns = file.list_or("time.column", {}), units = file.list_or("time.unit", {"s"});
  map.accel_time_columns = file.list_or("accel.time.column", columns);
  if (map.accel_time_columns.size() != columns.size()) file.reject("accel.time.column", "as many as in time.column");
  if (!columns.empty() && units.size() != columns.size())
    return file.reject("time.unit", "a unit for each column of time.column");
  for (const std::string& column : columns) {
    const std::string unit = ascii_units(units[map.clocks.size()]);
    const auto known = unit_seconds.find(unit);
    const double unit_s = known == unit_seconds.end() ? parse_number(unit).value_or(0.0) : known->second;
    if (!(unit_s > 0.0)) file.reject("time.unit", "a number of seconds, " + one_of(unit, {"s", "ms", "us", "ns"}));
    map.clocks.push_back({column, unit_s});
  }
}

Result<CsvMap> read_map(KeyValueFile& file) {
  CsvMap map;
  map.gyro = read_triad(file, "gyro", {"rad/s", "deg/s", "deg/h", "mrad/s", "mdeg/s", "rad", "deg", "arcsec"});
  map.accel = read_triad(file, "accel", {"m/s^2", "cm/s^2", "g", "mg", "m/s"});
  const std::string delimiter = file.one_of_or("csv.delimiter", "comma", {"comma", "semicolon", "tab", "space"});
  map.format.delimiter = delimiter == "semicolon" ? ';' : delimiter == "tab" ? '\t' : delimiter == "space" ? ' ' : ',';
  map.format.decimal_comma = file.one_of_or("csv.decimal", "point", {"point", "comma"}) == "comma";
  if (map.format.decimal_comma && map.format.delimiter == ',')
    file.reject("csv.decimal", "point where csv.delimiter is comma");
  map.format.header_lines = int(file.integer_or("csv.header_lines", 1, 0, 1000));
  read_clocks(file, map);
  if (file.has("time.increments"))
    map.increments = file.one_of("time.increments", {"intervals", "period"}) == "period"
                         ? CsvMap::Increments::period
                         : CsvMap::Increments::intervals;
  map.gap = file.number_or("time.gap", 1.5, at_least(1.1));
  if (map.clocks.empty())
    map.rate_hz = file.number("rate_hz", sample_rate_hz);
  else if (file.has("rate_hz"))
    file.reject("rate_hz", "no rate beside time.column: the rate comes from the times");
  if (map.clocks.empty())
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

constexpr double most_back = 5.0;  // usual intervals that a stamp may go back
constexpr const char* after_the_one_before =
    "a time after that of the row before; where a counter begins anew, continue it";

// A row, as it is in the file.
struct Row {
  double time = 0.0;
  Eigen::Vector3d gyro = Eigen::Vector3d::Zero(), accel = gyro;
  double temperature = std::numeric_limits<double>::quiet_NaN();
  std::int64_t line = 0;  // in the file
};

// Marks a sample as clipped. Readers that know no axes set its turn aside as invalid.
void mark_clipped(ImuSample& sample, int axis) { sample.flags |= gyro_clipped_flag(axis) | sample_flag_invalid; }

Eigen::Vector3d three_of(const NumberTable& table, std::size_t row, std::size_t first, std::size_t step) {
  return {table.columns[first][row], table.columns[first + step][row], table.columns[first + 2 * step][row]};
}

// Makes samples of an even clock from increments over intervals of any length: a sample is their integral over its period.
class EvenGrid {
 public:
  // Adds an increment from begin_s to end_s, and calls emit(sample) for each period that it completes. A period with an unknown part gives no sample.
  template <class Emit>
  Status add(const ImuSample& row, double begin_s, double end_s, double period_s, Emit emit) {
    const double within = 1e-6;  // of a period
    if (begin_s > known_s_ + within * period_s) {
      at_ = std::int64_t(std::ceil(begin_s / period_s - within));
      known_s_ = double(at_) * period_s;
      sum_ = {};
    }
    for (;; ++at_, sum_ = {}) {
      const double whole_s = double(at_ + 1) * period_s,
                   to_s = std::clamp(whole_s, known_s_, std::max(known_s_, end_s));
      const double part = (to_s - known_s_) / (end_s - begin_s);
      for (std::size_t channel = 0; channel < 6; ++channel)
        channel_of(sum_, channel) += part * channel_of(row, channel);
      if (part > within) sum_.flags |= row.flags;
      known_s_ = to_s;
      if (end_s < whole_s - within * period_s) return {};
      sum_.counter = at_ + 1;
      sum_.temperature_c = row.temperature_c;
      TRY(emit(sum_));
    }
  }

 private:
  std::int64_t at_ = 0;
  double known_s_ = -std::numeric_limits<double>::infinity();
  ImuSample sum_;
};

// Reads the rows twice, for the stamps and for the samples, and once more if stamps repeat, to find rows that were written twice.
class Importer {
 public:
  Importer(const CsvMap& map, const ColumnSource& source, const ColumnSource* accel)
      : map_(map), source_(source), accel_source_(accel) {}

  Result<CsvImport> run(const ImportBegin& begin, const RecordingSource::Sink& sink) {
    sink_ = sink;
    RecordingInfo& info = result_.info;
    result_.note = source_.note;
    info.latitude_deg = map_.latitude_deg;
    info.gravity_mps2 = map_.gravity_mps2;
    info.unit_serial = map_.unit_serial;
    info.gyro_increment = info.accel_increment = IncrementKind::physical;
    info.started_utc_s = map_.started_utc_s ? map_.started_utc_s : source_.started_utc_s;
    TRY(want_columns());
    TRY(scan());
    TRY(mark_rows());
    TRY(leave_out_doubles());
    TRY(leave_out_ahead());
    choose();
    TRY(order_rows());
    std::vector<Mark>().swap(marks_);
    if (accel_source_ != nullptr) TRY(read_accel());
    if (rows_ < 10) {
      TRY(each_row([](std::size_t, const Row&) { return Status(); }));  // its error names a missing column
      return input_error(source_.file_name + ": expected at least 10 rows of data, found " + std::to_string(rows_));
    }
    TRY(make_intervals());
    std::vector<double>().swap(times_);
    result_.rows = std::int64_t(rows_) + result_.bad_rows + result_.without_accel;
    TRY(check_info(info, source_.file_name));
    begin(result_);
    TRY(make_samples());
    return std::move(result_);
  }

 private:
  bool timed() const { return !map_.clocks.empty(); }
  bool measured() const { return map_.increments == CsvMap::Increments::intervals; }

  Status want_columns() {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      wanted_.push_back({map_.gyro.columns[axis]});
      if (accel_source_ == nullptr) wanted_.push_back({map_.accel.columns[axis]});
    }
    time_ = wanted_.size();
    for (const CsvClock& clock : map_.clocks) wanted_.push_back({clock.column});
    temperature_ = wanted_.size();
    if (!map_.temperature_column.empty()) wanted_.push_back({map_.temperature_column, true});
    return check_once_each(source_, wanted_);
  }

  static Status check_once_each(const ColumnSource& source, const std::vector<WantedColumn>& wanted) {
    for (auto column = wanted.begin(); column != wanted.end(); ++column)
      if (std::ranges::find(wanted.begin(), column, column->name, &WantedColumn::name) != column)
        return input_error(source.file_name + ": the map uses column " + quoted(column->name) +
                           " twice: expected each column once");
    return {};
  }

  // Returns the seconds since the first stamp; stamps such as 1.7e15 us would be rounded in seconds. `first` is the place of the clocks' columns.
  double time_of(const NumberTable& block, std::size_t first, std::size_t row) {
    double time_s = 0.0;
    for (std::size_t k = 0; k < map_.clocks.size(); ++k) {
      const double stamp = block.columns[first + k][row];
      if (k == first_stamp_.size()) first_stamp_.push_back(stamp);
      time_s += (stamp - first_stamp_[k]) * map_.clocks[k].unit_s;
    }
    return time_s;
  }

  // Visits every row that is not left out, with its number among them, from 0.
  template <class Visit>
  Status each_row(Visit visit) {
    std::size_t number = 0, kept = 0;
    Row row;
    const std::size_t step = accel_source_ == nullptr ? 2 : 1;
    return source_.read(wanted_, map_.format, [&](const NumberTable& block) -> Status {
      for (std::size_t k = 0; k < block.rows(); ++k) {
        if (out_[number++]) continue;
        row.gyro = three_of(block, k, 0, step);
        if (step == 2) row.accel = three_of(block, k, 1, step);
        row.time = time_of(block, time_, k);
        if (temperature_ < wanted_.size())
          row.temperature = (block.columns[temperature_][k] - map_.temperature_offset) * map_.temperature_scale;
        row.line = block.line[k];
        TRY(visit(kept++, row));
      }
      return {};
    });
  }

  // Reads the stamps alone. A bad row ends the import in a later pass, unless bad rows are left out.
  Status scan() {
    constexpr std::uint64_t most_reserved = std::uint64_t{1} << 26;
    if (timed()) times_.reserve(std::min(source_.likely_rows, most_reserved));
    // In a table without times the first column tells the number of rows.
    const auto first = wanted_.begin() + std::ptrdiff_t(timed() ? time_ : 0);
    const bool all = map_.format.skip_bad_rows;
    TableFormat format = map_.format;
    format.only_wanted = !all;
    const std::vector<WantedColumn> stamps(first, first + std::max<std::ptrdiff_t>(1, std::ssize(map_.clocks)));
    std::int64_t position = -1;
    TRY(source_.read(all ? wanted_ : stamps, format, [&](const NumberTable& block) {
      count_bad(block.bad_rows, block.first_bad);
      for (std::size_t k = 0; k < block.rows(); ++k, ++rows_) {
        if (!timed() && rows_ > 0 && block.position[k] > position + 1)
          missing_.push_back({rows_, block.position[k] - position - 1});
        position = block.position[k];
        if (timed()) times_.push_back(time_of(block, all ? time_ : 0, k));
      }
      return Status();
    }));
    out_.resize(rows_);
    return {};
  }

  void count_bad(std::int64_t rows, const std::string& first) {
    if (result_.bad_rows == 0) result_.first_bad = first;
    result_.bad_rows += rows;
  }

  // Counts rows with a defect, or returns the defect of the first.
  Status leave_out(std::int64_t rows, const Error& first) {
    if (!map_.format.skip_bad_rows) return first;
    count_bad(rows, first.message);
    return {};
  }

  // What becomes of a row. A lost row was a sample, so its number is left out.
  enum class Fate : char { kept, left_out, lost };

  void sieve(const std::vector<Fate>& fates) {
    std::vector<StampGap> missing;
    std::size_t kept = 0;
    std::int64_t skipped = 0;
    for (std::size_t row = 0, k = 0, at = 0; row < out_.size(); ++row) {
      if (out_[row]) continue;
      if (at < missing_.size() && missing_[at].row == k) skipped += missing_[at++].periods;
      out_[row] = fates[k] != Fate::kept;
      if (out_[row]) {
        skipped += fates[k] == Fate::lost ? 1 : 0;
      } else {
        if (skipped > 0 && kept > 0) missing.push_back({kept, skipped});
        skipped = 0;
        if (timed()) times_[kept] = times_[k];
        if (!marks_.empty()) marks_[kept] = marks_[k];
        ++kept;
      }
      ++k;
    }
    missing_ = std::move(missing);
    if (kept < rows_) stamps_.reset();
    rows_ = kept;
    if (timed()) times_.resize(kept);
  }

  // Marks rows by their numbers if their times do not tell them apart.
  Status mark_rows() {
    if (std::ranges::adjacent_find(times_, std::greater_equal()) == times_.end()) return {};
    marks_.reserve(rows_);
    return each_row([&](std::size_t, const Row& row) {
      const auto bytes = [](const Eigen::Vector3d& v) {
        return std::hash<std::string_view>()({reinterpret_cast<const char*>(v.data()), 3 * sizeof(double)});
      };
      marks_.push_back({bytes(row.gyro) ^ (bytes(row.accel) << 1), row.line});
      return Status();
    });
  }

  // Leaves out rows that were written twice, with the stamp and numbers of the row before. A coarse sensor repeats itself at new stamps as often.
  Status leave_out_doubles() {
    std::vector<Fate> fates(rows_);
    double doubles = 0.0, same_stamps = 0.0, repeats = 0.0;  // repeats: the numbers of the row before at another stamp
    std::int64_t first = 0;                                  // line
    for (std::size_t k = 1; k < marks_.size(); ++k) {
      const bool same_time = times_[k] == times_[k - 1], same_numbers = marks_[k].numbers == marks_[k - 1].numbers;
      same_stamps += same_time ? 1.0 : 0.0;
      repeats += same_numbers && !same_time ? 1.0 : 0.0;
      if (!same_numbers || !same_time) continue;
      if (doubles++ == 0.0) first = marks_[k].line;
      fates[k] = Fate::left_out;
    }
    if (doubles * (double(rows_) - 1.0 - same_stamps) <= 2.0 * repeats * same_stamps) return {};
    TRY(leave_out(std::int64_t(doubles),
                  input_error("{}:{}: repeats the row before, time and numbers, as {} of {} rows do: expected each row "
                              "once; --skip-bad-rows leaves them out",
                              source_.file_name, first, std::int64_t(doubles), rows_)));
    sieve(fates);
    return {};
  }

  // Rows whose time is ahead, where twice as many rows go on from the time before them as there are.
  Status leave_out_ahead() {
    if (std::ranges::is_sorted(times_)) return {};
    const double far = most_back * usual_step();
    std::vector<std::size_t> kept;
    std::vector<Fate> fates(rows_);
    for (std::size_t k = 0; k < rows_;) {
      const auto ahead =
          std::ranges::upper_bound(kept, times_[k] + far, {}, [&](std::size_t row) { return times_[row]; });
      const auto enough = k + 2 * std::size_t(kept.end() - ahead);
      std::size_t behind = k;
      while (ahead != kept.end() && behind < rows_ && behind <= enough && times_[behind] + far < times_[*ahead])
        ++behind;
      if (behind > k && (ahead == kept.begin() || behind <= enough)) {
        k = behind;
        continue;
      }
      for (auto row = ahead; row != kept.end(); ++row) fates[*row] = Fate::left_out;
      kept.erase(ahead, kept.end());
      if (kept.empty() || times_[k] >= times_[kept.back()]) kept.push_back(k);
      ++k;
    }
    const auto first = std::ranges::find(fates, Fate::left_out);
    if (first == fates.end()) return {};
    TRY(leave_out(std::ranges::count(fates, Fate::left_out),
                  wrong_time(std::size_t(first - fates.begin()), "a time before those of the rows after it")));
    sieve(fates);
    return {};
  }

  double usual_step() const {
    std::vector<double> steps = intervals_of(times_);
    for (double& step : steps) step = std::abs(step);
    return median(steps);
  }

  // The reading of the rows that are kept so far.
  StampModel& stamps() {
    if (!stamps_) stamps_ = fit_stamps(times_, map_.gap);
    return *stamps_;
  }

  void choose() {
    if (!timed() || map_.increments != CsvMap::Increments::chosen) return;
    const IncrementsChoice choice = choose_increments(times_, stamps());
    map_.increments = choice.even ? CsvMap::Increments::period : CsvMap::Increments::intervals;
    sure_ = choice.sure;
    result_.chosen = fmt::format("time.increments = {}: {}", measured() ? "intervals" : "period", choice.reason);
  }

  // Leaves out rows whose time does not increase; with `period` it may step back within the scatter. A row with the time of another one but other
  // numbers was sampled while the clock was behind. With the same numbers it was written twice, and with a time of its own it is out of place.
  Status order_rows() {
    if (!timed() || rows_ < 2 ||
        (measured() ? std::ranges::is_sorted(times_, std::less_equal()) : std::ranges::is_sorted(times_)))
      return {};
    constexpr double widest = 12.0;
    const double usual = usual_step();
    double back = 0.0;
    if (!measured()) {  // a delayed row leaves its place empty; one out of place does not
      std::vector<double> sorted = times_;
      std::ranges::sort(sorted);
      sorted.erase(std::unique(sorted.begin(), sorted.end()), sorted.end());
      const auto uneven = [usual](std::span<const double> times) {
        const auto is_uneven = [usual](double interval) { return std::abs(interval - usual) > 0.25 * usual; };
        return std::ranges::count_if(intervals_of(times, times.size()), is_uneven);
      };
      back = uneven(sorted) < uneven(times_) ? std::clamp(widest * stamps().scatter - 1.0, 0.0, most_back) * usual
                                             : most_back * usual;
    }
    std::vector<std::size_t> kept{0};
    std::vector<Fate> fates(rows_);
    std::int64_t out = 0;
    std::size_t first = 0;
    for (std::size_t k = 1; k < rows_; ++k) {
      const double least = times_[kept.back()] - back;
      if (times_[k] > least || (times_[k] == least && !measured() && fates[k - 1] == Fate::kept)) {
        kept.push_back(k);
        continue;
      }
      const auto same =
          std::ranges::lower_bound(kept, times_[k] - 0.5 * usual, {}, [&](std::size_t row) { return times_[row]; });
      const bool is_other =
          same != kept.end() && times_[*same] < times_[k] + 0.5 * usual && marks_[*same].numbers != marks_[k].numbers;
      fates[k] = is_other ? Fate::lost : Fate::left_out;
      if (out++ == 0) first = k;
    }
    constexpr std::size_t fewest = 10;
    if (const std::size_t stay = rows_ - 1 - kept.back(); stay >= fewest)
      return wrong_time(kept.back() + 1,
                        "a time that goes on: all rows from here are behind; where a counter begins "
                        "anew, continue it");
    if (out > 0) TRY(leave_out(out, wrong_time(first, after_the_one_before)));
    sieve(fates);
    return {};
  }

  // Reports the time in the unit of the first clock.
  Error wrong_time(const ColumnSource& source, std::int64_t line, const std::string& column, double time_s,
                   const char* expected) const {
    for (std::size_t k = 1; k < map_.clocks.size(); ++k) time_s += first_stamp_[k] * map_.clocks[k].unit_s;
    return input_error("{}:{}: column {} = '{}': expected {}", source.file_name, line, quoted(column),
                       format_number(first_stamp_[0] + time_s / map_.clocks[0].unit_s), expected);
  }
  Error wrong_time(std::size_t row, const char* expected) const {
    return wrong_time(source_, marks_[row].line, map_.clocks[0].column, times_[row], expected);
  }

  Status read_accel() {
    const ColumnSource& source = *accel_source_;
    std::vector<WantedColumn> wanted;
    for (const std::string& name : map_.accel.columns) wanted.push_back({name});
    for (const std::string& name : map_.accel_time_columns) wanted.push_back({name});
    TRY(check_once_each(source, wanted));
    NumberTable table;
    TRY(source.read(wanted, map_.format, [&](const NumberTable& block) {
      count_bad(block.bad_rows, block.first_bad);
      append_rows(table, block);
      return Status();
    }));
    const std::size_t n = table.rows();
    const auto numbers = [&](std::size_t row) { return three_of(table, row, 0, 1); };
    std::vector<double> time;
    std::vector<StampGap> missing;
    for (std::size_t k = 0; k < n; ++k) {
      if (timed()) time.push_back(time_of(table, 3, k));
      if (k > 0 && table.position[k] > table.position[k - 1] + 1)
        missing.push_back({k, table.position[k] - table.position[k - 1] - 1});
    }
    if (timed() ? time == times_ : n == rows_ && missing == missing_) {
      for (std::size_t k = 0; k < n; ++k) accel_.push_back(numbers(k));
      return {};
    }
    if (!timed())
      return input_error("{}: {}: expected {}, as in {}, or time.column", source.file_name, counted(n, "row"), rows_,
                         source_.file_name);
    for (std::size_t k = 1; k < n; ++k)
      if (!(time[k] > time[k - 1]))
        return wrong_time(source, table.line[k], map_.accel_time_columns[0], time[k], after_the_one_before);
    const auto common =
        std::ranges::count_if(time, [&](double t) { return rows_ > 0 && t >= times_.front() && t <= times_.back(); });
    if (common < 10)
      return input_error(
          "{}: {} of {} rows fall into the time of {}: expected at least 10, with times in the same unit",
          source.file_name, common, n, source_.file_name);
    // Nothing is known in an interval with missing rows.
    std::vector<bool> lost(n);
    for (const StampGap& gap : missing) lost[gap.row] = true;
    for (const StampGap& gap : fit_stamps(time, map_.gap).gaps) lost[gap.row] = true;
    const double period = stamps().period;
    const auto interval_of = [&](auto first_row) { return std::min(std::size_t(first_row - time.begin()), n - 1); };
    std::vector<Fate> fates(rows_);
    for (std::size_t k = 0; k < rows_; ++k) {
      const double t = times_[k];
      if (t < time.front() || t > time.back() || lost[interval_of(std::ranges::lower_bound(time, t))] ||
          lost[interval_of(std::ranges::upper_bound(time, t - period))])
        fates[k] = Fate::lost;
    }
    result_.without_accel = std::ssize(fates) - std::ranges::count(fates, Fate::kept);
    sieve(fates);
    // Integrates from each of the gyros' stamps to the next, and behind a gap over one period. A number is the mean over the interval that it ends.
    const bool rate = map_.accel.is_rate;
    for (std::size_t k = 0; k < rows_; ++k) {
      const double t = times_[k], since = k == 0 || t - times_[k - 1] > map_.gap * period ? t - period : times_[k - 1];
      Eigen::Vector3d sum = Eigen::Vector3d::Zero();
      double covered = 0.0;
      for (std::size_t at = std::max<std::size_t>(1, interval_of(std::ranges::upper_bound(time, since)));
           at < n && time[at - 1] < t; ++at) {
        const double part = std::min(t, time[at]) - std::max(since, time[at - 1]);
        sum += numbers(at) * (rate ? part : part / (time[at] - time[at - 1]));
        covered += part;
      }
      accel_.push_back(covered > 0.0 ? Eigen::Vector3d(sum * ((rate ? 1.0 : t - since) / covered))
                                     : numbers(interval_of(std::ranges::lower_bound(time, t))));
    }
    return {};
  }

  Status make_intervals() {
    double& period = result_.info.sample_period_s;
    if (!timed()) {
      period = 1.0 / map_.rate_hz;
      for (const StampGap& gap : missing_) gaps_.push_back({gap.row, gap.periods + 1});
      return {};
    }
    const StampModel read = measured() ? real_intervals(times_, map_.gap) : stamps();
    if (!sure_ || (!read.sure && !(measured() && result_.chosen.empty())))
      return input_error(
          "{}: the stamps scatter by {:.2g} of a period of {:.4g} s, and {} of {} rows come behind a gap: another "
          "reading explains them as well: expected time.increments = intervals, or rate_hz in place of time.column",
          source_.file_name, read.scatter, read.period, read.gaps.size(), rows_);
    double sum = 0.0, squares = 0.0, count = 0.0;
    std::int64_t periods = 0;
    for (std::size_t k = 1, f = 0, m = 0; k < rows_; ++k) {
      std::int64_t steps = 1;
      if (f < read.gaps.size() && read.gaps[f].row == k) steps = read.gaps[f++].periods;
      periods += steps;  // by the stamps
      if (m < missing_.size() && missing_[m].row == k) steps = std::max(steps, missing_[m++].periods + 1);
      if (steps > 1) {
        gaps_.push_back({k, steps});
        continue;
      }
      const double interval = times_[k] - times_[k - 1];
      sum += interval;
      squares += interval * interval;
      count += 1.0;
    }
    period = sum / count;
    result_.jitter_s = std::sqrt(std::max(0.0, squares / count - period * period));
    if (!measured()) {
      period = stamps().period;
      const double passed = times_.back() - times_.front(), counted = double(periods) * period, late_periods = 16.0;
      if (std::abs(counted - passed) > (late_periods + 4.0 * stamps().scatter) * period + steady_rate * passed)
        return input_error(
            "{}: {:.6g} s by the stamps, and {:.6g} s by rows and gaps: expected "
            "time.increments = intervals, or rate_hz in place of time.column",
            source_.file_name, passed, counted);
    }
    result_.gaps = std::int64_t(gaps_.size());
    const double per_row = period / std::ranges::min(map_.clocks, {}, &CsvClock::unit_s).unit_s;
    if (!sample_rate_hz.contains(1.0 / period))
      return input_error(
          "{}: {:.4g} from row to row is {:.4g} Hz in s, {:.4g} in ms, {:.4g} in us, {:.4g} in ns: "
          "expected a time.unit with {} to {} Hz",
          source_.file_name, per_row, 1.0 / per_row, 1e3 / per_row, 1e6 / per_row, 1e9 / per_row, sample_rate_hz.min,
          sample_rate_hz.max);
    return {};
  }

  // Turns a row into a sample, or into its part of the samples of an even clock. A row with saturated accelerometers is dropped.
  Status add_sample(const Row& row, const Eigen::Vector3d& accel, std::int64_t counter, double dt) {
    const auto saturated = [](const CsvTriad& triad, double x) {
      return x <= triad.range_low || x >= triad.range_high;
    };
    const auto increment = [dt](const CsvTriad& triad, const Eigen::Vector3d& numbers, std::size_t body) {
      const auto from = std::size_t(triad.axes.from[body]);
      return triad.axes.sign[body] * (numbers[triad.axes.from[body]] - triad.offset[from]) * triad.scale[from] *
             (triad.is_rate ? dt : 1.0);
    };
    ImuSample sample;
    const auto number = std::int64_t(written_ + samples_.size());
    sample.counter = measured() ? std::ssize(sample_of_) : number;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const int from = map_.gyro.axes.from[axis];
      sample.gyro[axis] = row.gyro[from] - map_.gyro.offset[std::size_t(from)];
    }
    const bool dropped = std::ranges::any_of(accel, [&](double x) { return saturated(map_.accel, x); });
    if (!dropped) clipping_.add(sample);
    for (std::size_t axis = 0; axis < 3; ++axis)
      if (saturated(map_.gyro, row.gyro[map_.gyro.axes.from[axis]])) mark_clipped(sample, int(axis));
    if (sample.flags != 0 || dropped) ++result_.saturated;
    if (dropped) return {};
    if (measured()) sample_of_.push_back(number);
    sample.counter = counter;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      sample.gyro[axis] = increment(map_.gyro, row.gyro, axis);
      sample.accel[axis] = increment(map_.accel, accel, axis);
    }
    sample.temperature_c = float(row.temperature);
    result_.info.has_temperature = result_.info.has_temperature || !std::isnan(row.temperature);
    const auto keep = [this](const ImuSample& whole) {
      constexpr std::size_t enough = 4096;
      samples_.push_back(whole);
      return samples_.size() < enough ? Status() : hand_over();
    };
    if (!measured()) return keep(sample);
    const double end_s = row.time + went_on_s_;
    return grid_.add(sample, end_s - dt, end_s, result_.info.sample_period_s, keep);
  }

  Status hand_over() {
    written_ += samples_.size();
    if (!samples_.empty()) TRY(sink_(samples_));
    samples_.clear();
    return {};
  }

  Status make_samples() {
    const double period = result_.info.sample_period_s;
    std::int64_t counter = 0;
    std::size_t at = 0;
    double before_s = 0.0;
    TRY(each_row([&](std::size_t k, const Row& row) -> Status {
      const bool is_gap = at < gaps_.size() && gaps_[at].row == k;
      const std::int64_t periods = k == 0 ? 0 : is_gap ? gaps_[at++].periods : 1;
      counter += periods;
      if (is_gap)
        went_on_s_ +=
            double(periods - std::max<std::int64_t>(1, std::llround((row.time - before_s) / period))) * period;
      const double dt = measured() && k > 0 && !is_gap ? row.time - before_s : period;
      before_s = row.time;
      return add_sample(row, accel_.empty() ? row.accel : accel_[k], counter, dt);
    }));
    TRY(hand_over());
    result_.clipped_runs = clipping_.finish();
    if (measured())
      for (DataEvent& run : result_.clipped_runs) {  // counted in rows so far
        const std::int64_t after = run.sample + run.count;
        run.sample = sample_of_[std::size_t(run.sample)];
        run.count =
            (after < std::ssize(sample_of_) ? sample_of_[std::size_t(after)] : std::int64_t(written_)) - run.sample;
      }
    if (written_ > 0) return {};
    return input_error(source_.file_name + ": every row is saturated; look at gyro.range and accel.range");
  }

  CsvMap map_;
  const ColumnSource& source_;
  const ColumnSource* accel_source_;
  std::vector<WantedColumn> wanted_;
  std::size_t time_ = 0, temperature_ = 0;  // places in wanted_
  std::vector<double> first_stamp_;         // by clock
  RecordingSource::Sink sink_;
  std::vector<ImuSample> samples_;  // not handed over yet
  std::size_t written_ = 0;
  std::size_t rows_ = 0;  // number of rows that are kept
  std::vector<double> times_;
  struct Mark {
    std::size_t numbers = 0;  // hash
    std::int64_t line = 0;
  };
  std::vector<Mark> marks_;             // by row, if times do not tell rows apart
  std::vector<StampGap> missing_;       // samples before a row that the file lacks or has with a defect
  std::vector<bool> out_;               // whether a row is left out, by row read
  std::vector<Eigen::Vector3d> accel_;  // from a file of their own
  std::optional<StampModel> stamps_;
  bool sure_ = true;                     // of the choice that the stamps made
  std::vector<StampGap> gaps_;           // rows with more than one period before them
  EvenGrid grid_;                        // used if measured()
  double went_on_s_ = 0.0;               // time that the sampling went on while the stamps did not
  std::vector<std::int64_t> sample_of_;  // in which a row begins, by row
  ClippingFinder clipping_;              // sees the numbers of the file, which repeat whatever the intervals are
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
  source.likely_rows = bag.message.size();
  source.read = [bag = std::make_shared<const BagImu>(std::move(bag)), name = source.file_name, names = source.names](
                    const std::vector<WantedColumn>& wanted, const TableFormat&, const TableSink& sink) -> Status {
    std::vector<const double*> columns;
    for (const WantedColumn& column : wanted) {
      const auto at = std::ranges::find(bag->columns, column.name, &NumberColumn::name);
      if (at == bag->columns.end())
        return input_error("{}: no column {}: expected {}", name, quoted(column.name), one_of(column.name, names));
      columns.push_back(at->values.data());
    }
    constexpr std::size_t most = std::size_t{1} << 14;
    NumberTable block;
    block.columns.resize(columns.size());
    block.bad_rows = bag->bad;
    block.first_bad = bag->first_bad;
    for (std::size_t row = 0; row < bag->message.size(); row += most, block.bad_rows = 0) {
      const std::size_t end = std::min(row + most, bag->message.size());
      for (std::size_t k = 0; k < columns.size(); ++k) block.columns[k].assign(columns[k] + row, columns[k] + end);
      block.position.assign(bag->message.begin() + std::ptrdiff_t(row), bag->message.begin() + std::ptrdiff_t(end));
      block.line = block.position;
      for (std::int64_t& line : block.line) ++line;
      TRY(sink(block));
    }
    return {};
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

Result<ColumnSource> open_columns(const std::string& path, const std::string& topic, bool skip_bad) {
  const FileKind kind = recognise_file(path);
  if (is_bag(kind)) return columns_of_bag(path, TRY(read_bag(path, topic, skip_bad)));
  if (!topic.empty()) return input_error(path + ": topic " + quoted(topic) + ": expected a ROS bag");
  TRY(expect_file(path, FileKind::csv));
  constexpr std::uint64_t most_head = std::uint64_t{1} << 18, least_row = 12;  // bytes; the shortest row of six numbers
  TableBytes bytes = TRY(bytes_of_file(path));
  ColumnSource source;
  source.file_name = path;
  source.likely_rows = bytes.size / least_row;
  if (const std::string_view head = TRY(bytes.at(0, most_head)); is_text_table(head))
    source.head = head.substr(0, most_head);
  else
    source.names = TRY(column_names(bytes, path));
  source.read = [bytes = std::move(bytes), path](const std::vector<WantedColumn>& wanted, const TableFormat& format,
                                                 const TableSink& sink) {
    return read_number_table(bytes, path, wanted, format, sink);
  };
  return source;
}

Result<CsvImport> stream_columns(const CsvMap& map, const ColumnSource& source, const ColumnSource* accel,
                                 const ImportBegin& begin, const RecordingSource::Sink& sink) {
  return Importer(map, source, accel).run(begin, sink);
}

Result<CsvImport> import_columns(const CsvMap& map, const ColumnSource& source, const ColumnSource* accel) {
  std::vector<ImuSample> all;
  Result<CsvImport> content = stream_columns(
      map, source, accel, [&](const CsvImport& found) { all.reserve(std::size_t(found.rows)); },
      [&](std::span<const ImuSample> samples) {
        all.insert(all.end(), samples.begin(), samples.end());
        return Status();
      });
  if (!content) return content;
  for (const DataEvent& run : content->clipped_runs)
    for (std::int64_t k = run.sample; k < run.sample + run.count; ++k) {
      ImuSample& sample = all[std::size_t(k)];
      content->clipped += sample.flags == 0 ? 1 : 0;
      mark_clipped(sample, run.axis);
    }
  content->samples = std::move(all);
  return content;
}

Result<CsvImport> import_csv(const CsvMap& map, const std::string& path) {
  const ColumnSource source = TRY(open_columns(path, map.topic, map.format.skip_bad_rows));
  return import_columns(map, source);
}

}  // namespace turncal
