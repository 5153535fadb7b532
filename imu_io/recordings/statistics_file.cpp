#include "imu_io/recordings/statistics_file.h"

#include <cmath>
#include <cstring>

#include "imu_io/base/atomic_file.h"
#include "imu_io/base/bytes.h"
#include "imu_io/base/crc32c.h"
#include "imu_io/base/posix_file.h"
#include "imu_io/base/text_pieces.h"

namespace turncal {
namespace {

constexpr std::string_view magic = "TCST";
constexpr std::uint32_t version = 1;
constexpr std::uint32_t most_columns = 2000;  // of a file that is not damaged: the catalogue has some two hundred

}  // namespace

Result<std::vector<std::byte>> format_statistics(const StatisticsFile& s) {
  const Result<std::string> text = format_parameter_file(s.file);
  if (!text) return text.error();
  const UnitStatistics& u = s.statistics;
  std::vector<std::byte> out;
  append_bytes(out, magic);
  append_bytes(out, version);
  append_text(out, *text);
  for (int k = 0; k < parameter_count; ++k) append_bytes(out, u.value[k]);
  for (int k = 0; k < parameter_count; ++k) append_bytes(out, u.sigma[k]);
  append_bytes(out, u.level);
  append_bytes(out, static_cast<std::uint32_t>(u.columns.size()));
  for (const std::string& column : u.columns) append_text(out, column);
  for (const double value : u.s) append_bytes(out, value);
  for (Eigen::Index column = 0; column < u.Q.cols(); ++column)
    for (Eigen::Index row = 0; row <= column; ++row) append_bytes(out, u.Q(row, column));
  for (Eigen::Index column = 0; column < u.moves.cols(); ++column)
    for (Eigen::Index row = 0; row < parameter_count; ++row) append_bytes(out, u.moves(row, column));
  append_bytes(out, crc32c(std::span<const std::byte>(out)));
  return out;
}

Status write_statistics(const StatisticsFile& statistics, const std::string& path) {
  const Result<std::vector<std::byte>> bytes = format_statistics(statistics);
  if (!bytes) return bytes.error();
  return write_file_atomically(path, std::string_view(reinterpret_cast<const char*>(bytes->data()), bytes->size()));
}

Result<StatisticsFile> parse_statistics(std::span<const std::byte> bytes, const std::string& file_name) {
  if (bytes.size() < 12 || std::memcmp(bytes.data(), magic.data(), magic.size()) != 0)
    return input_error(file_name + ": expected statistics of a calibration, which begin with TCST");
  const std::span<const std::byte> checked = bytes.first(bytes.size() - 4);
  if (crc32c(checked) != load_bytes<std::uint32_t>(bytes.data() + checked.size()))
    return input_error(file_name + ": wrong checksum: damaged or cut off");
  ByteReader reader(checked.subspan(magic.size()));
  if (const auto found = reader.get<std::uint32_t>(); found != version)
    return input_error(file_name + ": version " + std::to_string(found) + ": expected " + std::to_string(version));
  const Result<ParameterFile> file = parse_parameter_file(reader.get_text(), file_name);
  if (!file) return file.error();
  StatisticsFile s{*file, {}};
  UnitStatistics& u = s.statistics;
  bool finite = true;
  const auto number = [&] {
    const double value = reader.get<double>();
    finite = finite && std::isfinite(value);
    return value;
  };
  const auto single = [&] {
    const float value = reader.get<float>();
    finite = finite && std::isfinite(value);
    return value;
  };
  for (int k = 0; k < parameter_count; ++k) u.value[k] = number();
  for (int k = 0; k < parameter_count; ++k) u.sigma[k] = number();
  u.level = number();
  const auto columns = reader.get<std::uint32_t>();
  if (columns > most_columns)
    return input_error(file_name + ": " + std::to_string(columns) + " columns: expected at most " +
                       std::to_string(most_columns));
  for (std::uint32_t k = 0; k < columns && reader.good(); ++k) u.columns.push_back(reader.get_text());
  u.s.resize(columns);
  for (double& value : u.s) value = number();
  u.Q.resize(columns, columns);
  for (Eigen::Index column = 0; column < u.Q.cols(); ++column)
    for (Eigen::Index row = 0; row <= column; ++row) u.Q(column, row) = u.Q(row, column) = single();
  u.moves.resize(parameter_count, columns);
  for (Eigen::Index column = 0; column < u.moves.cols(); ++column)
    for (Eigen::Index row = 0; row < parameter_count; ++row) u.moves(row, column) = single();
  if (!reader.at_end()) return input_error(file_name + ": expected the end after the last number");
  if (!finite) return input_error(file_name + ": a number that is not finite");
  return s;
}

Result<StatisticsFile> read_statistics(const std::string& path) {
  const Result<std::string> text = read_whole_file(path);
  if (!text) return text.error();
  return parse_statistics(std::span(reinterpret_cast<const std::byte*>(text->data()), text->size()), path);
}

}  // namespace turncal
