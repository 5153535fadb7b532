// Columns of numbers from a file that is not ours: text (CSV), NumPy's .npy, MATLAB's .mat. The form is told by the file's first bytes.
//
// Text: a header names the columns; `#` before it, and lines that begin with `#`, are what NumPy and others make of a comment. Without a
// header a column is its number, from 1. A .npy file holds one array, one or two dimensions, of any integer or floating type:
// columns by number. A .mat file (up to version 7.2; 7.3 where libmatio was built for it) holds variables: `name` is a vector,
// `name:2` the second column of a matrix (its second row where it has fewer rows than columns).
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "calib/types/status.h"

namespace turncal {

struct TableFormat {
  char delimiter = ',';
  int header_lines = 1;        // the last of them has the names
  bool skip_bad_rows = false;  // a row with a defect is left out and counted, and is no error
  bool whole_rows = false;     // a row with more or fewer cells than the header has names is a defect
};

struct WantedColumn {
  std::string name;
  bool may_be_blank = false;    // an empty cell, nan or NaN is then NaN and no defect
  bool may_be_missing = false;  // no such column: it has no values then
};

struct NumberTable {
  std::vector<std::vector<double>> columns;  // as wanted
  std::vector<std::int64_t> position;        // of each row in the file, from 0, bad rows counted
  std::vector<std::int64_t> line;            // of each row, for messages; the row's number where there are no lines
  std::int64_t bad_rows = 0;
  std::string first_bad;  // the defect of the first of them
  std::size_t rows() const { return position.size(); }
};

// `content` is the whole file; `file_name` goes into messages, and a .mat file is opened by it.
Result<NumberTable> read_number_table(std::string_view content, const std::string& file_name,
                                      const std::vector<WantedColumn>& wanted, const TableFormat& format);

// By a file's first bytes.
bool is_npy(std::string_view content);
bool is_mat(std::string_view content);

}  // namespace turncal
