// The binary form of a recording: the payloads of its records, the scan with which reader and writer begin, and the reader. Internal to
// imu_io (use RecordingSource::open()); the grammar is in docs/files.md.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "calib/types/recording_types.h"
#include "calib/types/status.h"
#include "imu_io/base/files.h"
#include "imu_io/base/record_log.h"
#include "imu_io/recordings/recording_source.h"

namespace turncal {

// The bytes 0x89 'T' 'C' 'R': not text, and corrupted by any transfer in text mode.
inline constexpr std::uint32_t recording_magic = 0x52435489;
inline constexpr std::uint32_t recording_version = 1;

enum class RecordType : std::uint32_t {
  info = 1,
  segment_begin = 2,
  segment_end = 3,
  samples = 4,
  end = 5,
  set_aside = 6
};

// Appends period, site, unit and increments, which the content hash also covers.
void append_info_fields(std::vector<std::byte>& out, const RecordingInfo& info);
void append_info(std::vector<std::byte>& out, const RecordingInfo& info);
Result<RecordingInfo> parse_info(std::span<const std::byte> payload);

void append_segment(std::vector<std::byte>& out, const Segment& segment);
std::optional<Segment> parse_segment(std::span<const std::byte> payload);

// REQUIRES: check_sample() passed for each; at least one sample; counters increase.
void append_samples(std::vector<std::byte>& out, std::span<const ImuSample> samples, const RecordingInfo& info);
// Returns what is wrong with a sample, or nullptr.
const char* check_sample(const ImuSample& sample, const RecordingInfo& info);

// A valid samples payload. The spans and pointers refer to the payload.
struct SampleChunk {
  std::int64_t first_counter = 0;
  std::int64_t last_counter = 0;
  std::uint32_t count = 0;
  std::span<const std::byte> gaps;   // pairs (index:u32, counter:i64)
  std::span<const std::byte> flags;  // pairs (index:u32, flags:u32)
  const std::byte* gyro = nullptr;   // `count` rows of 3
  const std::byte* accel = nullptr;
  const std::byte* temperature = nullptr;  // `count` values, or nullptr
};
std::optional<SampleChunk> parse_samples(std::span<const std::byte> payload, const RecordingInfo& info);
void decode_samples(const SampleChunk& chunk, const RecordingInfo& info, std::vector<ImuSample>& out);

// The result of one pass over the file that checks every checksum.
struct RecordingScan {
  RecordingInfo info{};
  Segments segments{};                    // contiguous; a lost segment is filled in as rotate
  std::optional<Segment> open_segment{};  // begun, but not ended
  std::vector<Segment> set_aside{};
  std::uint64_t sample_count = 0;
  std::int64_t first_counter = 0;  // valid if sample_count > 0
  std::int64_t last_counter = 0;
  std::uint64_t good_end = 0;    // just after the last whole record
  std::uint64_t closed_end = 0;  // just after the last segment end up to last_end_sample, or after the info records
  std::uint32_t next_number = 0;
  RecordingDamage damage{};
};
Result<RecordingScan> scan_recording(const PosixFile& file, std::optional<std::int64_t> last_end_sample = {});

Result<std::unique_ptr<RecordingSource>> open_binary_recording(const std::string& path);

}  // namespace turncal
