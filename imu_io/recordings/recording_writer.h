// Writes the binary recording of docs/files.md: append-only records, each with a checksum. A capture
// survives kill -9 and power loss up to the last sync().
//
//   begin_segment(s1) add(...) add(...) end_segment(...) sync()   begin_segment(s2) ...   finish()
//
// Samples are written in blocks of block_samples, and whenever a segment begins or ends; samples still buffered when
// the process is killed are lost. After an error the writer refuses every call: the file is valid up to
// the last whole record and can be reopened. A lock allows one writer per file. Not thread-safe.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "calib/types/axis.h"
#include "imu_io/base/files.h"
#include "imu_io/recordings/binary_layout.h"

struct XXH32_state_s;

namespace turncal {

// The usual name inside a recording's folder.
inline constexpr const char* binary_recording_name = "recording.tcr";
inline constexpr const char* partial_recording_name = "recording.partial.tcr";  // during a run
// The first bytes of the file.
inline constexpr std::string_view recording_beginning = "\x89TCR";

class RecordingWriter {
 public:
  static constexpr std::size_t block_samples = 1024;

  // Fails when the file exists or `info` is invalid.
  static Result<RecordingWriter> create(const std::string& path, const RecordingInfo& info);

  // Continues an interrupted capture and cuts off the torn tail. keep: everything else stays, and an open segment
  // stays open. drop: everything after the last ended segment is cut off too, so that an interrupted dwell
  // leaves no trace; with last_end_sample also every segment that ends after that sample. A finished recording cannot be
  // reopened.
  enum class OpenSegment { keep, drop };
  static Result<RecordingWriter> reopen(const std::string& path, OpenSegment open_segment,
                                        std::optional<std::int64_t> last_end_sample = {});

  // Checks that a capture still holds what it held when a segment ended at end_sample and hash() returned `written`. Changes nothing.
  static Status check_reopens(const std::string& path, std::int64_t end_sample, std::optional<std::uint32_t> written);

  RecordingWriter(RecordingWriter&&) noexcept;
  RecordingWriter& operator=(RecordingWriter&&) = delete;
  ~RecordingWriter();  // closes without an end mark; buffered samples are written, but not synced

  // Begins a planned segment: end_sample is ignored, and the angles are the commanded ones. It must start where the
  // segment before ended.
  Status begin_segment(const Segment& segment);
  // Ends the segment with its actual kind: a dwell to be repeated ends as rotate. end_sample is exclusive.
  Status end_segment(SegmentKind kind, std::int64_t end_sample, const AxisTriple& angles_deg);
  // Marks an ended rest as not to be used: readers take it for rotate (RecordingSource::set_aside). Its samples stay.
  Status set_aside(const Segment& rest);
  Status add(std::span<const ImuSample> samples);  // counters must increase
  Status sync();                                   // everything handed over so far is on disk
  // Checks that the segments lie within the samples, writes the end mark, syncs and closes.
  Status finish();

  const RecordingInfo& info() const { return held_.info; }
  const Segments& segments() const { return held_.segments; }  // those that have ended
  std::optional<Segment> open_segment() const { return held_.open_segment; }
  std::uint64_t sample_count() const { return held_.sample_count; }
  std::optional<std::int64_t> first_counter() const {
    return held_.sample_count > 0 ? std::optional(held_.first_counter) : std::nullopt;
  }
  std::optional<std::int64_t> last_counter() const {
    return held_.sample_count > 0 ? std::optional(held_.last_counter) : std::nullopt;
  }
  std::uint32_t hash() const;  // XXH32 of all bytes of the file, including those that reopen() found

 private:
  struct FreeHash {
    void operator()(XXH32_state_s* state) const;
  };
  RecordingWriter(PosixFile file, RecordingScan held);
  Error refusal(const std::string& what) const { return input_error(file_.path() + ": " + what); }
  Status check_usable() const;
  void hash_bytes(std::span<const std::byte> some);
  Status hash_file(std::uint64_t end);
  template <class AppendPayload>
  Status write_record(RecordType type, AppendPayload append_payload);
  Status write_segment(RecordType type, const Segment& segment);
  Status write_pending();

  // Not a CRC: every record ends with its own CRC, which makes the CRC of the whole file depend on its length only.
  std::unique_ptr<XXH32_state_s, FreeHash> written_;
  PosixFile file_;
  RecordingScan held_;     // what was handed over so far
  bool unusable_ = false;  // a write failed, or finish() has succeeded
  std::vector<ImuSample> pending_;
  std::vector<std::byte> bytes_;
};

}  // namespace turncal
