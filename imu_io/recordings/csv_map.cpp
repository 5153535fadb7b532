#include "imu_io/recordings/csv_map.h"

#include <algorithm>
#include <iterator>

#include "calib/model/parameters.h"
#include "imu_io/base/key_table.h"
#include "imu_io/base/key_value.h"
#include "imu_io/recordings/recording_check.h"

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
  if (const auto axes = axis_order(file.text_or(axes_key, "x, y, z")))
    triad.axes = *axes;
  else
    file.reject(axes_key, "x, y and z once each, with sign, as in +x, -z, +y");
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
  map.format.delimiter = delimiter == "semicolon" ? ';' : delimiter == "tab" ? '\t' : delimiter == "space" ? ' ' : ',';
  map.format.header_lines = static_cast<int>(file.integer_or("csv.header_lines", 1, 0, 1000));
  map.time_column = file.text_or("time.column", "");
  map.accel_time_column = file.text_or("accel.time.column", map.time_column);
  const std::string unit = file.one_of_or("time.unit", "s", {"s", "ms", "us", "ns"});
  map.time_unit_s = unit == "ms" ? 1e-3 : unit == "us" ? 1e-6 : unit == "ns" ? 1e-9 : 1.0;
  map.measured_intervals = file.one_of_or("time.increments", "intervals", {"intervals", "period"}) == "intervals";
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
  TRY(file.check_all_used());
  return map;
}

}  // namespace

Result<CsvMap> read_csv_map(const std::string& path) {
  KeyValueFile file = TRY(KeyValueFile::read(path));
  return read_map(file);
}

Result<CsvMap> parse_csv_map(std::string_view text, const std::string& file_name) {
  KeyValueFile file = TRY(KeyValueFile::parse(text, file_name));
  return read_map(file);
}

}  // namespace turncal
