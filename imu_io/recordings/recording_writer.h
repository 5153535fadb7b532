// Writes the binary recording of docs/files.md: append-only records, each with a checksum, so that a capture
// survives kill -9 and power loss up to the last sync().
//
//   begin_segment(s1) add(...) add(...) end_segment(...) sync()   begin_segment(s2) ...   finish()
//
// Samples are buffered and written block_samples at a time, and whenever a segment begins or ends; what
// is buffered when the process is killed is lost. After an error the writer refuses everything: the file is good up to
// the last whole record and can be reopened. One writer a file, enforced by a lock; not for concurrent use.
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
inline constexpr const char* partial_recording_name = "recording.partial.tcr";  // of a run, while it grows
// How the file begins.
inline constexpr std::string_view recording_beginning = "\x89TCR";

class RecordingWriter {
 public:
  static constexpr std::size_t block_samples = 1024;

  // Fails when the file exists or `info` is not a valid one.
  static Result<RecordingWriter> create(const std::string& path, const RecordingInfo& info);

  // Goes on with a capture that was interrupted. The torn tail is cut. keep: everything else stays, and a segment that
  // was open is open still. drop: what came after the last ended segment is cut off too, so that an interrupted dwell
  // leaves no trace; with last_end_sample also every segment that ends after that sample. A finished recording cannot be
  // reopened.
  enum class OpenSegment { keep, drop };
  static Result<RecordingWriter> reopen(const std::string& path, OpenSegment open_segment,
                                        std::optional<std::int64_t> last_end_sample = {});

  // Whether a capture still holds what it held when a segment ended at that sample, and hash() was `written`. Nothing is changed.
  static Status check_reopens(const std::string& path, std::int64_t end_sample, std::optional<std::uint32_t> written);

  RecordingWriter(RecordingWriter&&) noexcept;
  RecordingWriter& operator=(RecordingWriter&&) = delete;
  ~RecordingWriter();  // closes without an end mark; buffered samples are written, not synced

  // `segment` as planned: end_sample is ignored, the angles are where the table is told to go. It starts where the
  // segment before ended.
  Status begin_segment(const Segment& segment);
  // What it became: a dwell that must be repeated is closed as rotate. end_sample is exclusive.
  Status end_segment(SegmentKind kind, std::int64_t end_sample, const AxisTriple& angles_deg);
  // `rest`, ended before, is not to be used: whoever reads takes it for rotate (RecordingSource::set_aside). What it holds stays.
  Status set_aside(const Segment& rest);
  Status add(std::span<const ImuSample> samples);  // counters must increase
  Status sync();                                   // everything handed over is on disk
  // Checks that the segments lie inside the samples, writes the end mark, syncs, closes.
  Status finish();

  const RecordingInfo& info() const { return held_.info; }
  const Segments& segments() const { return held_.segments; }  // ended ones
  std::optional<Segment> open_segment() const { return held_.open_segment; }
  std::uint64_t sample_count() const { return held_.sample_count; }
  std::optional<std::int64_t> first_counter() const {
    return held_.sample_count > 0 ? std::optional(held_.first_counter) : std::nullopt;
  }
  std::optional<std::int64_t> last_counter() const {
    return held_.sample_count > 0 ? std::optional(held_.last_counter) : std::nullopt;
  }
  std::uint32_t hash() const;  // XXH32 of all bytes of the file, those that reopen() found included

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

  // Not a CRC: each record ends with its own, after which the CRC of everything depends on nothing but the length.
  std::unique_ptr<XXH32_state_s, FreeHash> written_;
  PosixFile file_;
  RecordingScan held_;     // what was handed over
  bool unusable_ = false;  // a write failed, or finish() went through
  std::vector<ImuSample> pending_;
  std::vector<std::byte> bytes_;
};

}  // namespace turncal
