// Columns of numbers from a file that is not ours: text (CSV), NumPy's .npy, MATLAB's .mat, HDF5. The form is told by the file's first bytes.
//
// Text: a header names the columns; `#` before it, and lines that begin with `#`, are what NumPy and others make of a comment. Without a
// header a column is its number, from 1. A .npy file holds one array, one or two dimensions, of any integer or floating type:
// columns by number. A .mat file (up to version 7.2; 7.3 where libmatio was built for it) holds variables: `name` is a vector,
// `name:2` the second column of a matrix (its second row where it has fewer rows than columns), `s.name:2` one in a struct. An HDF5 file
// holds datasets: `group/name`, `group/name:2`, and `name:field` of a compound. In text a line that begins with `//` is a remark, too; a last
// line without an end may be cut off inside its last number: it is left out and counted.
#pragma once

#include <cstdint>
#include <functional>
#include <initializer_list>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "calib/types/status.h"
#include "imu_io/recordings/recording_source.h"

namespace turncal {

struct TableFormat {
  char delimiter = ',';
  bool decimal_comma = false;  // 1,5 is a number, too
  int header_lines = 1;        // the last of them has the names
  bool skip_bad_rows = false;  // a row with a defect is left out and counted, and is no error
  // A row with more or fewer cells than the header has names is a defect, as is a last line without an end.
  bool whole_rows = false;
  bool only_wanted = false;  // what stands behind the last wanted cell of a row is not looked at
};

struct WantedColumn {
  std::string name;
  bool may_be_blank = false;    // an empty cell, nan or NaN is then NaN and no defect
  bool may_be_missing = false;  // no such column: it has no values then
};

// Rows of a table: a block of them, or all.
struct NumberTable {
  std::vector<std::vector<double>> columns;  // as wanted
  std::vector<std::int64_t> position;        // of each row in the file, from 0, bad rows counted
  std::vector<std::int64_t> line;            // of each row, for messages; the row's number where there are no lines
  std::int64_t bad_rows = 0;
  std::string first_bad;  // the defect of the first of them
  std::size_t rows() const { return position.size(); }
};

// The bytes of a file, or of a text in memory.
struct TableBytes {
  std::uint64_t size = 0;
  // From there on so many at least, or all that there are; until the next call.
  std::function<Result<std::string_view>(std::uint64_t from, std::uint64_t least)> at;
};
Result<TableBytes> bytes_of_file(const std::string& path);
TableBytes bytes_of_text(std::string_view text);  // it must outlive them

// Hands the rows over in blocks, in the order of the file; of CSV and .npy in memory that does not grow. Of .mat and HDF5, which are opened by
// `file_name` (it goes into messages, too), a block is the whole table.
using TableSink = std::function<Status(const NumberTable& block)>;
Status read_number_table(const TableBytes& bytes, const std::string& file_name, const std::vector<WantedColumn>& wanted,
                         const TableFormat& format, const TableSink& sink);
// All of it, of what is held in memory.
Result<NumberTable> read_number_table(std::string_view content, const std::string& file_name,
                                      const std::vector<WantedColumn>& wanted, const TableFormat& format);

// What columns a .npy, .mat or HDF5 file has, by the names under which they can be wanted; of arrays wider than 32 none.
Result<std::vector<std::string>> column_names(const TableBytes& bytes, const std::string& file_name);

// Rows of the same columns, behind the others.
void append_rows(NumberTable& table, const NumberTable& block);

// By a file's first bytes: an error where they are no text that has rows (UTF-16, lines without line feeds, MATLAB 4).
Status check_text(std::string_view head, const std::string& file_name);

// By a file's first bytes: no .npy, .mat or HDF5.
bool is_text_table(std::string_view content);

// ---- written ----
//
// .npy: one array of doubles ('<f8'), a row a sample, columns in the order given. .mat (version 5): a column vector of doubles for each
// name, a point in it as an underscore. CSV: a header of the names. The same content gives the same bytes.

struct NumberColumn {
  std::string name;
  std::vector<double> values;  // as many as in the others
};

// Whether the name ends in .npy or .mat.
bool names_matrix(std::string_view path);

// An input error for a name that ends in none of `endings` (".npy"), in small letters.
Status check_ending(std::string_view path, std::initializer_list<std::string_view> endings);

// Whole or not at all. A file that is there is replaced by one of its own kind only.
Status write_columns(const std::string& path, const std::vector<NumberColumn>& fields);

// What a sample becomes: so many numbers as there are names.
struct SampleColumns {
  std::vector<std::string> names;
  std::function<void(const ImuSample& sample, std::span<double> row)> fill;
};
// A row a sample, as CSV, .npy or .mat by the name of the file; where a sample has flags, with a column of them.
Status write_sample_columns(RecordingSource& source, SampleColumns columns, const std::string& path);

// A row a sample: sample, segment (its number from 1; 0: none), gyro_x to accel_z, and where they are, temperature_c and flags. .npy in three
// passes, in memory that does not grow; .mat in a pass for each column and two more, with a column in memory.
Status write_recording_columns(RecordingSource& source, const std::string& path);

}  // namespace turncal
