// The scan over a binary recording that both the reader (at open) and the writer (at reopen) begin with.
#include <string>

#include "imu_io/recordings/binary_layout.h"

namespace turncal {
namespace {

// Builds the contiguous list of segments out of begin and end records, some of which may have been lost. A segment
// whose end was lost is not known to have been good (its dwell may have been repeated): it counts as rotate.
class SegmentCollector {
 public:
  explicit SegmentCollector(RecordingScan& scan) : scan_(scan) {}

  bool begin(const Segment& segment) {
    if (!may_start_at(segment.start_sample)) return false;
    close_open_at(segment.start_sample);
    scan_.open_segment = segment;
    return true;
  }

  bool end(const Segment& segment) {
    if (segment.end_sample <= segment.start_sample || !may_start_at(segment.start_sample)) return false;
    if (scan_.open_segment && scan_.open_segment->start_sample == segment.start_sample) scan_.open_segment.reset();
    close_open_at(segment.start_sample);
    scan_.segments.push_back(segment);
    return true;
  }

 private:
  bool may_start_at(std::int64_t start) const {
    return scan_.segments.empty() || start >= scan_.segments.back().end_sample;
  }

  void close_open_at(std::int64_t end) {
    if (scan_.open_segment && end > scan_.open_segment->start_sample) {
      fill_up_to(scan_.open_segment->start_sample);
      scan_.segments.push_back(*scan_.open_segment);
      scan_.segments.back().kind = SegmentKind::rotate;
      scan_.segments.back().end_sample = end;
    }
    scan_.open_segment.reset();
    fill_up_to(end);
  }

  // Where begin and end of a segment were both lost.
  void fill_up_to(std::int64_t start) {
    if (scan_.segments.empty() || scan_.segments.back().end_sample == start) return;
    Segment lost = scan_.segments.back();
    lost.kind = SegmentKind::rotate;
    lost.start_sample = lost.end_sample;
    lost.end_sample = start;
    scan_.segments.push_back(lost);
  }

  RecordingScan& scan_;
};

}  // namespace

Result<RecordingScan> scan_recording(const PosixFile& file, std::optional<std::int64_t> last_end_sample) {
  const auto size = file.size();
  if (!size) return size.error();
  if (*size == 0) return input_error(file.path() + ": empty file: expected a recording");

  RecordingScan scan;
  SegmentCollector segments(scan);
  RecordScanner scanner(file, *size, recording_magic);
  bool has_info = false;
  std::optional<std::uint64_t> declared_samples;
  for (;;) {
    Record record;
    const auto more = scanner.next(record);
    if (!more) return more.error();
    if (!*more) break;
    const auto type = static_cast<RecordType>(record.type);
    bool good = has_info || type == RecordType::info;
    if (type == RecordType::info) {
      const auto info = parse_info(record.payload);
      if (!info) return input_error(file.path() + ": " + info.error().message);
      if (!has_info) scan.info = *info;  // the second one is a spare
      has_info = true;
      scan.closed_end = scanner.good_end();
    } else if (good && type == RecordType::segment_begin) {
      const auto segment = parse_segment(record.payload);
      good = segment && segments.begin(*segment);
    } else if (good && type == RecordType::segment_end) {
      const auto segment = parse_segment(record.payload);
      good = segment && segments.end(*segment);
      if (good && (!last_end_sample || segment->end_sample <= *last_end_sample)) scan.closed_end = scanner.good_end();
    } else if (good && type == RecordType::set_aside) {
      const auto segment = parse_segment(record.payload);
      good = segment.has_value();
      if (good) scan.set_aside.push_back(*segment);
    } else if (good && type == RecordType::samples) {
      const auto chunk = parse_samples(record.payload, scan.info);
      good = chunk && (scan.sample_count == 0 || chunk->first_counter > scan.last_counter);
      if (good) {
        if (scan.sample_count == 0) scan.first_counter = chunk->first_counter;
        scan.last_counter = chunk->last_counter;
        scan.sample_count += chunk->count;
      }
    } else if (good && type == RecordType::end) {
      declared_samples = parse_end(record.payload);
      good = declared_samples.has_value();
    } else {
      good = false;
    }
    if (!good) scanner.drop_last();
    if (declared_samples) break;  // nothing belongs after the end mark
  }
  if (!has_info) {
    return input_error(file.path() + ": not a recording of this program, or its first records are destroyed");
  }
  scan.good_end = scanner.good_end();
  scan.next_number = scanner.next_number();
  scan.damage.records_dropped = scanner.records_dropped();
  scan.damage.bytes_dropped = scanner.bytes_dropped();
  scan.damage.torn_tail_bytes = scanner.tail_bytes();
  scan.damage.complete = declared_samples.has_value();
  if (declared_samples && *declared_samples > scan.sample_count) {
    scan.damage.samples_dropped = *declared_samples - scan.sample_count;
  }
  return scan;
}

}  // namespace turncal
