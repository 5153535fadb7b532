// The binary form of a recording: the payloads of its records, the scan that reader and writer begin with, and the reader. Internal to
// imu_io (RecordingSource::open() opens recordings); the grammar is in docs/files.md.
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

// The bytes 0x89 'T' 'C' 'R': not text, and damaged by any transfer that takes it for text.
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

// Period, site, unit and increments: what the content hash covers too.
void append_info_fields(std::vector<std::byte>& out, const RecordingInfo& info);
void append_info(std::vector<std::byte>& out, const RecordingInfo& info);
Result<RecordingInfo> parse_info(std::span<const std::byte> payload);

void append_segment(std::vector<std::byte>& out, const Segment& segment);
std::optional<Segment> parse_segment(std::span<const std::byte> payload);

// REQUIRES: check_sample() passed for each; at least one sample; counters increase.
void append_samples(std::vector<std::byte>& out, std::span<const ImuSample> samples, const RecordingInfo& info);
// What is wrong with a sample, in words, or nullptr.
const char* check_sample(const ImuSample& sample, const RecordingInfo& info);

// A samples payload, checked in itself. Spans point into the payload.
struct SampleChunk {
  std::int64_t first_counter = 0;
  std::int64_t last_counter = 0;
  std::uint32_t count = 0;
  std::span<const std::byte> gaps;   // (index:u32, counter:i64) each
  std::span<const std::byte> flags;  // (index:u32, flags:u32) each
  const std::byte* gyro = nullptr;   // count rows of 3
  const std::byte* accel = nullptr;
  const std::byte* temperature = nullptr;  // count, or nullptr
};
std::optional<SampleChunk> parse_samples(std::span<const std::byte> payload, const RecordingInfo& info);
void decode_samples(const SampleChunk& chunk, const RecordingInfo& info, std::vector<ImuSample>& out);

// One pass over the file with every checksum checked.
struct RecordingScan {
  RecordingInfo info{};
  Segments segments{};                    // contiguous; lost ones stand in as rotate
  std::optional<Segment> open_segment{};  // begun, not ended
  std::vector<Segment> set_aside{};
  std::uint64_t sample_count = 0;
  std::int64_t first_counter = 0;  // when sample_count > 0
  std::int64_t last_counter = 0;
  std::uint64_t good_end = 0;    // just after the last whole record
  std::uint64_t closed_end = 0;  // just after the last segment end (not beyond last_end_sample), or the info records
  std::uint32_t next_number = 0;
  RecordingDamage damage{};
};
Result<RecordingScan> scan_recording(const PosixFile& file, std::optional<std::int64_t> last_end_sample = {});

Result<std::unique_ptr<RecordingSource>> open_binary_recording(const std::string& path);

}  // namespace turncal
