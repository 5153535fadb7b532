#include "imu_io/recordings/number_table.h"

#include <fmt/format.h>
#include <hdf5.h>
#include <matio.h>
#include <unistd.h>
#include <zlib.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <future>
#include <iterator>
#include <limits>
#include <memory>
#include <numeric>

#include "imu_io/base/bytes.h"
#include "imu_io/base/clock.h"
#include "imu_io/base/file_kind.h"
#include "imu_io/base/files.h"
#include "imu_io/base/text.h"

namespace turncal {
namespace {

constexpr std::string_view npy_magic = "\x93NUMPY";

// ---- text ----

// Reads the lines of bytes that come in pieces.
class LineReader {
 public:
  explicit LineReader(const TableBytes& bytes) : bytes_(bytes) {}
  // Gives the next line without its end, valid until the next call. Returns false at the end of the file, and on an error of status().
  bool next(std::string_view& line) {
    constexpr std::uint64_t usual = 1 << 12;
    std::size_t end = left_.find('\n');
    for (std::uint64_t least = usual; end == left_.npos && at_ + left_.size() < bytes_.size; least *= 2) {
      const Result<std::string_view> more = bytes_.at(at_, least);
      if (!more) status_ = more.error();
      left_ = more ? *more : std::string_view();
      end = left_.find('\n');
      if (left_.size() < least) break;
    }
    if (left_.empty()) return false;
    line = left_.substr(0, end);
    has_end_ = end != left_.npos;
    left_.remove_prefix(std::min(left_.size(), line.size() + 1));
    at_ += line.size() + 1;
    if (line.ends_with('\r')) line.remove_suffix(1);
    return true;
  }
  const Status& status() const { return status_; }
  bool has_end() const { return has_end_; }  // of the last line

 private:
  const TableBytes& bytes_;
  Status status_;
  bool has_end_ = true;
  std::uint64_t at_ = 0;  // where what is left begins
  std::string_view left_;
};

// Hands a block over in a thread while the next one is read.
class BlockHandler {
 public:
  explicit BlockHandler(const TableSink& sink) : sink_(sink) {}
  Status add(NumberTable& block) {
    TRY(finish());
    std::swap(block, block_);
    taken_ = std::async(std::launch::async, [this] { return sink_(block_); });
    return {};
  }
  Status finish() { return taken_.valid() ? taken_.get() : Status(); }

 private:
  const TableSink& sink_;
  NumberTable block_;
  std::future<Status> taken_;
};

class CsvTable {
 public:
  CsvTable(const TableBytes& bytes, const std::string& file_name, const std::vector<WantedColumn>& wanted,
           const TableFormat& format, BlockHandler& sink)
      : bytes_(bytes), lines_(bytes), file_name_(file_name), wanted_(wanted), format_(format), sink_(sink) {}

  Status read() {
    const std::string_view head = TRY(bytes_.at(0, 1 << 12));
    TRY(check_text(head, file_name_));
    if (head.find_first_not_of("\xEF\xBB\xBF \t\r\n") == std::string_view::npos)
      return input_error(file_name_ + ": empty file: expected " +
                         (format_.header_lines > 0 ? "a header and " : std::string()) + "rows of numbers");
    std::vector<std::string> header;
    std::string_view row;
    for (int k = 0; k < format_.header_lines; ++k) {
      bool more = next_row(row);
      while (more && is_remark(row)) more = next_row(row);
      TRY(lines_.status());
      if (!more) return defect("the file ends inside its " + std::to_string(format_.header_lines) + " header lines");
      row = trimmed(row);
      while (row.starts_with('#') || row.starts_with('%')) row = trimmed(row.substr(1));
      split_cells(row, format_.delimiter, cells_);
      header.assign(cells_.begin(), cells_.end());
    }
    while (!format_.whole_rows && !header.empty() && header.back().empty()) header.pop_back();
    TRY(find_columns(header));
    if (named_ || format_.whole_rows) width_ = header.size();
    TRY(end_block());
    find_cells();
    for (std::int64_t position = 0; next_row(row);) {
      if (!lines_.has_end() || !read_plain_row(row)) {
        const std::string_view text = trimmed(row);
        if (text.empty() || text.starts_with('#') || is_remark(row)) continue;
        // A number that is cut off still reads as a number.
        const Status whole = lines_.has_end() ? Status() : defect("the last line has no end: it may be cut off");
        if (Status status = !whole ? whole : read_row(row); !status) {
          if (!format_.skip_bad_rows && (whole || format_.whole_rows)) return status.error();
          if (table_.bad_rows++ == 0) table_.first_bad = status.error().message;
          ++position;
          continue;
        }
      }
      table_.position[used_] = position++;
      table_.line[used_] = line_;
      if (++used_ == block_rows) TRY(end_block());
    }
    TRY(lines_.status());
    return end_block();
  }

 private:
  bool next_row(std::string_view& row) {
    const bool more = lines_.next(row);
    if (more && ++line_ == 1 && row.starts_with("\xEF\xBB\xBF")) row.remove_prefix(3);
    return more;
  }

  Status end_block() {
    const auto resize = [&](std::size_t rows) {
      table_.columns.resize(wanted_.size());
      for (std::size_t k = 0; k < wanted_.size(); ++k) table_.columns[k].resize(index_[k] == missing ? 0 : rows);
      table_.position.resize(rows);
      table_.line.resize(rows);
    };
    resize(used_);
    TRY(sink_.add(table_));
    resize(block_rows);
    table_.bad_rows = 0;
    used_ = 0;
    return {};
  }

