#include "imu_io/recordings/matrix_writer.h"

#include <fmt/format.h>
#include <matio.h>
#include <unistd.h>

#include <algorithm>
#include <functional>
#include <memory>
#include <span>

#include "imu_io/base/atomic_file.h"
#include "imu_io/base/bytes.h"
#include "imu_io/base/format_number.h"
#include "imu_io/base/posix_file.h"
#include "imu_io/recordings/imu_csv.h"

namespace turncal {
namespace {

constexpr std::string_view npy_magic = "\x93NUMPY";
constexpr const char* mat_header = "MATLAB 5.0 MAT-file, written by turncal";

std::string npy_header(std::size_t rows, std::size_t fields) {
  std::string text = fmt::format("{{'descr': '<f8', 'fortran_order': False, 'shape': ({}, {}), }}", rows, fields);
  constexpr std::size_t prefix = 10, block = 64;  // the data begin on a multiple of it
  text.resize((prefix + text.size() + 1 + block - 1) / block * block - prefix - 1, ' ');
  text += '\n';
  const char version_and_size[] = {1, 0, static_cast<char>(text.size() & 0xff), static_cast<char>(text.size() >> 8)};
  return std::string(npy_magic).append(version_and_size, sizeof version_and_size) + text;
}

// A table that is gone through row by row, as often as is wanted.
using RowSink = std::function<Status(std::span<const double> row)>;
struct RowTable {
  std::vector<std::string> names;  // of the columns
  std::size_t rows = 0;
  std::function<Status(const RowSink&)> each_row;
};

// `append_row`: appends a row to a text.
template <class AppendRow>
Status write_rows(const std::string& path, std::string head, const RowTable& table, AppendRow append_row) {
  AtomicFile file = TRY(AtomicFile::create(path));
  std::string& text = head;
  const RowSink add = [&](std::span<const double> row) -> Status {
    append_row(row, text);
    if (text.size() < 1 << 16) return {};
    TRY(file.write(text));
    text.clear();
    return {};
  };
  TRY(table.each_row(add));
  TRY(file.write(text));
  return file.commit();
}

Status write_npy(const std::string& path, const RowTable& table) {
  TRY(check_replaceable(path, npy_magic));
  return write_rows(path, npy_header(table.rows, table.names.size()), table,
                    [](std::span<const double> row, std::string& text) {
                      text.append(reinterpret_cast<const char*>(row.data()), row.size_bytes());
                    });
}

Status write_csv(const std::string& path, const RowTable& table) {
  const std::string head = fmt::format("{}\n", fmt::join(table.names, ","));
  TRY(check_replaceable(path, head));
  NumberBuffer buffer;
  return write_rows(path, head, table, [&](std::span<const double> row, std::string& text) {
    for (const double& value : row) {
      text += format_number(value, buffer);
      text += &value == &row.back() ? '\n' : ',';
    }
  });
}

// A pass for each column.
Status write_mat_variables(const std::string& path, const std::string& temporary, const RowTable& table) {
  const Error cannot_write = device_error(path + ": cannot write");
  std::unique_ptr<mat_t, int (*)(mat_t*)> file(Mat_CreateVer(temporary.c_str(), mat_header, MAT_FT_MAT5), Mat_Close);
  if (!file) return cannot_write;
  std::vector<double> values;
  values.reserve(table.rows);
  for (std::size_t k = 0; k < table.names.size(); ++k) {
    std::string name = table.names[k];
    std::replace(name.begin(), name.end(), '.', '_');
    values.clear();
    TRY(table.each_row([&](std::span<const double> row) {
      values.push_back(row[k]);
      return Status();
    }));
    std::size_t size[2] = {values.size(), 1};
    const std::unique_ptr<matvar_t, void (*)(matvar_t*)> variable(
        Mat_VarCreate(name.c_str(), MAT_C_DOUBLE, MAT_T_DOUBLE, 2, size, values.data(), MAT_F_DONT_COPY_DATA),
        Mat_VarFree);
    if (!variable || Mat_VarWrite(file.get(), variable.get(), MAT_COMPRESSION_NONE) != 0) return cannot_write;
  }
  // libmatio does not say whether all of it went to the disk.
  file.reset();
  const Result<PosixFile> written = PosixFile::open_to_read(temporary);
  const Result<std::uint64_t> size = written ? written->size() : Result<std::uint64_t>(written.error());
  if (!size || *size < table.rows * table.names.size() * sizeof(double)) return cannot_write;
  return rename_durably(temporary, path);
}

Status write_mat(const std::string& path, const RowTable& table) {
  TRY(check_replaceable(path, mat_header));
  const std::string temporary = temporary_name(path);
  Status status = write_mat_variables(path, temporary, table);
  if (!status) ::unlink(temporary.c_str());
  return status;
}

}  // namespace

bool names_matrix(std::string_view path) { return path.ends_with(".npy") || path.ends_with(".mat"); }

Status write_columns(const std::string& path, const std::vector<NumberColumn>& fields) {
  RowTable table;
  table.rows = fields.front().values.size();
  for (const NumberColumn& column : fields) table.names.push_back(column.name);
  table.each_row = [&](const RowSink& sink) -> Status {
    std::vector<double> values(fields.size());
    for (std::size_t row = 0; row < table.rows; ++row) {
      for (std::size_t k = 0; k < fields.size(); ++k) values[k] = fields[k].values[row];
      TRY(sink(values));
    }
    return {};
  };
  return path.ends_with(".mat")   ? write_mat(path, table)
         : path.ends_with(".npy") ? write_npy(path, table)
                                  : write_csv(path, table);
}

Status check_ending(std::string_view path, std::initializer_list<std::string_view> endings) {
  if (std::any_of(endings.begin(), endings.end(), [&](std::string_view ending) { return path.ends_with(ending); }))
    return {};
  return input_error(fmt::format("{}: expected a name that ends in one of {}", path, fmt::join(endings, ", ")));
}

Status write_recording_columns(RecordingSource& source, const std::string& path) {
  const bool has_temperature = source.info().has_temperature;
  bool flagged = false;
  RowTable table{{"sample", "segment", "gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"}, 0, {}};
  TRY(check_replaceable(path, path.ends_with(".mat") ? std::string_view(mat_header) : npy_magic));
  TRY(source.read([&](std::span<const ImuSample> samples) {
    table.rows += samples.size();
    for (const ImuSample& sample : samples) flagged = flagged || sample.flags != 0;
    return Status();
  }));
  if (table.rows == 0) return input_error(source.path() + ": not one sample: expected some to write");
  if (has_temperature) table.names.emplace_back("temperature_c");
  if (flagged) table.names.emplace_back("flags");
  table.each_row = [&](const RowSink& sink) {
    const Segments& segments = source.segments();
    std::size_t segment = 0;
    std::vector<double> row(table.names.size());
    return source.read([&](std::span<const ImuSample> samples) -> Status {
      for (const ImuSample& sample : samples) {
        while (segment < segments.size() && sample.counter >= segments[segment].end_sample) ++segment;
        const bool inside = segment < segments.size() && sample.counter >= segments[segment].start_sample;
        row[0] = static_cast<double>(sample.counter);
        row[1] = inside ? static_cast<double>(segment + 1) : 0.0;
        std::copy(sample.gyro.begin(), sample.gyro.end(), row.begin() + 2);
        std::copy(sample.accel.begin(), sample.accel.end(), row.begin() + 5);
        if (has_temperature) row[8] = static_cast<double>(sample.temperature_c);
        if (flagged) row.back() = static_cast<double>(sample.flags);
        TRY(sink(row));
      }
      return {};
    });
  };
  return path.ends_with(".mat") ? write_mat(path, table) : write_npy(path, table);
}

}  // namespace turncal
