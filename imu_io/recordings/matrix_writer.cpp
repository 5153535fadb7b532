#include "imu_io/recordings/matrix_writer.h"

#include <matio.h>
#include <unistd.h>

#include <algorithm>
#include <memory>

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
  std::string text = "{'descr': '<f8', 'fortran_order': False, 'shape': (" + std::to_string(rows) + ", " +
                     std::to_string(fields) + "), }";
  constexpr std::size_t prefix = 10, block = 64;  // the data begin on a multiple of it
  text.resize((prefix + text.size() + 1 + block - 1) / block * block - prefix - 1, ' ');
  text += '\n';
  std::string header(npy_magic);
  header += '\x01';
  header += '\0';
  header += static_cast<char>(text.size() & 0xff);
  header += static_cast<char>(text.size() >> 8);
  return header + text;
}

// `row_text`: appends a row to a text.
template <class RowText>
Status write_rows(const std::string& path, const std::string& head, std::size_t rows, RowText row_text) {
  Result<AtomicFile> file = AtomicFile::create(path);
  if (!file) return file.error();
  std::string text = head;
  for (std::size_t row = 0; row < rows; ++row) {
    row_text(row, text);
    if (text.size() < 1 << 16 && row + 1 < rows) continue;
    if (Status status = file->write(text); !status) return status;
    text.clear();
  }
  if (Status status = file->write(text); !status) return status;
  return file->commit();
}

Status write_mat(const std::string& path, const std::vector<NumberColumn>& fields) {
  const std::string temporary = temporary_name(path);
  const auto failed = [&] {
    ::unlink(temporary.c_str());
    return device_error(path + ": cannot write");
  };
  std::unique_ptr<mat_t, int (*)(mat_t*)> file(Mat_CreateVer(temporary.c_str(), mat_header, MAT_FT_MAT5), Mat_Close);
  if (!file) return failed();
  for (const NumberColumn& column : fields) {
    std::string name = column.name;
    std::replace(name.begin(), name.end(), '.', '_');
    std::size_t size[2] = {column.values.size(), 1};
    const std::unique_ptr<matvar_t, void (*)(matvar_t*)> variable(
        Mat_VarCreate(name.c_str(), MAT_C_DOUBLE, MAT_T_DOUBLE, 2, size, const_cast<double*>(column.values.data()),
                      MAT_F_DONT_COPY_DATA),
        Mat_VarFree);
    if (!variable || Mat_VarWrite(file.get(), variable.get(), MAT_COMPRESSION_NONE) != 0) return failed();
  }
  // libmatio does not say whether all of it went to the disk.
  file.reset();
  std::uint64_t bytes = 0;
  for (const NumberColumn& column : fields) bytes += 8 * column.values.size();
  const Result<PosixFile> written = PosixFile::open_to_read(temporary);
  if (!written) return failed();
  const Result<std::uint64_t> size = written->size();
  if (!size || *size < bytes) return failed();
  if (Status status = rename_durably(temporary, path); !status) {
    ::unlink(temporary.c_str());
    return status;
  }
  return {};
}

}  // namespace

bool names_matrix(std::string_view path) { return path.ends_with(".npy") || path.ends_with(".mat"); }

Status write_columns(const std::string& path, const std::vector<NumberColumn>& fields) {
  const std::size_t rows = fields.front().values.size();
  if (path.ends_with(".mat")) {
    if (Status status = check_replaceable(path, mat_header); !status) return status;
    return write_mat(path, fields);
  }
  if (path.ends_with(".npy")) {
    if (Status status = check_replaceable(path, npy_magic); !status) return status;
    return write_rows(path, npy_header(rows, fields.size()), rows, [&](std::size_t row, std::string& text) {
      for (const NumberColumn& column : fields) {
        const double value = column.values[row];
        text.append(reinterpret_cast<const char*>(&value), sizeof value);
      }
    });
  }
  std::string head;
  for (const NumberColumn& column : fields) head += (head.empty() ? "" : ",") + column.name;
  head += '\n';
  if (Status status = check_replaceable(path, head); !status) return status;
  NumberBuffer buffer;
  return write_rows(path, head, rows, [&](std::size_t row, std::string& text) {
    for (const NumberColumn& column : fields) {
      if (&column != &fields.front()) text += ',';
      text += format_number(column.values[row], buffer);
    }
    text += '\n';
  });
}

Status write_recording_columns(RecordingSource& source, const std::string& path) {
  std::vector<NumberColumn> fields = {{"sample", {}}, {"segment", {}}, {"gyro_x", {}},  {"gyro_y", {}},
                                      {"gyro_z", {}}, {"accel_x", {}}, {"accel_y", {}}, {"accel_z", {}}};
  if (source.info().has_temperature) fields.push_back({"temperature_c", {}});
  NumberColumn flags{"flags", {}};
  bool flagged = false;
  std::size_t segment = 0;
  const Segments& segments = source.segments();
  const Status status = source.read([&](std::span<const ImuSample> samples) {
    for (const ImuSample& sample : samples) {
      while (segment < segments.size() && sample.counter >= segments[segment].end_sample) ++segment;
      const bool inside = segment < segments.size() && sample.counter >= segments[segment].start_sample;
      std::size_t at = 0;
      const auto add = [&](double value) { fields[at++].values.push_back(value); };
      add(static_cast<double>(sample.counter));
      add(inside ? static_cast<double>(segment + 1) : 0.0);
      for (const double value : sample.gyro) add(value);
      for (const double value : sample.accel) add(value);
      if (at < fields.size()) add(static_cast<double>(sample.temperature_c));
      flags.values.push_back(sample.flags);
      flagged = flagged || sample.flags != 0;
    }
    return Status{};
  });
  if (!status) return status;
  if (fields.front().values.empty()) return input_error(source.path() + ": not one sample: expected some to write");
  if (flagged) fields.push_back(std::move(flags));
  return write_columns(path, fields);
}

}  // namespace turncal