  static bool is_remark(std::string_view row) { return row.starts_with("//"); }  // as Xsens writes

  Error defect(const std::string& what) const {
    return input_error(file_name_ + ":" + std::to_string(line_) + ": " + what);
  }

  Status find_columns(const std::vector<std::string>& header) {
    for (const WantedColumn& column : wanted_) {
      const auto at = std::ranges::find(header, column.name);
      if (at != header.end() && std::find(at + 1, header.end(), column.name) != header.end())
        return defect("column " + quoted(column.name) + " twice: expected one of that name");
      if (at != header.end()) {
        named_ = true;
        index_.push_back(std::size_t(at - header.begin()));
      } else if (const auto index = parse_integer<std::int64_t>(column.name); index && *index >= 1 && *index <= 10000) {
        index_.push_back(std::size_t(*index - 1));
      } else if (column.may_be_missing) {
        index_.push_back(missing);
      } else {
        return defect(fmt::format("no column {}; the header has {}{}", quoted(column.name),
                                  counted(std::ssize(header), "name"),
                                  header.empty() ? ": give column numbers, or csv.header_lines"
                                                 : ", the first is " + quoted(header.front())) +
                      did_you_mean(column.name, header));
      }
    }
    return {};
  }

  // Finds which wanted column each cell is, for rows of plain numbers.
  void find_cells() {
    if (format_.delimiter == ' ' || format_.decimal_comma || format_.whole_rows) return;
    if (!format_.only_wanted && width_ == 0) return;  // the first row tells the width
    for (std::size_t k = 0; k < index_.size(); ++k) {
      if (index_[k] == missing) continue;
      cells_wanted_.resize(std::max(cells_wanted_.size(), index_[k] + 1), missing);
      if (std::exchange(cells_wanted_[index_[k]], k) != missing) return cells_wanted_.clear();
    }
    if (!format_.only_wanted) cells_wanted_.resize(std::max(cells_wanted_.size(), width_), missing);
  }

  // Reads a row whose wanted cells are plain numbers, as most are. Returns false if read_row() has to look.
  bool read_plain_row(std::string_view text) {
    const char *at = text.data(), *const end = at + text.size();
    for (std::size_t cell = 0; cell < cells_wanted_.size(); ++cell) {
      if (cell > 0 && (at == end || *at++ != format_.delimiter)) return false;
      const std::size_t k = cells_wanted_[cell];
      if (k == missing) {
        at = std::find(at, end, format_.delimiter);
        continue;
      }
      double& value = table_.columns[k][used_] = NAN;
      at = std::from_chars(at, end, value).ptr;
      if (!std::isfinite(value)) return false;
    }
    return !cells_wanted_.empty() && (at == end || (format_.only_wanted && *at == format_.delimiter));
  }

  Result<double> number(std::size_t column) const {
    const WantedColumn& wanted = wanted_[column];
    if (index_[column] >= cells_.size()) {
      if (wanted.may_be_blank) return std::numeric_limits<double>::quiet_NaN();
      return defect("column " + quoted(wanted.name) + " is missing: the row has " +
                    counted(std::ssize(cells_), "column"));
    }
    const std::string_view cell = cells_[index_[column]];
    if (wanted.may_be_blank && (cell.empty() || cell == "nan" || cell == "NaN"))
      return std::numeric_limits<double>::quiet_NaN();
    if (const std::optional<double> value = device_number(cell, format_.decimal_comma)) return *value;
    if (const std::optional<double> utc_s = parse_time_stamp(cell)) return *utc_s;
    return defect(
        "column " + quoted(wanted.name) + " = " + quoted(cell) +
        (cell.find(':') == cell.npos ? ": expected a number" : ": expected a time as 2026-01-31 12:00:00.04"));
  }

  Status read_row(std::string_view text) {
    split_cells(text, format_.delimiter, cells_);
    if (!format_.only_wanted) {
      if (width_ == 0) width_ = cells_.size(), find_cells();
      while (!format_.whole_rows && cells_.size() > width_ && cells_.back().empty()) cells_.pop_back();
      // With a cell more or less, the others may be in the wrong columns.
      if (cells_.size() != width_)
        return defect(fmt::format("the row has {}: expected {}, as {}", counted(std::ssize(cells_), "column"), width_,
                                  named_ || format_.whole_rows ? "the header has names" : "the first row has"));
    }
    for (std::size_t k = 0; k < wanted_.size(); ++k) {
      if (index_[k] == missing) continue;
      table_.columns[k][used_] = TRY(number(k));
    }
    return {};
  }

