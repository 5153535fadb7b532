// .npy (numpy.lib.format, versions 1 to 3) and .mat (libmatio).
#include <matio.h>

#include <charconv>
#include <cmath>
#include <cstdint>
#include <memory>

#include "imu_io/base/bytes.h"
#include "imu_io/base/format_number.h"
#include "imu_io/base/text_pieces.h"
#include "imu_io/recordings/number_table.h"

namespace turncal {
namespace {

// A matrix of numbers that lies in memory in one of two orders.
struct MatrixView {
  std::size_t rows = 0;
  std::size_t columns = 0;
  bool column_major = false;
  const std::byte* data = nullptr;
  double (*load)(const std::byte*) = nullptr;
  std::size_t item_bytes = 0;
  double at(std::size_t row, std::size_t column) const {
    return load(data + (column_major ? column * rows + row : row * columns + column) * item_bytes);
  }
};

template <class T>
double load_as(const std::byte* from) {
  return static_cast<double>(load_bytes<T>(from));
}

template <class T>
void set_type(MatrixView& view) {
  view.load = load_as<T>;
  view.item_bytes = sizeof(T);
}

bool set_type(MatrixView& view, std::string_view code) {
  if (code == "f8")
    set_type<double>(view);
  else if (code == "f4")
    set_type<float>(view);
  else if (code == "i1")
    set_type<std::int8_t>(view);
  else if (code == "u1")
    set_type<std::uint8_t>(view);
  else if (code == "i2")
    set_type<std::int16_t>(view);
  else if (code == "u2")
    set_type<std::uint16_t>(view);
  else if (code == "i4")
    set_type<std::int32_t>(view);
  else if (code == "u4")
    set_type<std::uint32_t>(view);
  else if (code == "i8")
    set_type<std::int64_t>(view);
  else if (code == "u8")
    set_type<std::uint64_t>(view);
  else
    return false;
  return true;
}

// What stands after 'key': in the header, which is a Python dictionary in text.
std::string_view value_of(std::string_view header, const std::string& key) {
  const std::size_t at = header.find("'" + key + "':");
  return at == std::string_view::npos ? std::string_view() : trimmed(header.substr(at + key.size() + 3));
}

Error not_finite(const std::string& where, const std::string& column, double value) {
  return input_error(where + ": column " + quoted(column) + " = '" + format_number(value) +
                     "': expected a finite number");
}

void number_rows(NumberTable& table, std::size_t rows) {
  for (std::size_t k = 0; k < rows; ++k) {
    table.position.push_back(static_cast<std::int64_t>(k));
    table.line.push_back(static_cast<std::int64_t>(k) + 1);
  }
}

Status append_column(const MatrixView& view, std::size_t column, const WantedColumn& wanted,
                     const std::string& file_name, NumberTable& table) {
  std::vector<double>& values = table.columns.emplace_back();
  values.reserve(view.rows);
  for (std::size_t row = 0; row < view.rows; ++row) {
    values.push_back(view.at(row, column));
    if (!std::isfinite(values.back()) && !(wanted.may_be_blank && std::isnan(values.back())))
      return not_finite(file_name + ": row " + std::to_string(row + 1), wanted.name, values.back());
  }
  return {};
}

}  // namespace

bool is_npy(std::string_view content) { return content.starts_with("\x93NUMPY"); }

// "MATLAB 5.0 MAT-file", and 7.3 likewise.
bool is_mat(std::string_view content) { return content.starts_with("MATLAB "); }

Result<NumberTable> read_npy(std::string_view content, const std::string& file_name,
                             const std::vector<WantedColumn>& wanted) {
  const auto refuse = [&](const std::string& what) { return input_error(file_name + ": " + what); };
  if (content.size() < 12) return refuse("the header of the .npy file is cut off");
  const auto* bytes = reinterpret_cast<const std::byte*>(content.data());
  const bool long_header = static_cast<int>(content[6]) > 1;
  const std::size_t length = long_header ? load_bytes<std::uint32_t>(bytes + 8) : load_bytes<std::uint16_t>(bytes + 8);
  const std::size_t begin = long_header ? 12 : 10;
  if (length > content.size() - begin) return refuse("the header of the .npy file is cut off");
  const std::string_view header = content.substr(begin, length);
  std::string_view type = value_of(header, "descr");
  MatrixView view;
  if (type.size() < 5 || (type[1] != '<' && type[1] != '|') || type[4] != '\'' || !set_type(view, type.substr(2, 2)))
    return refuse("type " + quoted(type.substr(0, 12)) +
                  ": expected a .npy array of little-endian numbers, as in '<f8' or '<i2'");
  view.column_major = value_of(header, "fortran_order").starts_with("True");
  std::string_view shape = value_of(header, "shape");
  std::vector<std::size_t> sizes;
  if (shape.starts_with('(') && shape.find(')') != std::string_view::npos)
    for (const std::string_view part : split(shape.substr(1, shape.find(')') - 1), ','))
      if (const auto size = parse_integer<std::int64_t>(part); size && *size > 0)
        sizes.push_back(static_cast<std::size_t>(*size));
  if (sizes.empty() || sizes.size() > 2)
    return refuse("shape " + quoted(shape.substr(0, 24)) + ": expected one or two dimensions, rows first");
  view.rows = sizes[0];
  view.columns = sizes.size() == 2 ? sizes[1] : 1;
  view.data = bytes + begin + length;
  const std::size_t have = (content.size() - begin - length) / view.item_bytes;
  if (have / view.columns < view.rows)
    return refuse("the .npy file is cut off: expected " + std::to_string(view.rows) + " rows of " +
                  std::to_string(view.columns));
  NumberTable table;
  for (const WantedColumn& column : wanted) {
    const auto index = parse_integer<std::int64_t>(column.name);
    if (!index || *index < 1 || static_cast<std::size_t>(*index) > view.columns)
      return refuse("no column " + quoted(column.name) + ": expected a number from 1 to " +
                    std::to_string(view.columns) + ", a .npy array has no names");
    TRY(append_column(view, static_cast<std::size_t>(*index - 1), column, file_name, table));
  }
  number_rows(table, view.rows);
  return table;
}

Result<NumberTable> read_mat(const std::string& file_name, const std::vector<WantedColumn>& wanted) {
  const std::unique_ptr<mat_t, int (*)(mat_t*)> file(Mat_Open(file_name.c_str(), MAT_ACC_RDONLY), Mat_Close);
  if (!file) return input_error(file_name + ": libmatio cannot read this .mat file");
  NumberTable table;
  std::size_t rows = 0;
  for (const WantedColumn& column : wanted) {
    const std::size_t colon = column.name.find(':');
    const std::string name = column.name.substr(0, colon);
    const auto index = colon == std::string::npos ? std::optional<std::int64_t>(1)
                                                  : parse_integer<std::int64_t>(column.name.substr(colon + 1));
    const std::unique_ptr<matvar_t, void (*)(matvar_t*)> variable(Mat_VarRead(file.get(), name.c_str()), Mat_VarFree);
    const auto refuse = [&](const std::string& what) {
      return input_error(file_name + ": column " + quoted(column.name) + ": " + what);
    };
    if (!variable && column.may_be_missing) {
      table.columns.emplace_back();
      continue;
    }
    if (!variable || variable->data == nullptr)
      return refuse("no variable " + quoted(name) + " of numbers: expected name or name:column");
    MatrixView view;
    switch (variable->data_type) {
      case MAT_T_DOUBLE: set_type<double>(view); break;
      case MAT_T_SINGLE: set_type<float>(view); break;
      case MAT_T_INT8: set_type<std::int8_t>(view); break;
      case MAT_T_UINT8: set_type<std::uint8_t>(view); break;
      case MAT_T_INT16: set_type<std::int16_t>(view); break;
      case MAT_T_UINT16: set_type<std::uint16_t>(view); break;
      case MAT_T_INT32: set_type<std::int32_t>(view); break;
      case MAT_T_UINT32: set_type<std::uint32_t>(view); break;
      case MAT_T_INT64: set_type<std::int64_t>(view); break;
      case MAT_T_UINT64: set_type<std::uint64_t>(view); break;
      default: return refuse("is no array of numbers");
    }
    if (variable->rank != 2 || variable->isComplex != 0) return refuse("expected a real matrix of two dimensions");
    view.rows = variable->dims[0];
    view.columns = variable->dims[1];
    view.column_major = true;
    view.data = static_cast<const std::byte*>(variable->data);
    if (view.rows < view.columns) {  // samples lie along the rows
      std::swap(view.rows, view.columns);
      view.column_major = false;
    }
    if (!index || *index < 1 || static_cast<std::size_t>(*index) > view.columns)
      return refuse("expected a column from 1 to " + std::to_string(view.columns));
    if (rows > 0 && view.rows != rows)
      return refuse("has " + std::to_string(view.rows) + " rows: expected " + std::to_string(rows) +
                    ", as the columns before");
    rows = view.rows;
    TRY(append_column(view, static_cast<std::size_t>(*index - 1), column, file_name, table));
  }
  number_rows(table, rows);
  return table;
}

}  // namespace turncal
