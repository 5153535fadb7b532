// A recording to read, whatever its form: a folder with recording.tcr, a .tcr file, or a folder in text form
// (recording.conf, imu.csv, segments.csv). Formats: docs/files.md.
//
// What is known before streaming: info and the final list of segments. read() hands the samples over in blocks, in
// counter order, from the start, as often as wanted, in memory that does not grow with the recording. A sample's fields
// are those of calib/types/recording_types.h: whole numbers for pulses; a counter gap is kept.
//
// A binary recording that was damaged or cut off is read as far as it goes: damage() says what is missing, and segments
// are cut to the samples that are left. Text has no checksums: there every defect is an error.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "calib/types/recording_types.h"
#include "calib/types/status.h"

namespace turncal {

// What a binary recording lost. All zero and complete for text.
struct RecordingDamage {
  std::uint64_t records_dropped = 0;  // records with a wrong checksum, or missing in the numbering
  std::uint64_t bytes_dropped = 0;    // of them that are still in the file
  std::uint64_t samples_dropped = 0;  // as far as the end mark tells; 0 without one
  std::uint64_t torn_tail_bytes = 0;  // after the last good record; a normal end of an interrupted capture
  bool complete = true;               // the end mark is there
  bool lost_data() const { return records_dropped != 0; }
};

class RecordingSource {
 public:
  // Returning an error stops the reading; read() then returns it.
  using Sink = std::function<Status(std::span<const ImuSample>)>;

  static Result<std::unique_ptr<RecordingSource>> open(const std::string& path);
  virtual ~RecordingSource() = default;
  RecordingSource(const RecordingSource&) = delete;
  RecordingSource& operator=(const RecordingSource&) = delete;

  const std::string& path() const { return path_; }
  const RecordingInfo& info() const { return info_; }
  const Segments& segments() const { return segments_; }
  const RecordingDamage& damage() const { return damage_; }

  // The blocks live only during the call. Blocks are not empty.
  Status read(const Sink& sink);

  // A rest that is not to be used, for as long as this object lives: its segment is rotate, its samples carry sample_flag_set_aside.
  void set_aside(const Segment& rest);

  // XXH3-128 as 32 hex digits over info, segments and samples in a fixed layout: the same for every form of the same
  // recording. Falls out of read(); makes a pass of its own when there was none.
  Result<std::string> content_hash();

 protected:
  explicit RecordingSource(std::string path) : path_(std::move(path)) {}
  virtual Status stream(const Sink& sink) = 0;

  std::string path_;
  RecordingInfo info_;
  Segments segments_;
  RecordingDamage damage_;

 private:
  Segments set_aside_;
  std::string hash_;  // empty until a read() went through
};

// The same hash of any bytes, for records of configurations and sequences.
std::string hash_of_text(std::string_view text);

// One line on what is missing, for log and report; empty when nothing is.
std::string describe(const RecordingDamage& damage);

}  // namespace turncal
