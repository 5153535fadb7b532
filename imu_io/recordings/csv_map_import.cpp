#include "imu_io/recordings/csv_map_import.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "calib/model/parameters.h"
#include "imu_io/base/format_number.h"
#include "imu_io/base/key_value.h"
#include "imu_io/base/posix_file.h"
#include "imu_io/base/text_pieces.h"
#include "imu_io/recordings/recording_check.h"
#include "imu_io/recordings/recording_writer.h"

namespace turncal {
namespace {

struct Unit {
  const char* name;
  double si;
  bool is_rate;
};
constexpr Unit gyro_units[] = {{"rad/s", 1.0, true}, {"deg/s", rad_per_deg, true}, {"deg/h", radps_per_degph, true},
                               {"rad", 1.0, false},  {"deg", rad_per_deg, false},  {"arcsec", rad_per_arcsec, false}};
constexpr Unit accel_units[] = {{"m/s^2", 1.0, true},
                                {"g", standard_gravity_mps2, true},
                                {"mg", 1e-3 * standard_gravity_mps2, true},
                                {"m/s", 1.0, false}};

std::array<double, 3> one_or_three(KeyValueFile& file, const std::string& key, double otherwise) {
  const std::vector<double> values = file.numbers_or(key, {otherwise}, 0);
  if (values.size() == 1) return {values[0], values[0], values[0]};
  if (values.size() == 3) return {values[0], values[1], values[2]};
  file.reject(key, "one number or three");
  return {};
}

template <std::size_t N>
CsvTriad read_triad(KeyValueFile& file, const std::string& name, const Unit (&units)[N]) {
  CsvTriad triad;
  const std::vector<std::string> columns = file.list(name + ".columns");
  if (columns.size() == 3)
    std::copy(columns.begin(), columns.end(), triad.columns.begin());
  else if (file.has(name + ".columns"))
    file.reject(name + ".columns", "three columns, by name or number");
  const std::string unit_key = name + ".unit";
  const std::string unit_name = file.text(unit_key);
  const auto unit =
      std::find_if(std::begin(units), std::end(units), [&](const Unit& u) { return unit_name == u.name; });
  triad.scale = one_or_three(file, name + ".scale", 1.0);
  triad.offset = one_or_three(file, name + ".offset", 0.0);
  if (unit != std::end(units)) {
    triad.is_rate = unit->is_rate;
    for (double& scale : triad.scale) scale *= unit->si;
  } else {
    std::string expected = "one of";
    for (const Unit& u : units) expected += std::string(&u == units ? " " : ", ") + u.name;
    if (file.has(unit_key)) file.reject(unit_key, expected);
  }
  const std::string axes_key = name + ".axes";
  const std::vector<std::string> axes = file.list_or(axes_key, {"+x", "+y", "+z"});
  std::array<bool, 3> used{};
  bool good = axes.size() == 3;
  for (std::size_t k = 0; good && k < 3; ++k) {
    std::string_view axis = axes[k];
    triad.sign[k] = axis.starts_with('-') ? -1.0 : 1.0;
    if (axis.starts_with('-') || axis.starts_with('+')) axis.remove_prefix(1);
    const std::size_t from = axis.size() == 1 ? std::string_view("xyz").find(axis[0]) : std::string_view::npos;
    good = from != std::string_view::npos && !used[from];
    if (good) {
      triad.from[k] = static_cast<int>(from);
      used[from] = true;
    }
  }
  if (!good) file.reject(axes_key, "x, y and z once each, with sign, as in +x, -z, +y");
  const std::vector<double> range = file.numbers_or(name + ".range", {triad.range_low, triad.range_high}, 2);
  if (range.size() == 2) {
    triad.range_low = range[0];
    triad.range_high = range[1];
    if (!(range[0] < range[1])) file.reject(name + ".range", "the lower number before the higher");
  }
  return triad;
}

Result<CsvMap> read_map(KeyValueFile& file) {
  CsvMap map;
  map.gyro = read_triad(file, "gyro", gyro_units);
  map.accel = read_triad(file, "accel", accel_units);
  const std::string delimiter = file.one_of_or("csv.delimiter", "comma", {"comma", "semicolon", "tab", "space"});
  map.delimiter = delimiter == "semicolon" ? ';' : delimiter == "tab" ? '\t' : delimiter == "space" ? ' ' : ',';
  map.header_lines = static_cast<int>(file.integer_or("csv.header_lines", 1, 0, 1000));
  map.time_column = file.text_or("time.column", "");
  const std::string unit = file.one_of_or("time.unit", "s", {"s", "ms", "us", "ns"});
  map.time_unit_s = unit == "ms" ? 1e-3 : unit == "us" ? 1e-6 : unit == "ns" ? 1e-9 : 1.0;
  map.measured_intervals = file.one_of_or("time.increments", "intervals", {"intervals", "period"}) == "intervals";
  map.gap = file.number_or("time.gap", 1.5, at_least(1.1));
  if (map.time_column.empty())
    map.rate_hz = file.number("rate_hz", positive);
  else if (file.has("rate_hz"))
    file.reject("rate_hz", "no rate beside time.column: the rate comes from the times");
  if (map.time_column.empty())
    for (const char* key : {"time.unit", "time.increments", "time.gap"})
      if (file.has(key)) file.reject(key, "time.column too");
  map.temperature_column = file.text_or("temperature.column", "");
  map.temperature_scale = file.number_or("temperature.scale", 1.0);
  map.temperature_offset = file.number_or("temperature.offset", 0.0);
  map.gravity_mps2 = file.number("gravity_mps2", between(min_gravity_mps2, max_gravity_mps2));
  map.latitude_deg = file.number_or("latitude_deg", 0.0, between(-90.0, 90.0));
  map.unit_serial = file.text("unit_serial");
  if (Status status = file.check_all_used(); !status) return status.error();
  return map;
}

class CsvReader {
 public:
  CsvReader(const CsvMap& map, std::string_view text, const std::string& file_name)
      : map_(map), text_(text), file_name_(file_name) {}
  Result<CsvImport> run();