  const TableBytes& bytes_;
  LineReader lines_;
  const std::string& file_name_;
  const std::vector<WantedColumn>& wanted_;
  const TableFormat& format_;
  BlockHandler& sink_;
  std::int64_t line_ = 0;
  std::vector<std::string_view> cells_;
  std::size_t width_ = 0;  // cells in a row: names of the header, or else cells of the first row; 0: unknown
  bool named_ = false;     // a column is wanted by name
  static constexpr std::size_t missing = std::size_t(-1), block_rows = std::size_t{1} << 14;
  std::vector<std::size_t> index_, cells_wanted_;  // the cell of each wanted column, and the reverse
  NumberTable table_;                              // `used_` rows of it
  std::size_t used_ = 0;
};

// ---- .npy (numpy.lib.format, versions 1 to 3) and .mat (libmatio) ----

struct ItemType {
  std::string_view npy;
  matio_types mat;
  std::size_t bytes;
  void (*load)(const std::byte* from, std::size_t step, std::span<double> out);
};
template <class T>
constexpr ItemType item_type(std::string_view npy, matio_types mat) {
  return {npy, mat, sizeof(T), [](const std::byte* from, std::size_t step, std::span<double> out) {
            for (double& value : out) value = double(load_bytes<T>(from)), from += step;
          }};
}
constexpr ItemType item_types[] = {
    item_type<double>("f8", MAT_T_DOUBLE),      item_type<float>("f4", MAT_T_SINGLE),
    item_type<std::int8_t>("i1", MAT_T_INT8),   item_type<std::uint8_t>("u1", MAT_T_UINT8),
    item_type<std::int16_t>("i2", MAT_T_INT16), item_type<std::uint16_t>("u2", MAT_T_UINT16),
    item_type<std::int32_t>("i4", MAT_T_INT32), item_type<std::uint32_t>("u4", MAT_T_UINT32),
    item_type<std::int64_t>("i8", MAT_T_INT64), item_type<std::uint64_t>("u8", MAT_T_UINT64)};

// A matrix of numbers in memory, in either order.
struct MatrixView {
  std::size_t rows = 0;
  std::size_t columns = 0;
  bool column_major = false;
  const std::byte* data = nullptr;
  const ItemType* type = nullptr;
  std::vector<double> column(std::size_t column) const {
    std::vector<double> values(rows);
    type->load(data + (column_major ? column * rows : column) * type->bytes, (column_major ? 1 : columns) * type->bytes,
               values);
    return values;
  }
  template <class Is>
  bool set_type(Is is) {
    type = std::find_if(std::begin(item_types), std::end(item_types), is);
    return type != std::end(item_types);
  }
};

// Splits "name:2" into its parts; without a colon the second is "1".
std::pair<std::string, std::string> path_and_part(const std::string& name) {
  const std::size_t colon = name.find(':');
  return {name.substr(0, colon), colon == name.npos ? "1" : name.substr(colon + 1)};
}

// Returns the place, from 0, of a column's number, from 1; nothing if there are not so many.
std::optional<std::size_t> place_among(std::size_t columns, std::string_view number) {
  const auto index = parse_integer<std::size_t>(number);
  return index && *index >= 1 && *index <= columns ? std::optional(*index - 1) : std::nullopt;
}

Error column_error(const std::string& file_name, const std::string& name, const std::string& what) {
  return input_error(file_name + ": column " + quoted(name) + ": " + what);
}

std::string meant_of(const std::string& name, const Result<std::vector<std::string>>& columns) {
  return columns ? did_you_mean(name, *columns) : "";
}

// `read_column` maps a WantedColumn to a Result of numbers, none if it is missing and may be. `first` is the number of the first row.
template <class ReadColumn>
Result<NumberTable> read_arrays(const std::string& file_name, const std::vector<WantedColumn>& wanted,
                                ReadColumn read_column, std::int64_t first = 0) {
  NumberTable table;
  std::size_t rows = 0;
  for (const WantedColumn& column : wanted) {
    const std::vector<double>& values = table.columns.emplace_back(TRY(read_column(column)));
    if (rows > 0 && !values.empty() && values.size() != rows)
      return column_error(
          file_name, column.name,
          fmt::format("has {}: expected {}, as the columns before", counted(std::ssize(values), "row"), rows));
    rows = std::max(rows, values.size());
  }
  table.position.resize(rows);
  table.line.resize(rows);
  std::iota(table.position.begin(), table.position.end(), first);
  std::iota(table.line.begin(), table.line.end(), first + 1);
  return table;
}

// Returns the text after 'key': in the header, which is a Python dictionary.
std::string_view value_of(std::string_view header, const std::string& key) {
  const std::size_t at = header.find("'" + key + "':");
  return at == std::string_view::npos ? std::string_view() : trimmed(header.substr(at + key.size() + 3));
}

// An array whose numbers begin at byte `begin` of the file.
struct NpyArray {
  MatrixView view;
  std::uint64_t begin = 0;
};

Result<NpyArray> open_npy(const TableBytes& file, const std::string& file_name) {
  const auto refuse = [&](const std::string& what) { return input_error(file_name + ": " + what); };
  constexpr std::uint64_t longest_header = 1 << 16;
  const std::string_view content = TRY(file.at(0, longest_header));
  if (content.size() < 12) return refuse("the header of the .npy file is cut off");
  const auto* bytes = reinterpret_cast<const std::byte*>(content.data());
  const bool long_header = int(content[6]) > 1;
  const std::size_t length = long_header ? load_bytes<std::uint32_t>(bytes + 8) : load_bytes<std::uint16_t>(bytes + 8);
  const std::size_t begin = long_header ? 12 : 10;
  if (length > content.size() - begin) return refuse("the header of the .npy file is cut off");
  const std::string_view header = content.substr(begin, length);
  std::string_view type = value_of(header, "descr");
  MatrixView view;
  if (type.size() < 5 || (type[1] != '<' && type[1] != '|') || type[4] != '\'' ||
      !view.set_type([&](const ItemType& t) { return t.npy == type.substr(2, 2); }))
    return refuse("type " + quoted(type.substr(0, type.find_first_of(",}"))) +
                  ": expected a .npy array of little-endian numbers, as in '<f8' or '<i2'");
  view.column_major = value_of(header, "fortran_order").starts_with("True");
  std::string_view shape = value_of(header, "shape");
  std::vector<std::size_t> sizes;
  if (shape.starts_with('(') && shape.find(')') != std::string_view::npos)
    for (const std::string_view part : split(shape.substr(1, shape.find(')') - 1), ','))
      if (const auto size = parse_integer<std::int64_t>(part); size && *size >= 0) sizes.push_back(std::size_t(*size));
  if (sizes.empty() || sizes.size() > 2)
    return refuse("shape " + quoted(shape.substr(0, shape.find(')') + 1)) +
                  ": expected one or two dimensions, rows first");
  if (std::ranges::count(sizes, 0) > 0)
    return refuse("shape " + quoted(shape.substr(0, shape.find(')') + 1)) + ": an empty array: expected rows");
  view.rows = sizes[0];
  view.columns = sizes.size() == 2 ? sizes[1] : 1;
  const std::uint64_t have = (file.size - begin - length) / view.type->bytes;
  if (have / view.columns < view.rows)
    return refuse(fmt::format("the .npy file is cut off: expected {} rows of {}", view.rows, view.columns));
  return NpyArray{view, begin + length};
}

template <class Take>  // NumberTable -> Status
Status read_npy(const TableBytes& file, const std::string& file_name, const std::vector<WantedColumn>& wanted,
                Take take) {
  const NpyArray array = TRY(open_npy(file, file_name));
  const MatrixView& view = array.view;
  const std::uint64_t item = view.type->bytes;
  constexpr std::uint64_t most = 1 << 18;  // bytes of a block
  for (std::uint64_t row = 0, rows = 0; row < view.rows; row += rows) {
    rows = std::clamp<std::uint64_t>(most / (item * view.columns), 1, view.rows - row);
    MatrixView block{.rows = rows, .columns = view.columns, .data = nullptr, .type = view.type};
    const auto load = [&](std::uint64_t at, std::uint64_t bytes) -> Status {
      const std::string_view piece = TRY(file.at(array.begin + at, bytes));
      if (piece.size() < bytes) return input_error(file_name + ": the .npy file is cut off");
      block.data = reinterpret_cast<const std::byte*>(piece.data());
      return {};
    };
    if (!view.column_major) TRY(load(row * view.columns * item, rows * view.columns * item));
    const auto read_column = [&](const WantedColumn& column) -> Result<std::vector<double>> {
      const auto place = place_among(view.columns, column.name);
      if (!place)
        return input_error("{}: no column {}: expected a number from 1 to {}, a .npy array has no names", file_name,
                           quoted(column.name), view.columns);
      if (!view.column_major) return block.column(*place);
      TRY(load((*place * view.rows + row) * item, rows * item));
      return MatrixView{.rows = rows, .columns = 1, .data = block.data, .type = view.type}.column(0);
    };
    NumberTable table = TRY(read_arrays(file_name, wanted, read_column, std::int64_t(row)));
    TRY(take(std::move(table)));
  }
  return {};
}

using MatFile = std::unique_ptr<mat_t, int (*)(mat_t*)>;
using MatVariable = std::unique_ptr<matvar_t, void (*)(matvar_t*)>;

bool inflates(std::span<const std::byte> packed) {
  z_stream stream{};
  if (inflateInit(&stream) != Z_OK) return false;
  std::vector<Bytef> out(1 << 16);
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<std::byte*>(packed.data()));
  stream.avail_in = static_cast<uInt>(packed.size());
  int code = Z_OK;
  while (code == Z_OK) {
    stream.next_out = out.data();
    stream.avail_out = static_cast<uInt>(out.size());
    code = inflate(&stream, Z_NO_FLUSH);
  }
  inflateEnd(&stream);
  return code == Z_STREAM_END;
}

// Checks that a .mat file is whole, since libmatio reads missing bytes as zeros and checks no sum. Version 5: elements of type (u32), size (u32), content.
Status check_mat(const std::string& file_name) {
  constexpr std::uint64_t header = 128, tag = 8, version = 124;
  const PosixFile file = TRY(PosixFile::open_to_read(file_name));
  const std::uint64_t size = TRY(file.size());
  FileWindow window(file, size);
  if (size < header) return input_error(file_name + ": the .mat file is cut off");
  const std::span<const std::byte> marks = TRY(window.at(version, 4));
  const bool swapped = marks[2] == std::byte{'M'};
  if (marks[swapped ? 0 : 1] != std::byte{1}) return {};  // HDF5
  const auto number = [&](const std::byte* at) {
    const auto value = load_bytes<std::uint32_t>(at);
    return swapped ? __builtin_bswap32(value) : value;
  };
  constexpr std::uint32_t matrix = 14, compressed = 15;
  for (std::uint64_t at = header; at < size;) {
    const auto damaged = [&](const char* what) { return input_error("{}: byte {}: {}", file_name, at, what); };
    if (size - at < tag) return damaged("the .mat file is cut off");
    const std::span<const std::byte> head = TRY(window.at(at, tag));
    const std::uint32_t type = number(head.data()), length = number(head.data() + 4);
    if (length > size - at - tag) return damaged("the .mat file is cut off");
    if (type != matrix && type != compressed) return damaged("expected a variable: the file is damaged");
    if (type == compressed && !inflates(TRY(window.at(at + tag, length)).first(length)))
      return damaged("a variable does not decompress: the file is damaged");
    at += tag + length;
  }
  return {};
}

Result<MatFile> open_mat(const std::string& file_name) {
  TRY(check_mat(file_name));
  MatFile file(Mat_Open(file_name.c_str(), MAT_ACC_RDONLY), Mat_Close);
  if (!file) return input_error(file_name + ": libmatio cannot read this .mat file");
  return file;
}

// Views a matrix of real numbers, with samples along the longer side. Anything else has no rows.
MatrixView view_mat(const matvar_t& variable) {
  MatrixView view;
  if (!view.set_type([&](const ItemType& t) { return t.mat == variable.data_type; }) || variable.rank != 2 ||
      variable.isComplex != 0 || variable.class_type < MAT_C_DOUBLE || variable.class_type > MAT_C_UINT64 ||
      variable.nbytes / view.type->bytes < variable.dims[0] * variable.dims[1])
    return {};
  view.rows = std::max(variable.dims[0], variable.dims[1]);
  view.columns = std::min(variable.dims[0], variable.dims[1]);
  view.column_major = variable.dims[0] >= variable.dims[1];
  view.data = static_cast<const std::byte*>(variable.data);
  return view;
}

constexpr std::size_t widest = 32;

// Lists a vector as "name", a matrix as "name:1" and so on.
void list_columns(const std::string& name, std::size_t rows, std::size_t columns, std::vector<std::string>& names) {
  if (rows < 2 || columns > widest) return;
  for (std::size_t k = 1; k <= columns; ++k) names.push_back(columns == 1 ? name : fmt::format("{}:{}", name, k));
}

void list_variable(const std::string& name, matvar_t& variable, std::vector<std::string>& names) {
  if (variable.class_type == MAT_C_STRUCT) {
    const char* const* const fields = Mat_VarGetStructFieldnames(&variable);
    for (unsigned k = 0; fields != nullptr && k < Mat_VarGetNumberOfFields(&variable); ++k)
      if (matvar_t* const field = Mat_VarGetStructFieldByIndex(&variable, k, 0); field != nullptr)
        list_variable(name + "." + fields[k], *field, names);
  } else if (const MatrixView view = view_mat(variable); view.type != nullptr) {
    list_columns(name, view.rows, view.columns, names);
  }
}

Result<std::vector<std::string>> mat_columns(const std::string& file_name) {
  const MatFile file = TRY(open_mat(file_name));
  std::vector<std::string> names;
  for (;;) {
    const MatVariable variable(Mat_VarReadNext(file.get()), Mat_VarFree);
    if (!variable) return names;
    if (variable->name == nullptr) return input_error(file_name + ": a variable without a name: the file is damaged");
    list_variable(variable->name, *variable, names);
  }
}

Result<NumberTable> read_mat(const std::string& file_name, const std::vector<WantedColumn>& wanted) {
  const MatFile file = TRY(open_mat(file_name));
  MatVariable variable(nullptr, Mat_VarFree);  // the last one: a matrix may have all the columns
  return read_arrays(file_name, wanted, [&](const WantedColumn& column) -> Result<std::vector<double>> {
    const auto [path, number] = path_and_part(column.name);
    const std::vector<std::string_view> names = split(path, '.');
    if (!variable || variable->name != names.front())
      variable.reset(Mat_VarRead(file.get(), std::string(names.front()).c_str()));
    matvar_t* found = variable.get();
    for (std::size_t k = 1; k < names.size() && found != nullptr; ++k)
      found = found->class_type == MAT_C_STRUCT ? Mat_VarGetStructFieldByName(found, std::string(names[k]).c_str(), 0)
                                                : nullptr;
    if (found == nullptr && column.may_be_missing) return std::vector<double>();
    const auto refuse = [&](const std::string& what) { return column_error(file_name, column.name, what); };
    if (found == nullptr || found->data == nullptr)
      return refuse("no variable " + quoted(path) + " of numbers: expected name, name:column or struct.name" +
                    meant_of(column.name, mat_columns(file_name)));
    const MatrixView view = view_mat(*found);
    if (view.type == nullptr) return refuse("expected a real matrix of two dimensions");
    if (const auto place = place_among(view.columns, number)) return view.column(*place);
    return refuse("expected a column from 1 to " + std::to_string(view.columns));
  });
}

// ---- HDF5 ----

class Hdf5Id {
 public:
  Hdf5Id(hid_t id, herr_t (*close)(hid_t)) : id_(id), close_(close) {}
  ~Hdf5Id() {
    if (id_ >= 0) close_(id_);
  }
  Hdf5Id(const Hdf5Id&) = delete;
  Hdf5Id& operator=(const Hdf5Id&) = delete;
  operator hid_t() const { return id_; }

