#include "imu_io/recordings/binary_recording.h"

#include <algorithm>
#include <cmath>

#include "imu_io/recordings/binary_layout.h"

namespace turncal {
namespace {

// Damage can take away samples at both ends: segments are cut to what is left.
Segments inside_samples(const Segments& segments, std::int64_t first_counter, std::int64_t last_counter) {
  Segments result;
  for (Segment segment : segments) {
    segment.start_sample = std::max(segment.start_sample, first_counter);
    segment.end_sample = std::min(segment.end_sample, last_counter + 1);
    if (segment.start_sample < segment.end_sample) result.push_back(segment);
  }
  return result;
}

// Whole pulses are finite anyhow. Zero times a number is finite exactly when the number is.
bool all_finite(const std::vector<ImuSample>& samples, const RecordingInfo& info) {
  double sum = 0.0;
  const auto add = [&](const std::array<double, 3>& v) { sum += 0.0 * v[0] + 0.0 * v[1] + 0.0 * v[2]; };
  for (const ImuSample& sample : samples) {
    if (info.gyro_increment == IncrementKind::physical) add(sample.gyro);
    if (info.accel_increment == IncrementKind::physical) add(sample.accel);
    if (std::isinf(sample.temperature_c)) return false;
  }
  return std::isfinite(sum);
}

class BinaryRecording final : public RecordingSource {
 public:
  BinaryRecording(PosixFile file, const RecordingScan& scan)
      : RecordingSource(file.path()), file_(std::move(file)), end_(scan.good_end), sample_count_(scan.sample_count) {
    info_ = scan.info;
    damage_ = scan.damage;
    Segments segments = scan.segments;
    if (scan.open_segment) {
      segments.push_back(*scan.open_segment);
      segments.back().kind = SegmentKind::rotate;  // nobody said that it was good
      segments.back().end_sample = scan.last_counter + 1;
    }
    segments_ = inside_samples(segments, scan.first_counter, scan.last_counter);
    for (const Segment& segment : scan.set_aside) set_aside(segment);
  }

 private:
  Status stream(const Sink& sink) override {
    RecordScanner scanner(file_, end_, recording_magic);
    std::vector<ImuSample> samples;
    std::uint64_t count = 0;
    std::int64_t last_counter = 0;
    for (;;) {
      Record record;
      const auto more = scanner.next(record);
      if (!more) return more.error();
      if (!*more) break;
      if (record.type != static_cast<std::uint32_t>(RecordType::samples)) continue;
      const auto chunk = parse_samples(record.payload, info_);
      if (!chunk || (count > 0 && chunk->first_counter <= last_counter)) continue;  // counted when it was opened
      last_counter = chunk->last_counter;
      count += chunk->count;
      decode_samples(*chunk, info_, samples);
      if (!all_finite(samples, info_)) {
        return input_error(path_ + ": samples " + std::to_string(chunk->first_counter) + " to " +
                           std::to_string(chunk->last_counter) + ": expected finite numbers");
      }
      TRY(sink(samples));
    }
    if (count != sample_count_) {
      return input_error(path_ + ": " + std::to_string(count) + " samples where there were " +
                         std::to_string(sample_count_) + ": the file was changed while it was read");
    }
    return {};
  }

  PosixFile file_;
  std::uint64_t end_;
  std::uint64_t sample_count_;
};

}  // namespace

Result<std::unique_ptr<RecordingSource>> open_binary_recording(const std::string& path) {
  auto file = PosixFile::open_to_read(path);
  if (!file) return file.error();
  const auto scan = scan_recording(*file);
  if (!scan) return scan.error();
  if (scan->sample_count == 0) return input_error(path + ": no samples in it");
  return std::unique_ptr<RecordingSource>(std::make_unique<BinaryRecording>(std::move(*file), *scan));
}

}  // namespace turncal
