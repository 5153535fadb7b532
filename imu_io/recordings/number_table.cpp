#include "imu_io/recordings/number_table.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "imu_io/base/format_number.h"
#include "imu_io/base/text_pieces.h"

namespace turncal {
namespace {

class CsvTable {
 public:
  CsvTable(std::string_view text, const std::string& file_name, const std::vector<WantedColumn>& wanted,
           const TableFormat& format)
      : text_(text), file_name_(file_name), wanted_(wanted), format_(format) {}
  Result<NumberTable> read();

 private:
  Error defect(const std::string& what) const {
    return input_error(file_name_ + ":" + std::to_string(line_) + ": " + what);
  }
  void split_row(std::string_view row);
  Status find_columns(const std::vector<std::string>& header);
  Result<double> number(std::size_t column) const;
  Status read_row(std::string_view row);

  std::string_view text_;
  const std::string& file_name_;
  const std::vector<WantedColumn>& wanted_;
  const TableFormat& format_;
  std::int64_t line_ = 0;
  std::vector<std::string_view> cells_;
  std::size_t header_cells_ = 0;
  static constexpr std::size_t missing = static_cast<std::size_t>(-1);
  std::vector<std::size_t> index_;  // of each wanted column
  std::vector<double> row_;
  NumberTable table_;
};

void CsvTable::split_row(std::string_view row) {
  cells_.clear();
  if (format_.delimiter == ' ') {  // any run of blanks
    for (std::size_t at = 0; at < row.size();) {
      const std::size_t from = row.find_first_not_of(" \t", at);
      if (from == std::string_view::npos) break;
      at = std::min(row.find_first_of(" \t", from), row.size());
      cells_.push_back(row.substr(from, at - from));
    }
    return;
  }
  for (std::size_t at = 0; at <= row.size();) {
    const std::size_t end = std::min(row.find(format_.delimiter, at), row.size());
    cells_.push_back(trimmed(row.substr(at, end - at)));
    at = end + 1;
  }
}

Status CsvTable::find_columns(const std::vector<std::string>& header) {
  for (const WantedColumn& column : wanted_) {
    const auto at = std::find(header.begin(), header.end(), column.name);
    if (at != header.end() && std::find(at + 1, header.end(), column.name) != header.end())
      return defect("column " + quoted(column.name) + " twice: expected one of that name");
    if (at != header.end()) {
      index_.push_back(static_cast<std::size_t>(at - header.begin()));
    } else if (const auto index = parse_integer<std::int64_t>(column.name); index && *index >= 1 && *index <= 10000) {
      index_.push_back(static_cast<std::size_t>(*index - 1));
    } else if (column.may_be_missing) {
      index_.push_back(missing);
    } else {
      return defect(
          "no column " + quoted(column.name) + "; the header has " + std::to_string(header.size()) + " names" +
          (header.empty() ? ": give column numbers, or csv.header_lines" : ", the first is " + quoted(header.front())));
    }
  }
  return {};
}

Result<double> CsvTable::number(std::size_t column) const {
  const WantedColumn& wanted = wanted_[column];
  if (index_[column] >= cells_.size()) {
    if (wanted.may_be_blank) return std::numeric_limits<double>::quiet_NaN();
    return defect("column " + quoted(wanted.name) + " is missing: the row has " + std::to_string(cells_.size()) +
                  " columns");
  }
  std::string_view cell = cells_[index_[column]];
  if (wanted.may_be_blank && (cell.empty() || cell == "nan" || cell == "NaN"))
    return std::numeric_limits<double>::quiet_NaN();
  if (cell.starts_with('+')) cell.remove_prefix(1);
  if (const std::optional<double> value = parse_number<double>(cell)) return *value;
  return defect("column " + quoted(wanted.name) + " = " + quoted(cells_[index_[column]]) + ": expected a number");
}

Status CsvTable::read_row(std::string_view text) {
  split_row(text);
  if (format_.whole_rows && cells_.size() != header_cells_)
    return defect("the row has " + std::to_string(cells_.size()) + " columns: expected " +
                  std::to_string(header_cells_));
  for (std::size_t k = 0; k < wanted_.size(); ++k) {
    if (index_[k] == missing) continue;
    double value = TRY(number(k));
    row_[k] = value;
  }
  return {};
}

Result<NumberTable> CsvTable::read() {
  std::string_view left = text_;
  std::vector<std::string> header;
  if (left.starts_with("\xEF\xBB\xBF")) left.remove_prefix(3);
  if (left.find_first_not_of(" \t\r\n") == std::string_view::npos) {
    return input_error(file_name_ + ": empty file: expected " +
                       (format_.header_lines > 0 ? "a header and " : std::string()) + "rows of numbers");
  }
  for (int k = 0; k < format_.header_lines; ++k) {
    if (left.empty())
      return defect("the file ends inside its " + std::to_string(format_.header_lines) + " header lines");
    ++line_;
    std::string_view names = trimmed(next_line(left));
    while (names.starts_with('#') || names.starts_with('%')) names = trimmed(names.substr(1));
    split_row(names);
  }
  if (format_.header_lines > 0) header.assign(cells_.begin(), cells_.end());
  header_cells_ = header.size();
  TRY(find_columns(header));
  row_.resize(wanted_.size());
  table_.columns.resize(wanted_.size());
  for (auto& column : table_.columns) column.reserve(left.size() / 40 + 1);
  std::int64_t position = 0;
  while (!left.empty()) {
    ++line_;
    const std::string_view row = next_line(left);
    if (trimmed(row).empty() || trimmed(row).starts_with('#')) continue;
    if (Status status = read_row(row); !status) {
      if (!format_.skip_bad_rows) return status.error();
      if (table_.bad_rows++ == 0) table_.first_bad = status.error().message;
    } else {
      table_.position.push_back(position);
      table_.line.push_back(line_);
      for (std::size_t k = 0; k < row_.size(); ++k)
        if (index_[k] != missing) table_.columns[k].push_back(row_[k]);
    }
    ++position;
  }
  return std::move(table_);
}

}  // namespace

Result<NumberTable> read_number_table(std::string_view content, const std::string& file_name,
                                      const std::vector<WantedColumn>& wanted, const TableFormat& format) {
  if (is_npy(content)) return read_npy(content, file_name, wanted);
  if (is_mat(content)) return read_mat(file_name, wanted);
  return CsvTable(content, file_name, wanted, format).read();
}

}  // namespace turncal
