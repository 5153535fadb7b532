// Reads a recording in any form: a folder with recording.tcr, a .tcr file, or a folder in text form
// (recording.conf, imu.csv, segments.csv). Formats: docs/files.md.
//
// info() and the final list of segments are known before streaming. read() passes the samples on in blocks, in
// counter order, from the start, as often as wanted; memory does not grow with the recording. The fields of a sample
// are those of calib/types/recording_types.h: pulses are whole numbers, and counter gaps are kept.
//
// A binary recording that was damaged or cut off is read as far as possible: damage() says what is missing, and segments
// are cut to the remaining samples. In the text form, which has no checksums, every defect is an error.
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

// What is missing in a binary recording. Text is always complete, with all counts 0.
struct RecordingDamage {
  std::uint64_t records_dropped = 0;  // records with a wrong checksum, or missing from the numbering
  std::uint64_t bytes_dropped = 0;    // bytes in the file that belong to no good record
  std::uint64_t samples_dropped = 0;  // according to the end mark; 0 without one
  std::uint64_t torn_tail_bytes = 0;  // after the last good record; usual for an interrupted capture
  bool complete = true;               // the end mark is there
  bool lost_data() const { return records_dropped != 0; }
};

class RecordingSource {
 public:
  // An error from the sink ends the reading, and read() returns it.
  using Sink = std::function<Status(std::span<const ImuSample>)>;

  static Result<std::unique_ptr<RecordingSource>> open(const std::string& path);
  virtual ~RecordingSource() = default;
  RecordingSource(const RecordingSource&) = delete;
  RecordingSource& operator=(const RecordingSource&) = delete;

  const std::string& path() const { return path_; }
  const RecordingInfo& info() const { return info_; }
  const Segments& segments() const { return segments_; }
  const RecordingDamage& damage() const { return damage_; }

  // Passes blocks, never empty, to the sink. They are valid only during the call.
  Status read(const Sink& sink);
  Status read_to_use(const Sink& sink);  // the same, but an error at the end when every sample is flagged as bad

  // Excludes a rest from use while this object lives: its segment becomes rotate, and its samples get sample_flag_set_aside.
  void set_aside(const Segment& rest);

  // Returns XXH3-128 as 32 hex digits over info, segments and samples in a fixed layout: the same for every form of a
  // recording. read() computes it on the way; without a read() it makes a pass of its own.
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
  std::string hash_;  // empty until a read() is complete
};

// Returns the same kind of hash for any bytes, for records of configurations and sequences.
std::string hash_of_text(std::string_view text);

// Returns one line about what is missing, for log and report; empty if nothing is.
std::string describe(const RecordingDamage& damage);

}  // namespace turncal
