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

// `row_text`: appends a row to a text.
template <class RowText>
Status write_rows(const std::string& path, const std::string& head, std::size_t rows, RowText row_text) {
  AtomicFile file = TRY(AtomicFile::create(path));
  std::string text = head;
  for (std::size_t row = 0; row < rows; ++row) {
    row_text(row, text);
    if (text.size() < 1 << 16 && row + 1 < rows) continue;
    TRY(file.write(text));
    text.clear();
  }
  TRY(file.write(text));
  return file.commit();
}

// `column(k)`: the values of the k-th column, which live until the next is asked for.
using ColumnOf = std::function<Result<std::span<const double>>(std::size_t k)>;

Status write_mat(const std::string& path, const std::vector<std::string>& names, const ColumnOf& column) {
  const std::string temporary = temporary_name(path);
  const auto failed = [&](const Error& error) {
    ::unlink(temporary.c_str());
    return error;
  };
  const Error cannot_write = device_error(path + ": cannot write");
  std::unique_ptr<mat_t, int (*)(mat_t*)> file(Mat_CreateVer(temporary.c_str(), mat_header, MAT_FT_MAT5), Mat_Close);
  if (!file) return failed(cannot_write);
  std::uint64_t bytes = 0;
  for (std::size_t k = 0; k < names.size(); ++k) {
    std::string name = names[k];
    std::replace(name.begin(), name.end(), '.', '_');
    const Result<std::span<const double>> values = column(k);
    if (!values) return failed(values.error());
    bytes += values->size_bytes();
    std::size_t size[2] = {values->size(), 1};
    const std::unique_ptr<matvar_t, void (*)(matvar_t*)> variable(
        Mat_VarCreate(name.c_str(), MAT_C_DOUBLE, MAT_T_DOUBLE, 2, size, const_cast<double*>(values->data()),
                      MAT_F_DONT_COPY_DATA),
        Mat_VarFree);
    if (!variable || Mat_VarWrite(file.get(), variable.get(), MAT_COMPRESSION_NONE) != 0) return failed(cannot_write);
  }
  // libmatio does not say whether all of it went to the disk.
  file.reset();
  const Result<PosixFile> written = PosixFile::open_to_read(temporary);
  if (!written) return failed(cannot_write);
  const Result<std::uint64_t> size = written->size();
  if (!size || *size < bytes) return failed(cannot_write);
  if (Status status = rename_durably(temporary, path); !status) return failed(status.error());
  return {};
}

void append_double(double value, std::string& text) {
  text.append(reinterpret_cast<const char*>(&value), sizeof value);
}

// The columns of a recording, as values of a sample.
struct SampleColumn {
  const char* name;
  double (*value)(const ImuSample& sample, std::size_t segment);
};
template <std::size_t channel>
double channel_value(const ImuSample& sample, std::size_t /*segment*/) {
  return channel < 3 ? sample.gyro[channel] : sample.accel[channel - 3];
}
constexpr SampleColumn sample_columns[] = {
    {"sample", [](const ImuSample& s, std::size_t) { return static_cast<double>(s.counter); }},
    {"segment", [](const ImuSample&, std::size_t segment) { return static_cast<double>(segment); }},
    {"gyro_x", channel_value<0>},
    {"gyro_y", channel_value<1>},
    {"gyro_z", channel_value<2>},
    {"accel_x", channel_value<3>},
    {"accel_y", channel_value<4>},
    {"accel_z", channel_value<5>},
    {"temperature_c", [](const ImuSample& s, std::size_t) { return static_cast<double>(s.temperature_c); }},
    {"flags", [](const ImuSample& s, std::size_t) { return static_cast<double>(s.flags); }}};
constexpr std::size_t temperature_column = 8, flags_column = 9;

