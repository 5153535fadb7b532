// One row of imu.csv to one sample and back. Internal to imu_io; the grammar is in docs/recording-format.md.
//
// The fast path takes plain whole numbers and short decimals straight from the bytes; whatever it does not take
// (blanks, "96.0", exponents, defects) goes through the slow path, which gives the same values and finds the words for
// defects.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "calib/types/recording_types.h"
#include "calib/types/status.h"

namespace turncal {

std::string imu_csv_header(bool has_temperature);

// A row of one of our tables, and the words for what is wrong with it. Views of what it was made of.
class TableRow {
 public:
  TableRow(std::string_view text, const std::string& file, std::int64_t line, std::span<const std::string_view> names);
  std::string_view operator[](std::size_t column) const { return cells_[column]; }
  std::string_view text() const { return text_; }
  std::string where() const;
  Status check_count() const;  // as many cells as names
  Error defect(std::size_t column, std::string_view expected) const;

 private:
  std::string_view text_;
  const std::string& file_;
  std::int64_t line_;
  std::span<const std::string_view> names_;
  std::vector<std::string_view> cells_;
};

class ImuCsvParser {
 public:
  ImuCsvParser(std::string file_name, const RecordingInfo& info) : file_name_(std::move(file_name)), info_(info) {}

  // `at` is the start of a row; it is moved to the start of the next one. False, and `at` unmoved, when the row is not
  // a plain one. REQUIRES: a '\n' somewhere at or after `at`. Does not touch sample.flags.
  bool parse_plain(const char*& at, ImuSample& sample) const;

  // `row` without its line end.
  Status parse(std::string_view row, std::int64_t line, ImuSample& sample) const;

 private:
  std::string file_name_;
  RecordingInfo info_;
};

// Appends the row with its line end.
void append_imu_row(std::string& out, const ImuSample& sample, const RecordingInfo& info);

}  // namespace turncal