 private:
  hid_t id_;
  herr_t (*close_)(hid_t);
};

hid_t open_hdf5(const std::string& file_name) {
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
  return H5Fopen(file_name.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
}

// The shape of a dataset of one or two dimensions; any other has no rows.
struct Hdf5Shape {
  std::size_t rows = 0, columns = 0;
  bool along_rows = false;  // samples are columns, as in a .mat file
  explicit Hdf5Shape(hid_t space) {
    hsize_t sizes[2] = {0, 1};
    if (const int rank = H5Sget_simple_extent_ndims(space); rank != 1 && rank != 2) return;
    H5Sget_simple_extent_dims(space, sizes, nullptr);
    along_rows = sizes[0] < sizes[1];
    rows = std::max(sizes[0], sizes[1]);
    columns = std::min(sizes[0], sizes[1]);
  }
};

bool is_number(H5T_class_t type) { return type == H5T_INTEGER || type == H5T_FLOAT; }

herr_t list_hdf5_object(hid_t file, const char* name, const H5O_info_t* info, void* names) {
  if (info->type != H5O_TYPE_DATASET) return 0;
  const Hdf5Id set(H5Dopen2(file, name, H5P_DEFAULT), H5Dclose);
  const Hdf5Id space(H5Dget_space(set), H5Sclose), type(H5Dget_type(set), H5Tclose);
  const Hdf5Shape shape(space);
  auto& list = *static_cast<std::vector<std::string>*>(names);
  if (is_number(H5Tget_class(type))) list_columns(name, shape.rows, shape.columns, list);
  for (int k = 0; H5Tget_class(type) == H5T_COMPOUND && k < H5Tget_nmembers(type); ++k) {
    char* const member = H5Tget_member_name(type, unsigned(k));
    if (is_number(H5Tget_member_class(type, unsigned(k)))) list.push_back(fmt::format("{}:{}", name, member));
    H5free_memory(member);
  }
  return 0;
}

Result<std::vector<std::string>> hdf5_columns(const std::string& file_name) {
  const Hdf5Id file(open_hdf5(file_name), H5Fclose);
  std::vector<std::string> names;
  if (file < 0 || H5Ovisit2(file, H5_INDEX_NAME, H5_ITER_NATIVE, list_hdf5_object, &names, H5O_INFO_BASIC) < 0)
    return input_error(file_name + ": libhdf5 cannot read this file");
  return names;
}

FileKind form_of(std::string_view content) { return recognise_content(content.substr(0, 16)); }

Result<std::vector<double>> read_hdf5_column(hid_t file, const std::string& file_name, const std::string& name) {
  const auto refuse = [&](const std::string& what) { return column_error(file_name, name, what); };
  const auto [path, part] = path_and_part(name);
  const Hdf5Id set(H5Dopen2(file, path.c_str(), H5P_DEFAULT), H5Dclose);
  if (set < 0)
    return refuse("no dataset " + quoted(path) + ": expected group/name, group/name:column or group/name:field" +
                  meant_of(name, hdf5_columns(file_name)));
  const Hdf5Id space(H5Dget_space(set), H5Sclose), type(H5Dget_type(set), H5Tclose);
  const Hdf5Shape shape(space);
  const bool compound = H5Tget_class(type) == H5T_COMPOUND;
  const int member = compound ? H5Tget_member_index(type, part.c_str()) : 0;
  const auto column = place_among(shape.columns, part);
  if (shape.rows == 0 || member < 0 ||
      !is_number(compound ? H5Tget_member_class(type, unsigned(member)) : H5Tget_class(type)))
    return refuse("expected numbers in one or two dimensions");
  if (!compound && !column) return refuse("expected a column from 1 to " + std::to_string(shape.columns));
  // Deflate packs at most a thousand to one, which bounds what a file can hold.
  hsize_t bytes = 0;
  H5Fget_filesize(file, &bytes);
  if (shape.rows > 1000 * bytes)
    return refuse(fmt::format("{} rows: more than a file of {} bytes can hold", shape.rows, bytes));
  const Hdf5Id field(H5Tcreate(H5T_COMPOUND, sizeof(double)), H5Tclose);
  H5Tinsert(field, part.c_str(), 0, H5T_NATIVE_DOUBLE);
  if (!compound) {
    const hsize_t at = *column, first[2] = {shape.along_rows ? at : 0, shape.along_rows ? 0 : at};
    const hsize_t count[2] = {shape.along_rows ? 1 : shape.rows, shape.along_rows ? shape.rows : 1};
    H5Sselect_hyperslab(space, H5S_SELECT_SET, first, nullptr, count, nullptr);
  }
  const hsize_t size = shape.rows;
  const Hdf5Id memory(H5Screate_simple(1, &size, nullptr), H5Sclose);
  std::vector<double> values(shape.rows);
  if (H5Dread(set, compound ? static_cast<hid_t>(field) : H5T_NATIVE_DOUBLE, memory, space, H5P_DEFAULT,
              values.data()) < 0)
    return refuse("cannot be read: the file is damaged, or compressed in a way that libhdf5 does not know");
  return values;
}

Result<NumberTable> read_hdf5(const std::string& file_name, const std::vector<WantedColumn>& wanted) {
  const Hdf5Id file(open_hdf5(file_name), H5Fclose);
  if (file < 0) return input_error(file_name + ": libhdf5 cannot read this file");
  return read_arrays(file_name, wanted,
                     [&](const WantedColumn& column) { return read_hdf5_column(file, file_name, column.name); });
}

// Leaves out rows with numbers that are not finite, or returns the first as an error.
Result<NumberTable> checked(NumberTable table, const std::string& file_name, const std::vector<WantedColumn>& wanted,
                            bool skip_bad) {
  std::size_t kept = 0;
  for (std::size_t row = 0; row < table.rows(); ++row) {
    const auto is_bad = [&](std::size_t k) {
      return !table.columns[k].empty() && !std::isfinite(table.columns[k][row]) &&
             !(wanted[k].may_be_blank && std::isnan(table.columns[k][row]));
    };
    std::size_t bad = 0;
    while (bad < wanted.size() && !is_bad(bad)) ++bad;
    if (bad < wanted.size()) {
      Error error = input_error("{}: row {}: column {} = '{}': expected a finite number", file_name, table.line[row],
                                quoted(wanted[bad].name), format_number(table.columns[bad][row]));
      if (!skip_bad) return error;
      if (table.bad_rows++ == 0) table.first_bad = error.message;
      continue;
    }
    for (std::vector<double>& column : table.columns)
      if (!column.empty()) column[kept] = column[row];
    table.position[kept] = table.position[row];
    table.line[kept++] = table.line[row];
  }
  for (std::vector<double>& column : table.columns) column.resize(std::min(kept, column.size()));
  table.position.resize(kept);
  table.line.resize(kept);
  return table;
}

constexpr const char* mat_header = "MATLAB 5.0 MAT-file, written by turncal";

std::string npy_header(std::size_t rows, std::size_t fields) {
  std::string text = fmt::format("{{'descr': '<f8', 'fortran_order': False, 'shape': ({}, {}), }}", rows, fields);
  constexpr std::size_t prefix = 10, block = 64;  // the data begin at a multiple of a block
  text.resize((prefix + text.size() + 1 + block - 1) / block * block - prefix - 1, ' ');
  text += '\n';
  const char version_and_size[] = {1, 0, char(text.size() & 0xff), char(text.size() >> 8)};
  return std::string(npy_magic).append(version_and_size, sizeof version_and_size) + text;
}

// A table that can be read row by row, any number of times.
using RowSink = std::function<Status(std::span<const double> row)>;
struct RowTable {
  std::vector<std::string> names;  // of the columns
  std::size_t rows = 0;
  std::function<Status(const RowSink&)> each_row;
};

// `append_row` appends a row to a text.
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

// Takes a pass for each column.
Status write_mat_variables(const std::string& path, const std::string& temporary, const RowTable& table) {
  const Error cannot_write = device_error(path + ": cannot write");
  std::unique_ptr<mat_t, int (*)(mat_t*)> file(Mat_CreateVer(temporary.c_str(), mat_header, MAT_FT_MAT5), Mat_Close);
  if (!file) return cannot_write;
  std::vector<double> values;
  values.reserve(table.rows);
  for (std::size_t k = 0; k < table.names.size(); ++k) {
    std::string name = table.names[k];
    std::ranges::replace(name, '.', '_');
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
  // libmatio does not report a full disk.
  file.reset();
  const Result<PosixFile> written = PosixFile::open_to_read(temporary);
  const Result<std::uint64_t> size = written ? written->size() : Result<std::uint64_t>(written.error());
  if (!size || *size < table.rows * table.names.size() * sizeof(double)) return cannot_write;
  return rename_durably(temporary, path);
}

// Chooses the form by the ending of the name.
Status write_table(const std::string& path, const RowTable& table) {
  if (!path.ends_with(".mat")) return path.ends_with(".npy") ? write_npy(path, table) : write_csv(path, table);
  TRY(check_replaceable(path, mat_header));
  const std::string temporary = temporary_name(path);
  Status status = write_mat_variables(path, temporary, table);
  if (!status) ::unlink(temporary.c_str());
  return status;
}

}  // namespace

Status check_text(std::string_view head, const std::string& file_name) {
  const auto refuse = [&](const char* what) { return input_error(file_name + ": " + what); };
  if (head.starts_with("\xFF\xFE") || head.starts_with("\xFE\xFF"))
    return refuse("a text in UTF-16 or UTF-32: expected UTF-8 or plain ASCII, as `iconv -f UTF-16 -t UTF-8` makes it");
  constexpr std::size_t mat4_header = 20, mat4_name_length = 16;
  if (head.size() > mat4_header && head[0] < 53 && head.substr(1, 3) == std::string_view("\0\0\0", 3) &&
      head[mat4_name_length] > 1)
    return refuse("a MATLAB file of version 4, it seems: expected version 5 or later, as `save -v7` writes");
  if (head.find('\n') == head.npos && head.find('\r') != head.npos)
    return refuse("lines end in a carriage return alone: expected line feeds, as `tr '\\r' '\\n'` makes them");
  return {};
}

bool is_text_table(std::string_view content) {
  const FileKind form = form_of(content);
  return form != FileKind::npy && form != FileKind::mat && form != FileKind::hdf5;
}

Result<std::vector<std::string>> column_names(const TableBytes& bytes, const std::string& file_name) {
  const FileKind form = form_of(TRY(bytes.at(0, 1)));
  if (form == FileKind::mat) return mat_columns(file_name);
  if (form == FileKind::hdf5) return hdf5_columns(file_name);
  const NpyArray array = TRY(open_npy(bytes, file_name));
  std::vector<std::string> names;
  for (std::size_t k = 1; k <= std::min(array.view.columns, widest); ++k) names.push_back(std::to_string(k));
  return names;
}

Result<TableBytes> bytes_of_file(const std::string& path) {
  const auto file = std::make_shared<const PosixFile>(TRY(PosixFile::open_to_read(path)));
  const std::uint64_t size = TRY(file->size());
  const auto window = std::make_shared<FileWindow>(*file, size);
  return TableBytes{size, [file, window](std::uint64_t from, std::uint64_t least) -> Result<std::string_view> {
                      const std::span<const std::byte> bytes = TRY(window->at(from, least));
                      return std::string_view(reinterpret_cast<const char*>(bytes.data()), bytes.size());
                    }};
}

TableBytes bytes_of_text(std::string_view text) {
  return {text.size(), [text](std::uint64_t from, std::uint64_t) { return text.substr(from); }};
}

Status read_number_table(const TableBytes& bytes, const std::string& file_name, const std::vector<WantedColumn>& wanted,
                         const TableFormat& format, const TableSink& sink) {
  const FileKind form = form_of(TRY(bytes.at(0, 1)));
  BlockHandler handler(sink);
  const auto check = [&](NumberTable block) -> Status {
    NumberTable good = TRY(checked(std::move(block), file_name, wanted, format.skip_bad_rows));
    return handler.add(good);
  };
  Status read = form == FileKind::npy    ? read_npy(bytes, file_name, wanted, check)
                : form == FileKind::mat  ? check(TRY(read_mat(file_name, wanted)))
                : form == FileKind::hdf5 ? check(TRY(read_hdf5(file_name, wanted)))
                                         : CsvTable(bytes, file_name, wanted, format, handler).read();
  Status taken = handler.finish();  // an error of the sink came first
  return taken ? read : taken;
}

void append_rows(NumberTable& table, const NumberTable& block) {
  const auto append = [](auto& to, const auto& from) { to.insert(to.end(), from.begin(), from.end()); };
  table.columns.resize(block.columns.size());
  for (std::size_t k = 0; k < block.columns.size(); ++k) append(table.columns[k], block.columns[k]);
  append(table.position, block.position);
  append(table.line, block.line);
  if (table.bad_rows == 0) table.first_bad = block.first_bad;
  table.bad_rows += block.bad_rows;
}

Result<NumberTable> read_number_table(std::string_view content, const std::string& file_name,
                                      const std::vector<WantedColumn>& wanted, const TableFormat& format) {
  NumberTable table;
  TRY(read_number_table(bytes_of_text(content), file_name, wanted, format, [&](const NumberTable& block) {
    append_rows(table, block);
    return Status();
  }));
  return table;
}

// ---- written ----

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
  return write_table(path, table);
}

Status check_ending(std::string_view path, std::initializer_list<std::string_view> endings) {
  if (std::ranges::any_of(endings, [&](std::string_view ending) { return path.ends_with(ending); })) return {};
  return input_error("{}: expected a name that ends in one of {}", path, fmt::join(endings, ", "));
}

Status write_sample_columns(RecordingSource& source, SampleColumns columns, const std::string& path) {
  std::size_t rows = 0;
  bool flagged = false;
  TRY(source.read([&](std::span<const ImuSample> samples) {
    rows += samples.size();
    for (const ImuSample& sample : samples) flagged = flagged || sample.flags != 0;
    return Status();
  }));
  if (flagged) columns.names.emplace_back("flags");
  if (rows == 0 && names_matrix(path)) return input_error(source.path() + ": not one sample: expected some to write");
  std::vector<double> row(columns.names.size());
  const auto each_row = [&](const RowSink& sink) {
    return source.read([&](std::span<const ImuSample> samples) -> Status {
      for (const ImuSample& sample : samples) {
        columns.fill(sample, row);
        if (flagged) row.back() = double(sample.flags);
        TRY(sink(row));
      }
      return {};
    });
  };
  return write_table(path, {columns.names, rows, each_row});
}

Status write_recording_columns(RecordingSource& source, const std::string& path) {
  const bool has_temperature = source.info().has_temperature;
  TRY(check_replaceable(path, path.ends_with(".mat") ? std::string_view(mat_header) : npy_magic));
  SampleColumns columns{{"sample", "segment", "gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"}, {}};
  if (has_temperature) columns.names.emplace_back("temperature_c");
  const Segments& segments = source.segments();
  std::size_t segment = 0;
  columns.fill = [&](const ImuSample& sample, std::span<double> row) {
    if (segment > 0 && sample.counter < segments[segment - 1].end_sample) segment = 0;  // a new pass begins
    while (segment < segments.size() && sample.counter >= segments[segment].end_sample) ++segment;
    const bool inside = segment < segments.size() && sample.counter >= segments[segment].start_sample;
    row[0] = double(sample.counter);
    row[1] = inside ? double(segment + 1) : 0.0;
    std::ranges::copy(sample.gyro, row.begin() + 2);
    std::ranges::copy(sample.accel, row.begin() + 5);
    if (has_temperature) row[8] = double(sample.temperature_c);
  };
  return write_sample_columns(source, columns, path);
}

}  // namespace turncal