// Every sample with the number of its segment.
template <class Visit>
Status visit_samples(RecordingSource& source, Visit visit) {
  const Segments& segments = source.segments();
  std::size_t segment = 0;
  return source.read([&](std::span<const ImuSample> samples) -> Status {
    for (const ImuSample& sample : samples) {
      while (segment < segments.size() && sample.counter >= segments[segment].end_sample) ++segment;
      const bool inside = segment < segments.size() && sample.counter >= segments[segment].start_sample;
      TRY(visit(sample, inside ? segment + 1 : 0));
    }
    return {};
  });
}

}  // namespace

bool names_matrix(std::string_view path) { return path.ends_with(".npy") || path.ends_with(".mat"); }

Status write_columns(const std::string& path, const std::vector<NumberColumn>& fields) {
  const std::size_t rows = fields.front().values.size();
  if (path.ends_with(".mat")) {
    TRY(check_replaceable(path, mat_header));
    std::vector<std::string> names;
    for (const NumberColumn& column : fields) names.push_back(column.name);
    return write_mat(path, names, [&](std::size_t k) { return std::span<const double>(fields[k].values); });
  }
  if (path.ends_with(".npy")) {
    TRY(check_replaceable(path, npy_magic));
    return write_rows(path, npy_header(rows, fields.size()), rows, [&](std::size_t row, std::string& text) {
      for (const NumberColumn& column : fields) append_double(column.values[row], text);
    });
  }
  std::vector<std::string_view> names;
  for (const NumberColumn& column : fields) names.emplace_back(column.name);
  const std::string head = fmt::format("{}\n", fmt::join(names, ","));
  TRY(check_replaceable(path, head));
  NumberBuffer buffer;
  return write_rows(path, head, rows, [&](std::size_t row, std::string& text) {
    for (const NumberColumn& column : fields) {
      if (&column != &fields.front()) text += ',';
      text += format_number(column.values[row], buffer);
    }
    text += '\n';
  });
}

Status check_ending(std::string_view path, std::initializer_list<std::string_view> endings) {
  if (std::any_of(endings.begin(), endings.end(), [&](std::string_view ending) { return path.ends_with(ending); }))
    return {};
  return input_error(fmt::format("{}: expected a name that ends in one of {}", path, fmt::join(endings, ", ")));
}

Status write_recording_columns(RecordingSource& source, const std::string& path) {
  const bool as_mat = path.ends_with(".mat");
  TRY(check_replaceable(path, as_mat ? std::string_view(mat_header) : npy_magic));
  std::size_t rows = 0;
  bool flagged = false;
  TRY(visit_samples(source, [&](const ImuSample& sample, std::size_t) {
    ++rows;
    flagged = flagged || sample.flags != 0;
    return Status{};
  }));
  if (rows == 0) return input_error(source.path() + ": not one sample: expected some to write");
  std::vector<SampleColumn> columns(std::begin(sample_columns), std::begin(sample_columns) + temperature_column);
  if (source.info().has_temperature) columns.push_back(sample_columns[temperature_column]);
  if (flagged) columns.push_back(sample_columns[flags_column]);

  if (as_mat) {
    std::vector<std::string> names;
    for (const SampleColumn& column : columns) names.emplace_back(column.name);
    std::vector<double> values;
    values.reserve(rows);
    return write_mat(path, names, [&](std::size_t k) -> Result<std::span<const double>> {
      values.clear();
      TRY(visit_samples(source, [&](const ImuSample& sample, std::size_t segment) {
        values.push_back(columns[k].value(sample, segment));
        return Status{};
      }));
      return std::span<const double>(values);
    });
  }
  AtomicFile file = TRY(AtomicFile::create(path));
  std::string text = npy_header(rows, columns.size());
  TRY(visit_samples(source, [&](const ImuSample& sample, std::size_t segment) {
    for (const SampleColumn& column : columns) append_double(column.value(sample, segment), text);
    if (text.size() < 1 << 16) return Status{};
    const Status written = file.write(text);
    text.clear();
    return written;
  }));
  TRY(file.write(text));
  return file.commit();
}

}  // namespace turncal
