// The text form of a recording (a folder with recording.conf, imu.csv, segments.csv), and conversion between the forms.
// docs/files.md has the grammar. Every defect is one line naming file, line and column or key.
#pragma once

#include <memory>
#include <string>
#include <string_view>

#include "calib/types/recording_types.h"
#include "calib/types/status.h"
#include "imu_io/recordings/recording_source.h"

namespace turncal {

inline constexpr std::string_view segments_csv_header =
    "step,kind,start_sample,end_sample,heading_deg,pitch_deg,roll_deg";
// Written only when the unit flagged samples; without it a flag would be lost on the way through text.
inline constexpr const char* flags_csv_name = "flags.csv";
inline constexpr std::string_view flags_csv_header = "sample,flags";

// Opens the text form only; RecordingSource::open() decides between the forms.
Result<std::unique_ptr<RecordingSource>> open_text_recording(const std::string& folder);

// Writes the text form into `folder`, which is made when it is missing. recording.conf comes last, so that a folder
// with one is a whole recording. Reading it gives the same content hash.
Status export_text(RecordingSource& source, const std::string& folder);

// Writes the binary form of `source` to `path` (a .tcr file), whole or not at all; an existing file is replaced.
Status import_binary(RecordingSource& source, const std::string& path);
// The same with a segment list of the caller's.
Status import_binary(RecordingSource& source, const Segments& segments, const std::string& path);

std::string_view to_string(SegmentKind kind);          // align, static, rotate
const char* gyro_increment_name(IncrementKind kind);   // pulses, rad
const char* accel_increment_name(IncrementKind kind);  // pulses, mps

// One row of imu.csv to one sample and back; for the tests.
//
// The fast path takes plain whole numbers and short decimals straight from the bytes; whatever it does not take
// (blanks, "96.0", exponents, defects) goes through the slow path, which gives the same values and finds the words for
// defects.
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
