// One row of imu.csv to one sample and back. Internal to imu_io; the grammar is in docs/recording-format.md.
//
// The fast path takes plain whole numbers and short decimals straight from the bytes; whatever it does not take
// (blanks, "96.0", exponents, defects) goes through the slow path, which gives the same values and finds the words for
// defects.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "calib/types/recording_types.h"
#include "calib/types/status.h"

namespace turncal {

std::string imu_csv_header(bool has_temperature);

class ImuCsvParser {
 public:
  ImuCsvParser(std::string file_name, const RecordingInfo& info) : file_name_(std::move(file_name)), info_(info) {}

  // `at` is the start of a row; it is moved to the start of the next one. False, and `at` unmoved, when the row is not
  // a plain one. REQUIRES: a '\n' somewhere at or after `at`. Does not touch sample.flags.
  bool parse_plain(const char*& at, ImuSample& sample) const;

  // `row` without its line end.
  Status parse(std::string_view row, std::int64_t line, ImuSample& sample) const;

 private:
  Error defect(std::int64_t line, std::size_t column, std::string_view value, const std::string& expected) const;

  std::string file_name_;
  RecordingInfo info_;
};

// Appends the row with its line end.
void append_imu_row(std::string& out, const ImuSample& sample, const RecordingInfo& info);

}  // namespace turncal
