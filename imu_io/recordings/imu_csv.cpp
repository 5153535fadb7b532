#include "imu_io/recordings/imu_csv.h"

#include <array>
#include <cmath>
#include <limits>
#include <span>

#include <fmt/format.h>

#include "imu_io/base/format_number.h"
#include "imu_io/base/text_pieces.h"
#include "imu_io/recordings/recording_check.h"

namespace turncal {
namespace {

constexpr std::array<std::string_view, 8> columns = {"sample",  "gyro_x",  "gyro_y",  "gyro_z",
                                                     "accel_x", "accel_y", "accel_z", "temperature_c"};
constexpr std::span<const std::string_view> columns_of(bool has_temperature) {
  return std::span(columns).first(has_temperature ? columns.size() : columns.size() - 1);
}
constexpr std::int64_t min_pulses = std::numeric_limits<std::int32_t>::min();
constexpr std::int64_t max_pulses = std::numeric_limits<std::int32_t>::max();

inline bool is_digit(char c) { return static_cast<unsigned char>(c - '0') <= 9; }

// Up to 18 digits, which cannot overflow. Stops at the first byte that is no digit.
inline bool plain_integer(const char*& at, std::int64_t& value) {
  const char* p = at;
  const bool negative = *p == '-';
  if (negative) ++p;
  const char* first = p;
  std::int64_t magnitude = 0;
  while (is_digit(*p) && p - first < 18) magnitude = magnitude * 10 + (*p++ - '0');
  if (p == first || is_digit(*p)) return false;
  value = negative ? -magnitude : magnitude;
  at = p;
  return true;
}

// [-]digits[.digits] with at most 9 digits: mantissa over a power of ten, one rounding to double, one to float. With so
// few digits the value cannot lie so near the middle of two floats that the first rounding would decide the second.
inline bool plain_decimal(const char*& at, float& value) {
  static constexpr std::array<double, 10> powers = {1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9};
  const char* p = at;
  const bool negative = *p == '-';
  if (negative) ++p;
  if (!is_digit(*p)) return false;
  std::int64_t mantissa = 0;
  int digits = 0;
  for (; is_digit(*p) && digits <= 9; ++p, ++digits) mantissa = mantissa * 10 + (*p - '0');
  int decimals = 0;
  if (*p == '.') {
    ++p;
    for (; is_digit(*p) && digits <= 9; ++p, ++digits, ++decimals) mantissa = mantissa * 10 + (*p - '0');
    if (decimals == 0) return false;
  }
  if (digits > 9) return false;
  const double magnitude = static_cast<double>(mantissa) / powers[static_cast<std::size_t>(decimals)];
  value = static_cast<float>(negative ? -magnitude : magnitude);
  at = p;
  return true;
}

// A number that ends at a comma or a line end.
inline bool plain_double(const char*& at, double& value) {
  // 40 bytes hold every shortest form; the line end before them stops the parser earlier.
  const auto result = std::from_chars(at, at + 40, value);
  if (result.ec != std::errc{} || !std::isfinite(value)) return false;
  at = result.ptr;
  return true;
}

inline bool plain_triple(const char*& at, IncrementKind kind, std::array<double, 3>& value, char last_end) {
  for (int axis = 0; axis < 3; ++axis) {
    if (kind == IncrementKind::pulses) {
      std::int64_t pulses = 0;
      if (!plain_integer(at, pulses) || pulses < min_pulses || pulses > max_pulses) return false;
      value[static_cast<std::size_t>(axis)] = static_cast<double>(pulses);
    } else if (!plain_double(at, value[static_cast<std::size_t>(axis)])) {
      return false;
    }
    if (axis == 2 && last_end == '\n') return true;
    if (*at++ != ',') return false;
  }
  return true;
}

}  // namespace

std::string imu_csv_header(bool has_temperature) {
  return fmt::format("{}", fmt::join(columns_of(has_temperature), ","));
}

bool ImuCsvParser::parse_plain(const char*& at, ImuSample& sample) const {
  const char* p = at;
  if (!plain_integer(p, sample.counter) || *p++ != ',') return false;
  if (!plain_triple(p, info_.gyro_increment, sample.gyro, ',')) return false;
  if (!plain_triple(p, info_.accel_increment, sample.accel, info_.has_temperature ? ',' : '\n')) return false;
  sample.temperature_c = std::numeric_limits<float>::quiet_NaN();
  const bool blank = *p == '\n' || *p == '\r';  // not measured at this sample
  if (info_.has_temperature && !blank && !plain_decimal(p, sample.temperature_c)) return false;
  if (*p == '\r') ++p;
  if (*p != '\n') return false;
  at = p + 1;
  return true;
}

TableRow::TableRow(std::string_view text, const std::string& file, std::int64_t line,
                   std::span<const std::string_view> names)
    : text_(text), file_(file), line_(line), names_(names), cells_(split(text, ',')) {}

std::string TableRow::where() const { return file_ + ":" + std::to_string(line_); }

Status TableRow::check_count() const {
  if (cells_.size() == names_.size()) return {};
  return input_error(fmt::format("{}: {} columns: expected {}", where(), cells_.size(), names_.size()));
}

Error TableRow::defect(std::size_t column, std::string_view expected) const {
  return input_error(
      fmt::format("{}: column {} = {}: expected {}", where(), names_[column], quoted(cells_[column]), expected));
}

Status ImuCsvParser::parse(std::string_view text, std::int64_t line, ImuSample& sample) const {
  const TableRow row(text, file_name_, line, columns_of(info_.has_temperature));
  TRY(row.check_count());
  const auto counter = parse_integer(row[0]);
  if (!counter || !is_counter(*counter)) return row.defect(0, std::string(counter_words) + ", the unit's counter");
  sample.counter = *counter;
  for (std::size_t i = 1; i <= 6; ++i) {
    const bool is_gyro = i <= 3;
    const IncrementKind kind = is_gyro ? info_.gyro_increment : info_.accel_increment;
    const auto value = parse_number(row[i]);
    double& place = is_gyro ? sample.gyro[i - 1] : sample.accel[i - 4];
    if (kind == IncrementKind::physical) {
      if (!value) return row.defect(i, is_gyro ? "a number, rad" : "a number, m/s");
      place = *value;
    } else {
      const bool whole = value && *value == std::floor(*value) && *value >= static_cast<double>(min_pulses) &&
                         *value <= static_cast<double>(max_pulses);
      if (!whole) return row.defect(i, "a whole number of pulses within 32 bits");
      place = *value + 0.0;  // no negative zero among pulses
    }
  }
  sample.temperature_c = std::numeric_limits<float>::quiet_NaN();
  if (info_.has_temperature && !row[7].empty()) {
    const auto value = parse_number<float>(row[7]);
    if (!value) return row.defect(7, "a number in degrees Celsius, or nothing when it was not measured");
    sample.temperature_c = *value;
  }
  return {};
}

void append_imu_row(std::string& out, const ImuSample& sample, const RecordingInfo& info) {
  NumberBuffer buffer;
  out += format_number(sample.counter, buffer);
  const auto append_triple = [&](const std::array<double, 3>& value, IncrementKind kind) {
    for (const double x : value) {
      out += ',';
      out += kind == IncrementKind::pulses ? format_number(static_cast<std::int32_t>(x), buffer)
                                           : format_number(x, buffer);
    }
  };
  append_triple(sample.gyro, info.gyro_increment);
  append_triple(sample.accel, info.accel_increment);
  if (info.has_temperature) {
    out += ',';
    const float t = sample.temperature_c;
    if (!std::isnan(t)) {
      // Three decimals when they say it exactly, which is what sensors give; else the shortest form.
      const double thousandths = std::round(static_cast<double>(t) * 1000.0);
      if (std::abs(thousandths) < 8e6 && static_cast<float>(thousandths / 1000.0) == t) {
        if (std::signbit(t)) out += '-';
        const auto magnitude = static_cast<std::int64_t>(std::abs(thousandths));
        out += format_number(magnitude / 1000, buffer);
        const auto digit = [&](std::int64_t unit) { return static_cast<char>('0' + magnitude / unit % 10); };
        const std::array<char, 4> decimals = {'.', digit(100), digit(10), digit(1)};
        out.append(decimals.data(), decimals.size());
      } else {
        out += format_number(t, buffer);
      }
    }
  }
  out += '\n';
}

}  // namespace turncal
