// The text form of a recording (a folder with recording.conf, imu.csv, segments.csv), and conversion between the forms.
// Grammar: docs/files.md. Every defect is reported in one line with file, line and column or key.
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
// Written only when the unit flagged samples, so that text keeps the flags.
inline constexpr const char* flags_csv_name = "flags.csv";
inline constexpr std::string_view flags_csv_header = "sample,flags";

// Opens only the text form; RecordingSource::open() decides between the forms.
Result<std::unique_ptr<RecordingSource>> open_text_recording(const std::string& folder);

// Writes the text form into `folder`, which is created if missing. recording.conf is written last, so that a folder
// with one is complete. Reading it gives the same content hash.
Status export_text(RecordingSource& source, const std::string& folder);

// Writes the binary form of `source` to the .tcr file `path` atomically; an existing file is replaced.
Status import_binary(RecordingSource& source, const std::string& path);
// Does the same with the caller's list of segments.
Status import_binary(RecordingSource& source, const Segments& segments, const std::string& path);

std::string_view to_string(SegmentKind kind);          // align, static, rotate
const char* gyro_increment_name(IncrementKind kind);   // pulses, rad
const char* accel_increment_name(IncrementKind kind);  // pulses, mps

// Parses one row of imu.csv; declared here for the tests.
//
// The fast path reads plain whole numbers and short decimals directly from the bytes. Anything else
// (blanks, "96.0", exponents, defects) goes through the slow path, which gives the same values and the messages for
// defects.
class ImuCsvParser {
 public:
  ImuCsvParser(std::string file_name, const RecordingInfo& info) : file_name_(std::move(file_name)), info_(info) {}

  // Parses a plain row that starts at `at`, and moves `at` to the start of the next one. Returns false and leaves `at` for any
  // other row. REQUIRES: a '\n' at or after `at`. Leaves sample.flags unchanged.
  bool parse_plain(const char*& at, ImuSample& sample) const;

  // Parses a row without its line end.
  Status parse(std::string_view row, std::int64_t line, ImuSample& sample) const;

 private:
  std::string file_name_;
  RecordingInfo info_;
};

// Appends a row with its line end.
void append_imu_row(std::string& out, const ImuSample& sample, const RecordingInfo& info);

}  // namespace turncal
