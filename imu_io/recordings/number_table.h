// Reads columns of numbers from foreign files: text (CSV), NumPy's .npy, MATLAB's .mat, HDF5. The first bytes of a file tell its form.
//
// Text: a header names the columns; without one a column is its number, from 1. Lines before the header may begin with `#`, and remarks with `#` or
// `//`. A last line without an end may be cut off inside its last number, so it is left out and counted. .npy: one array of one or two dimensions,
// of any integer or floating type; columns go by number. .mat (up to version 7.2; 7.3 if libmatio was built for it): `name` is a vector, `name:2`
// the second column of a matrix (its second row if it has fewer rows than columns), `s.name:2` the same in a struct. HDF5: datasets
// `group/name` and `group/name:2`, and `name:field` of a compound.
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
  bool decimal_comma = false;  // 1,5 is a number
  int header_lines = 1;        // the last one has the names
  bool skip_bad_rows = false;  // a row with a defect is left out and counted; otherwise it is an error
  // A row with more or fewer cells than the header has names is a defect, as is a last line without an end.
  bool whole_rows = false;
  bool only_wanted = false;  // cells behind the last wanted one are not read
};

struct WantedColumn {
  std::string name;
  bool may_be_blank = false;    // an empty cell, nan or NaN gives NaN and is no defect
  bool may_be_missing = false;  // a column that does not exist has no values
};

// A block of rows of a table, or all of them.
struct NumberTable {
  std::vector<std::vector<double>> columns;  // in the order wanted
  std::vector<std::int64_t> position;        // of each row among all rows of the file, from 0
  std::vector<std::int64_t> line;            // of each row, for messages; of a binary file the row's number
  std::int64_t bad_rows = 0;
  std::string first_bad;  // defect of the first bad row
  std::size_t rows() const { return position.size(); }
};

// The bytes of a file, or of a text in memory.
struct TableBytes {
  std::uint64_t size = 0;
  // Returns at least `least` bytes from `from` on, or all that are left; valid until the next call.
  std::function<Result<std::string_view>(std::uint64_t from, std::uint64_t least)> at;
};
Result<TableBytes> bytes_of_file(const std::string& path);
TableBytes bytes_of_text(std::string_view text);  // REQUIRES: the text outlives them

// Hands the rows over in blocks, in the order of the file. The memory for CSV and .npy does not grow. A .mat or HDF5 file is opened by `file_name` and
// comes as one block; messages name it, too.
using TableSink = std::function<Status(const NumberTable& block)>;
Status read_number_table(const TableBytes& bytes, const std::string& file_name, const std::vector<WantedColumn>& wanted,
                         const TableFormat& format, const TableSink& sink);
// Returns the whole table of a file that is in memory.
Result<NumberTable> read_number_table(std::string_view content, const std::string& file_name,
                                      const std::vector<WantedColumn>& wanted, const TableFormat& format);

// Returns the names under which the columns of a .npy, .mat or HDF5 file can be wanted. Arrays wider than 32 are left out.
Result<std::vector<std::string>> column_names(const TableBytes& bytes, const std::string& file_name);

// Appends rows of the same columns.
void append_rows(NumberTable& table, const NumberTable& block);

// Checks a file's first bytes. Returns an error if they are no text with rows (UTF-16, lines without line feeds, MATLAB 4).
Status check_text(std::string_view head, const std::string& file_name);

// Returns whether a file's first bytes are not those of .npy, .mat or HDF5.
bool is_text_table(std::string_view content);

// ---- written ----
//
// A .npy file is one array of doubles ('<f8') with a row for each sample and the columns in the given order. A .mat file (version 5) has a column vector
// for each name, with underscores for points. A CSV file has a header of the names. The same content gives the same bytes.

struct NumberColumn {
  std::string name;
  std::vector<double> values;  // as many in each column
};

// Returns whether the name ends in .npy or .mat.
bool names_matrix(std::string_view path);

// Returns an input error if the name ends in none of `endings` (".npy", in small letters).
Status check_ending(std::string_view path, std::initializer_list<std::string_view> endings);

// Writes the whole file or nothing. An existing file is replaced only if it is of the same kind.
Status write_columns(const std::string& path, const std::vector<NumberColumn>& fields);

// How a sample becomes a row: `fill` gives a number for each name.
struct SampleColumns {
  std::vector<std::string> names;
  std::function<void(const ImuSample& sample, std::span<double> row)> fill;
};
// Writes a row for each sample, as CSV, .npy or .mat by the name of the file. A column of flags is added if a sample has any.
Status write_sample_columns(RecordingSource& source, SampleColumns columns, const std::string& path);

// Writes a row for each sample: sample, segment (from 1; 0: none), gyro_x to accel_z, and temperature_c and flags if there are any. A .npy file takes
// three passes in memory that does not grow; a .mat file takes two passes and one for each column, which is held in memory.
Status write_recording_columns(RecordingSource& source, const std::string& path);

}  // namespace turncal
