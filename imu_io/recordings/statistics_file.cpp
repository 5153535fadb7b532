#include "imu_io/recordings/statistics_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

#include "imu_io/base/bytes.h"
#include "imu_io/base/crc.h"
#include "imu_io/base/files.h"
#include "imu_io/base/text.h"

namespace turncal {
namespace {

constexpr std::string_view magic = "TCST";
constexpr std::uint32_t version = 1;
constexpr Eigen::Index most_columns = 2000;  // limit for an undamaged file: the catalogue has some two hundred columns

void append_three(std::vector<std::byte>& out, std::uint32_t bits) {
  for (int k = 0; k < 3; ++k) append_bytes(out, std::uint8_t(bits >> (8 * k)));
}

// Writes the upper three bytes of a float: a mantissa of 16 bits.
void append_short(std::vector<std::byte>& out, float value) {
  append_three(out, (std::bit_cast<std::uint32_t>(value) + 0x80) >> 8);
}
std::uint32_t get_three(ByteReader& reader) {
  std::uint32_t bits = 0;
  for (int k = 0; k < 3; ++k) bits |= std::uint32_t(reader.get<std::uint8_t>()) << (8 * k);
  return bits;
}
float get_short(ByteReader& reader) { return std::bit_cast<float>(get_three(reader) << 8); }

// Writes a correlation in three bytes, with a resolution of 1.2e-7.
constexpr double correlation_steps = 8388607.0;
void append_correlation(std::vector<std::byte>& out, double value) {
  const auto bits = std::uint32_t(std::int32_t(std::lround(std::clamp(value, -1.0, 1.0) * correlation_steps)));
  append_three(out, bits);
}
double get_correlation(ByteReader& reader) {
  const auto bits = std::int32_t(get_three(reader) << 8);
  return double(bits >> 8) / correlation_steps;
}

}  // namespace

Result<std::vector<std::byte>> format_statistics(const StatisticsFile& s) {
  ParameterFile file = s.file;
  // The covariance is in parameters.conf, where it is half of the text.
  std::erase_if(file.further, [](const auto& key) { return key.first.starts_with("quality.covariance"); });
  const std::string text = TRY(format_parameter_file(file));
  const UnitStatistics& u = s.statistics;
  std::vector<std::byte> out;
  append_bytes(out, magic);
  append_bytes(out, version);
  append_text(out, text);
  for (const auto* const values : {&u.value, &u.sigma})
    for (const double value : *values) append_bytes(out, value);
  append_bytes(out, u.level);
  // Columns that the recording cannot observe are left out.
  std::vector<Eigen::Index> seen;
  std::string names;
  for (Eigen::Index k = 0; k < u.s.size(); ++k) {
    if (!(u.Q(k, k) > 0.0F)) continue;
    seen.push_back(k);
    names += u.columns[std::size_t(k)] + "\n";
  }
  append_text(out, names);
  for (const Eigen::Index k : seen) append_bytes(out, u.s[k]);
  for (const Eigen::Index k : seen) append_bytes(out, double(u.Q(k, k)));
  for (std::size_t column = 0; column < seen.size(); ++column)
    for (std::size_t row = 0; row < column; ++row) {
      const Eigen::Index a = seen[row], b = seen[column];
      append_correlation(out, double(u.Q(a, b)) / std::sqrt(double(u.Q(a, a)) * double(u.Q(b, b))));
    }
  for (const Eigen::Index k : seen)
    for (const int row : free_parameters()) append_short(out, u.moves(row, k));
  append_bytes(out, crc32c(std::span<const std::byte>(out)));
  return out;
}

Status write_statistics(const StatisticsFile& statistics, const std::string& path) {
  const std::vector<std::byte> bytes = TRY(format_statistics(statistics));
  return write_file_atomically(path, std::string_view(reinterpret_cast<const char*>(bytes.data()), bytes.size()));
}

Result<StatisticsFile> parse_statistics(std::span<const std::byte> bytes, const std::string& file_name) {
  if (bytes.size() < 12 || std::memcmp(bytes.data(), magic.data(), magic.size()) != 0)
    return input_error(file_name + ": expected statistics of a calibration, which begin with TCST");
  const std::span<const std::byte> checked = bytes.first(bytes.size() - 4);
  if (crc32c(checked) != load_bytes<std::uint32_t>(bytes.data() + checked.size()))
    return input_error(file_name + ": wrong checksum: damaged or cut off");
  ByteReader reader(checked.subspan(magic.size()));
  if (const auto found = reader.get<std::uint32_t>(); found != version)
    return input_error("{}: version {}: expected {}", file_name, found, version);
  const ParameterFile file = TRY(parse_parameter_file(reader.get_text(), file_name));
  StatisticsFile s{file, {}};
  UnitStatistics& u = s.statistics;
  bool finite = true;
  const auto number = [&] {
    const double value = reader.get<double>();
    finite = finite && std::isfinite(value);
    return value;
  };
  for (int k = 0; k < parameter_count; ++k) u.value[k] = number();
  for (int k = 0; k < parameter_count; ++k) u.sigma[k] = number();
  u.level = number();
  const std::string names = reader.get_text();
  for (std::string_view remaining = names; !remaining.empty();) u.columns.emplace_back(next_line(remaining));
  const auto columns = Eigen::Index(u.columns.size());
  if (columns > most_columns)
    return input_error("{}: {} columns: expected at most {}", file_name, columns, most_columns);
  u.s.resize(columns);
  for (double& value : u.s) value = number();
  Eigen::VectorXd diagonal(columns);
  for (double& value : diagonal) value = number();
  constexpr double least = std::numeric_limits<float>::min(), most = std::numeric_limits<float>::max();
  if (finite && columns > 0 && !(diagonal.minCoeff() >= least && diagonal.maxCoeff() <= most))
    return input_error(file_name + ": information of an effect that is not positive, or larger than a float holds");
  u.Q = diagonal.cast<float>().asDiagonal();
  for (Eigen::Index column = 0; column < columns; ++column)
    for (Eigen::Index row = 0; row < column; ++row)
      u.Q(column, row) = u.Q(row, column) =
          float(get_correlation(reader) * std::sqrt(diagonal[row] * diagonal[column]));
  u.moves = Eigen::MatrixXf::Zero(parameter_count, columns);
  for (Eigen::Index column = 0; column < columns; ++column)
    for (const int row : free_parameters()) u.moves(row, column) = get_short(reader);
  finite = finite && u.moves.allFinite();
  if (!reader.at_end()) return input_error(file_name + ": expected the end after the last number");
  if (!finite) return input_error(file_name + ": a number that is not finite");
  return s;
}

}  // namespace turncal