 private:
  struct Column {
    std::size_t index = 0;
    std::string name;
  };
  Error defect(const std::string& what) const {
    return input_error(file_name_ + ":" + std::to_string(line_) + ": " + what);
  }
  void split_row(std::string_view row);
  Status find_columns();
  Result<Column> find_column(const std::string& name) const;
  Result<double> number(const Column& column) const;
  Status read_rows();
  Status read_row(std::string_view row);
  Status make_intervals();
  Status make_samples();

  struct Row {
    double time = 0.0;
    std::array<double, 3> gyro;  // as in the file
    std::array<double, 3> accel;
    double temperature = 0.0;
    std::int64_t line = 0;
  };

  const CsvMap& map_;
  std::string_view text_;
  const std::string file_name_;
  std::int64_t line_ = 0;
  std::vector<std::string_view> cells_;
  std::vector<std::string> header_;
  std::array<Column, 3> gyro_, accel_;
  std::optional<Column> time_, temperature_;
  std::vector<Row> rows_;
  double median_s_ = 0.0;
  CsvImport result_;
};

void CsvReader::split_row(std::string_view row) {
  cells_.clear();
  if (map_.delimiter == ' ') {  // any run of blanks
    for (std::size_t at = 0; at < row.size();) {
      const std::size_t from = row.find_first_not_of(" \t", at);
      if (from == std::string_view::npos) break;
      at = std::min(row.find_first_of(" \t", from), row.size());
      cells_.push_back(row.substr(from, at - from));
    }
    return;
  }
  for (std::size_t at = 0; at <= row.size();) {
    const std::size_t end = std::min(row.find(map_.delimiter, at), row.size());
    cells_.push_back(trimmed(row.substr(at, end - at)));
    at = end + 1;
  }
}

Result<CsvReader::Column> CsvReader::find_column(const std::string& name) const {
  const auto at = std::find(header_.begin(), header_.end(), name);
  if (at != header_.end()) return Column{static_cast<std::size_t>(at - header_.begin()), name};
  if (const auto index = parse_integer<std::int64_t>(name); index && *index >= 1 && *index <= 10000)
    return Column{static_cast<std::size_t>(*index - 1), name};
  return defect(
      "no column " + quoted(name) + "; the header has " + std::to_string(header_.size()) + " names" +
      (header_.empty() ? ": give column numbers, or csv.header_lines" : ", the first is " + quoted(header_.front())));
}

Status CsvReader::find_columns() {
  for (std::size_t k = 0; k < 3; ++k) {
    for (auto [triad, columns] : {std::pair(&map_.gyro, &gyro_), std::pair(&map_.accel, &accel_)}) {
      Result<Column> column = find_column(triad->columns[k]);
      if (!column) return column.error();
      (*columns)[k] = *column;
    }
  }
  for (auto [name, column] :
       {std::pair(&map_.time_column, &time_), std::pair(&map_.temperature_column, &temperature_)}) {
    if (name->empty()) continue;
    Result<Column> found = find_column(*name);
    if (!found) return found.error();
    *column = *found;
  }
  return {};
}

Result<double> CsvReader::number(const Column& column) const {
  if (column.index >= cells_.size())
    return defect("column " + quoted(column.name) + " is missing: the row has " + std::to_string(cells_.size()) +
                  " columns");
  std::string_view cell = cells_[column.index];
  if (cell.starts_with('+')) cell.remove_prefix(1);
  const std::optional<double> value = parse_number<double>(cell);
  if (!value)
    return defect("column " + quoted(column.name) + " = " + quoted(cells_[column.index]) + ": expected a number");
  return *value;
}

Status CsvReader::read_row(std::string_view text) {
  split_row(text);
  Row row;
  row.line = line_;
  for (std::size_t k = 0; k < 3; ++k) {
    Result<double> gyro = number(gyro_[k]);
    if (!gyro) return gyro.error();
    Result<double> accel = number(accel_[k]);
    if (!accel) return accel.error();
    row.gyro[k] = *gyro;
    row.accel[k] = *accel;
  }
  if (time_) {
    Result<double> time = number(*time_);
    if (!time) return time.error();
    row.time = *time * map_.time_unit_s;
    if (!rows_.empty() && !(row.time > rows_.back().time))
      return defect("column " + quoted(time_->name) + " = " + quoted(cells_[time_->index]) +
                    ": expected a time after that of the row before");
  }
  if (temperature_) {
    Result<double> temperature = number(*temperature_);
    if (!temperature) return temperature.error();
    row.temperature = (*temperature - map_.temperature_offset) * map_.temperature_scale;
  }
  rows_.push_back(row);
  return {};
}

Status CsvReader::read_rows() {
  std::string_view left = text_;
  for (int k = 0; k < map_.header_lines; ++k) {
    if (left.empty()) return defect("the file ends inside its " + std::to_string(map_.header_lines) + " header lines");
    ++line_;
    split_row(take_line(left));
  }
  if (map_.header_lines > 0) header_.assign(cells_.begin(), cells_.end());
  if (Status status = find_columns(); !status) return status;
  rows_.reserve(left.size() / 40 + 1);
  while (!left.empty()) {
    ++line_;
    const std::string_view row = take_line(left);
    if (trimmed(row).empty()) continue;
    if (Status status = read_row(row); !status) return status;
  }
  if (rows_.size() < 10) return defect("expected at least 10 rows of data, found " + std::to_string(rows_.size()));
  return {};
}

Status CsvReader::make_intervals() {
  if (!time_) {
    result_.info.sample_period_s = median_s_ = 1.0 / map_.rate_hz;
    return {};
  }
  std::vector<double> intervals;
  for (std::size_t k = 1; k < rows_.size(); ++k) intervals.push_back(rows_[k].time - rows_[k - 1].time);
  std::vector<double> sorted = intervals;
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
  std::nth_element(sorted.begin(), middle, sorted.end());
  median_s_ = *middle;
  double sum = 0.0;
  double squares = 0.0;
  double count = 0.0;
  for (const double interval : intervals)
    if (interval <= map_.gap * median_s_) {
      sum += interval;
      squares += interval * interval;
      count += 1.0;
    }
  result_.info.sample_period_s = sum / count;
  result_.jitter_s = std::sqrt(std::max(0.0, squares / count - std::pow(sum / count, 2)));
  return {};
}

Status CsvReader::make_samples() {
  const double period = result_.info.sample_period_s;
  const auto saturated = [](const CsvTriad& triad, const std::array<double, 3>& numbers) {
    return std::any_of(numbers.begin(), numbers.end(),
                       [&](double x) { return x <= triad.range_low || x >= triad.range_high; });
  };
  const auto increment = [](const CsvTriad& triad, const std::array<double, 3>& numbers, std::size_t body, double dt) {
    const auto from = static_cast<std::size_t>(triad.from[body]);
    return triad.sign[body] * (numbers[from] - triad.offset[from]) * triad.scale[from] * (triad.is_rate ? dt : 1.0);
  };
  std::int64_t counter = 0;
  result_.samples.reserve(rows_.size());
  for (std::size_t k = 0; k < rows_.size(); ++k) {
    const Row& row = rows_[k];
    double dt = period;
    if (k > 0) {
      std::int64_t step = 1;
      if (time_) {
        const double interval = row.time - rows_[k - 1].time;
        if (interval > map_.gap * median_s_) {
          step = std::max<std::int64_t>(2, std::llround(interval / period));
          ++result_.gaps;
        } else if (map_.measured_intervals) {
          dt = interval;
        }
      }
      counter += step;
    }
    if (saturated(map_.gyro, row.gyro) || saturated(map_.accel, row.accel)) {
      ++result_.saturated;
      continue;
    }
    ImuSample sample;
    sample.counter = counter;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      sample.gyro[axis] = increment(map_.gyro, row.gyro, axis, dt);
      sample.accel[axis] = increment(map_.accel, row.accel, axis, dt);
    }
    if (temperature_) sample.temperature_c = static_cast<float>(row.temperature);
    result_.samples.push_back(sample);
  }
  return {};
}

Result<CsvImport> CsvReader::run() {
  if (Status status = read_rows(); !status) return status.error();
  if (Status status = make_intervals(); !status) return status.error();
  RecordingInfo& info = result_.info;
  info.latitude_deg = map_.latitude_deg;
  info.gravity_mps2 = map_.gravity_mps2;
  info.unit_serial = map_.unit_serial;
  info.gyro_increment = IncrementKind::physical;
  info.accel_increment = IncrementKind::physical;
  info.has_temperature = temperature_.has_value();
  if (Status status = make_samples(); !status) return status.error();
  result_.rows = static_cast<std::int64_t>(rows_.size());
  if (result_.samples.empty())
    return input_error(file_name_ + ": every row is saturated; look at gyro.range and accel.range");
  if (Status status = check_info(info, file_name_); !status) return status.error();
  return std::move(result_);
}

}  // namespace

Result<CsvMap> read_csv_map(const std::string& path) {
  Result<KeyValueFile> file = KeyValueFile::read(path);
  if (!file) return file.error();
  return read_map(*file);
}

Result<CsvMap> parse_csv_map(std::string_view text, const std::string& file_name) {
  Result<KeyValueFile> file = KeyValueFile::parse(text, file_name);
  if (!file) return file.error();
  return read_map(*file);
}

Result<CsvImport> parse_csv(const CsvMap& map, std::string_view text, const std::string& file_name) {
  return CsvReader(map, text, file_name).run();
}

Result<CsvImport> import_csv(const CsvMap& map, const std::string& path) {
  Result<std::string> text = read_whole_file(path, std::size_t{4} << 30);
  if (!text) return text.error();
  return parse_csv(map, *text, path);
}

Status write_recording(const CsvImport& content, const std::string& path) {
  Result<RecordingWriter> writer = RecordingWriter::create(path, content.info);
  if (!writer) return writer.error();
  if (Status status = writer->add(content.samples); !status) return status;
  return writer->finish();
}

}  // namespace turncal
