#include "imu_io/recordings/binary_layout.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstring>
#include <limits>

#include <fmt/format.h>

#include "imu_io/base/bytes.h"
#include "imu_io/recordings/recording_check.h"

namespace turncal {
namespace {

constexpr std::size_t gap_bytes = 12;
constexpr std::size_t flag_bytes = 8;

std::size_t increment_bytes(IncrementKind kind) { return kind == IncrementKind::pulses ? 4 : 8; }

// Calls `take` with a 32-bit integer for pulses, or with a double for physical increments.
template <class Take>
void with_number(IncrementKind kind, Take take) {
  kind == IncrementKind::pulses ? take(std::int32_t{}) : take(double{});
}

void append_triples(std::vector<std::byte>& out, std::span<const ImuSample> samples, IncrementKind kind,
                    std::array<double, 3> ImuSample::*field) {
  with_number(kind, [&]<class Number>(Number) {
    std::size_t place = out.size();
    out.resize(place + samples.size() * 3 * sizeof(Number));
    for (const ImuSample& sample : samples)
      for (const double x : sample.*field) {
        const auto value = static_cast<Number>(x);
        std::memcpy(out.data() + place, &value, sizeof value);
        place += sizeof value;
      }
  });
}

void decode_triples(const std::byte* from, IncrementKind kind, std::array<double, 3> ImuSample::*field,
                    std::vector<ImuSample>& out) {
  with_number(kind, [&]<class Number>(Number) {
    for (ImuSample& sample : out)
      for (double& x : sample.*field) {
        x = load_bytes<Number>(from);
        from += sizeof(Number);
      }
  });
}

// `fields` is a ByteWriter or a ByteReader.
template <class Fields, class Info>
void info_numbers(Fields&& fields, Info& info) {
  fields(info.sample_period_s, info.latitude_deg, info.gravity_mps2, info.accel_pulse_mps);
}
template <class Fields, class SegmentType>
void place_fields(Fields&& fields, SegmentType& segment) {
  fields(segment.start_sample, segment.end_sample, segment.heading_deg, segment.pitch_deg, segment.roll_deg);
}

// Builds the contiguous list of segments from begin and end records, some of which may be lost. A segment
// without its end record counts as rotate: it may have been a dwell that was repeated.
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

  // Fills the gap left by a segment whose begin and end records are both lost.
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

// Cuts the segments to the samples that are left, since damage can remove samples at both ends.
Segments inside_samples(const Segments& segments, std::int64_t first_counter, std::int64_t last_counter) {
  Segments result;
  for (Segment segment : segments) {
    segment.start_sample = std::max(segment.start_sample, first_counter);
    segment.end_sample = std::min(segment.end_sample, last_counter + 1);
    if (segment.start_sample < segment.end_sample) result.push_back(segment);
  }
  return result;
}

// Pulses are always finite. Zero times a number is finite exactly when the number is.
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
      segments.back().kind = SegmentKind::rotate;  // no record confirms it
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
    for (Record record; TRY(scanner.next(record));) {
      if (record.type != std::uint32_t(RecordType::samples)) continue;
      const auto chunk = parse_samples(record.payload, info_);
      if (!chunk || (count > 0 && chunk->first_counter <= last_counter)) continue;  // scan_recording() has counted it
      last_counter = chunk->last_counter;
      count += chunk->count;
      decode_samples(*chunk, info_, samples);
      if (!all_finite(samples, info_)) {
        return input_error("{}: samples {} to {}: expected finite numbers", path_, chunk->first_counter,
                           chunk->last_counter);
      }
      TRY(sink(samples));
    }
    if (count != sample_count_) {
      return input_error("{}: {} samples where there were {}: the file was changed while it was read", path_, count,
                         sample_count_);
    }
    return {};
  }

  PosixFile file_;
  std::uint64_t end_;
  std::uint64_t sample_count_;
};

}  // namespace

void append_info_fields(std::vector<std::byte>& out, const RecordingInfo& info) {
  info_numbers(ByteWriter{out}, info);
  for (const bool flag : {info.gyro_increment == IncrementKind::physical,
                          info.accel_increment == IncrementKind::physical, info.has_temperature, info.simulated})
    append_bytes(out, std::uint8_t(flag ? 1 : 0));
  append_text(out, info.unit_serial);
}

void append_info(std::vector<std::byte>& out, const RecordingInfo& info) {
  append_bytes(out, recording_version);
  append_info_fields(out, info);
  if (info.started_utc_s) append_bytes(out, *info.started_utc_s);
}

Result<RecordingInfo> parse_info(std::span<const std::byte> payload) {
  ByteReader reader(payload);
  const auto version = reader.get<std::uint32_t>();
  if (!reader.good()) return input_error("its first record is too short");
  if (version != recording_version) return input_error("recording format {}: expected {}", version, recording_version);
  RecordingInfo info;
  info_numbers(reader, info);
  std::array<std::uint8_t, 4> flags{};
  reader(flags[0], flags[1], flags[2], flags[3]);
  info.unit_serial = reader.get_text();
  if (reader.good() && !reader.at_end()) info.started_utc_s = reader.get<std::int64_t>();
  if (!reader.at_end() || std::ranges::any_of(flags, [](std::uint8_t flag) { return flag > 1; }))
    return input_error("its first record is not valid");
  info.gyro_increment = static_cast<IncrementKind>(flags[0]);
  info.accel_increment = static_cast<IncrementKind>(flags[1]);
  info.has_temperature = flags[2] == 1;
  info.simulated = flags[3] == 1;
  TRY(check_info(info, "its first record"));
  return info;
}

void append_segment(std::vector<std::byte>& out, const Segment& segment) {
  append_bytes(out, std::int32_t(segment.step));
  append_bytes(out, std::uint32_t(segment.kind));
  place_fields(ByteWriter{out}, segment);
}

std::optional<Segment> parse_segment(std::span<const std::byte> payload) {
  ByteReader reader(payload);
  Segment segment;
  segment.step = reader.get<std::int32_t>();
  const auto kind = reader.get<std::uint32_t>();
  place_fields(reader, segment);
  if (!reader.at_end() || kind > std::uint32_t(SegmentKind::rotate) || !has_finite_angles(segment)) return {};
  segment.kind = static_cast<SegmentKind>(kind);
  return segment;
}

const char* check_sample(const ImuSample& sample, const RecordingInfo& info) {
  constexpr std::int32_t least = INT32_MIN, most = INT32_MAX;
  const auto whole = [](double x) { return x >= least && x <= most && x == std::int32_t(x); };
  const auto good = [&](const std::array<double, 3>& v, IncrementKind kind) {
    if (kind == IncrementKind::pulses) return whole(v[0]) && whole(v[1]) && whole(v[2]);
    return std::isfinite(v[0]) && std::isfinite(v[1]) && std::isfinite(v[2]);
  };
  if (!is_counter(sample.counter)) return "counter out of range";
  if (!good(sample.gyro, info.gyro_increment))
    return info.gyro_increment == IncrementKind::pulses ? "gyro: expected whole pulses that fit into 32 bits"
                                                        : "gyro: expected finite numbers";
  if (!good(sample.accel, info.accel_increment))
    return info.accel_increment == IncrementKind::pulses ? "accel: expected whole pulses that fit into 32 bits"
                                                         : "accel: expected finite numbers";
  return std::isinf(sample.temperature_c) ? "temperature_c: expected a finite number" : nullptr;
}

void append_samples(std::vector<std::byte>& out, std::span<const ImuSample> samples, const RecordingInfo& info) {
  assert(!samples.empty());
  std::uint32_t gaps = 0;
  std::uint32_t flagged = samples[0].flags != 0 ? 1 : 0;
  for (std::size_t i = 1; i < samples.size(); ++i) {
    if (samples[i].counter != samples[i - 1].counter + 1) ++gaps;
    if (samples[i].flags != 0) ++flagged;
  }
  ByteWriter{out}(samples[0].counter, std::uint32_t(samples.size()), gaps, flagged);
  for (std::size_t i = 1; gaps > 0 && i < samples.size(); ++i) {
    if (samples[i].counter == samples[i - 1].counter + 1) continue;
    ByteWriter{out}(std::uint32_t(i), samples[i].counter);
  }
  for (std::size_t i = 0; flagged > 0 && i < samples.size(); ++i) {
    if (samples[i].flags == 0) continue;
    ByteWriter{out}(std::uint32_t(i), samples[i].flags);
  }
  append_triples(out, samples, info.gyro_increment, &ImuSample::gyro);
  append_triples(out, samples, info.accel_increment, &ImuSample::accel);
  if (!info.has_temperature) return;
  for (const ImuSample& sample : samples) append_bytes(out, sample.temperature_c);
}

std::optional<SampleChunk> parse_samples(std::span<const std::byte> payload, const RecordingInfo& info) {
  ByteReader reader(payload);
  SampleChunk chunk;
  std::uint32_t gaps = 0, flagged = 0;
  reader(chunk.first_counter, chunk.count, gaps, flagged);
  chunk.gaps = reader.get_bytes(std::uint64_t{gaps} * gap_bytes);
  chunk.flags = reader.get_bytes(std::uint64_t{flagged} * flag_bytes);
  chunk.gyro = reader.get_bytes(std::uint64_t{chunk.count} * 3 * increment_bytes(info.gyro_increment)).data();
  chunk.accel = reader.get_bytes(std::uint64_t{chunk.count} * 3 * increment_bytes(info.accel_increment)).data();
  if (info.has_temperature) chunk.temperature = reader.get_bytes(std::uint64_t{chunk.count} * 4).data();
  if (!reader.at_end() || chunk.count == 0) return {};

  // Check the gaps: indices and counters must increase, and no arithmetic may overflow.
  if (!is_counter(chunk.first_counter)) return {};
  std::uint32_t index = 0;
  std::int64_t counter = chunk.first_counter;
  for (std::size_t i = 0; i < gaps; ++i) {
    const auto next = load_bytes<std::uint32_t>(chunk.gaps.data() + i * gap_bytes);
    const auto next_counter = load_bytes<std::int64_t>(chunk.gaps.data() + i * gap_bytes + 4);
    if (next <= index || next >= chunk.count || next_counter > max_counter) return {};
    if (next_counter <= counter + (next - index)) return {};
    index = next;
    counter = next_counter;
  }
  chunk.last_counter = counter + (chunk.count - 1 - index);
  for (std::size_t i = 0; i < flagged; ++i)
    if (load_bytes<std::uint32_t>(chunk.flags.data() + i * flag_bytes) >= chunk.count) return {};
  return chunk;
}

void decode_samples(const SampleChunk& chunk, const RecordingInfo& info, std::vector<ImuSample>& out) {
  out.resize(chunk.count);
  std::int64_t counter = chunk.first_counter;
  constexpr float not_measured = std::numeric_limits<float>::quiet_NaN();
  const std::byte* temperature = chunk.temperature;
  for (ImuSample& sample : out) {
    sample.counter = counter++;
    sample.flags = 0;
    sample.temperature_c = not_measured;
    if (temperature != nullptr) {
      // All NaNs become the same one, so that the content hash does not depend on the writer.
      const auto value = load_bytes<float>(temperature);
      if (value == value) sample.temperature_c = value;
      temperature += 4;
    }
  }
  for (std::size_t place = 0; place < chunk.gaps.size(); place += gap_bytes) {
    const auto index = load_bytes<std::uint32_t>(chunk.gaps.data() + place);
    counter = load_bytes<std::int64_t>(chunk.gaps.data() + place + 4);
    const bool is_last = place + gap_bytes == chunk.gaps.size();
    const std::uint32_t until =
        is_last ? chunk.count : load_bytes<std::uint32_t>(chunk.gaps.data() + place + gap_bytes);
    for (std::uint32_t i = index; i < until; ++i) out[i].counter = counter++;
  }
  for (std::size_t place = 0; place < chunk.flags.size(); place += flag_bytes)
    out[load_bytes<std::uint32_t>(chunk.flags.data() + place)].flags =
        load_bytes<std::uint32_t>(chunk.flags.data() + place + 4);
  decode_triples(chunk.gyro, info.gyro_increment, &ImuSample::gyro, out);
  decode_triples(chunk.accel, info.accel_increment, &ImuSample::accel, out);
}

Result<RecordingScan> scan_recording(const PosixFile& file, std::optional<std::int64_t> last_end_sample) {
  const std::uint64_t size = TRY(file.size());
  if (size == 0) return input_error(file.path() + ": empty file: expected a recording");

  RecordingScan scan;
  SegmentCollector segments(scan);
  RecordScanner scanner(file, size, recording_magic);
  bool has_info = false;
  std::optional<std::uint64_t> declared_samples;
  for (Record record; TRY(scanner.next(record));) {
    const auto type = static_cast<RecordType>(record.type);
    bool good = has_info || type == RecordType::info;
    if (type == RecordType::info) {
      const auto info = parse_info(record.payload);
      if (!info) return input_error(file.path() + ": " + info.error().message);
      if (!has_info) scan.info = *info;  // the second one is a copy
      has_info = true;
      scan.closed_end = scanner.good_end();
    } else if (good && (type == RecordType::segment_begin || type == RecordType::segment_end ||
                        type == RecordType::set_aside)) {
      const auto segment = parse_segment(record.payload);
      const bool ends = type == RecordType::segment_end;
      good = segment && (type == RecordType::set_aside || (ends ? segments.end(*segment) : segments.begin(*segment)));
      if (good && type == RecordType::set_aside) scan.set_aside.push_back(*segment);
      if (good && ends && (!last_end_sample || segment->end_sample <= *last_end_sample))
        scan.closed_end = scanner.good_end();
    } else if (good && type == RecordType::samples) {
      const auto chunk = parse_samples(record.payload, scan.info);
      good = chunk && (scan.sample_count == 0 || chunk->first_counter > scan.last_counter);
      if (good) {
        if (scan.sample_count == 0) scan.first_counter = chunk->first_counter;
        scan.last_counter = chunk->last_counter;
        scan.sample_count += chunk->count;
      }
    } else if (good && type == RecordType::end) {
      ByteReader reader(record.payload);
      const auto samples = reader.get<std::uint64_t>();
      good = reader.at_end();
      if (good) declared_samples = samples;
    } else {
      good = false;
    }
    if (!good) scanner.drop_last();
    if (declared_samples) break;  // nothing may follow the end mark
  }
  if (!has_info)
    return input_error(file.path() + ": not a recording of this program, or its first records are destroyed");
  scan.good_end = scanner.good_end();
  scan.next_number = scanner.next_number();
  scan.damage.records_dropped = scanner.records_dropped();
  scan.damage.bytes_dropped = scanner.bytes_dropped();
  scan.damage.torn_tail_bytes = scanner.tail_bytes();
  scan.damage.complete = declared_samples.has_value();
  if (declared_samples && *declared_samples > scan.sample_count)
    scan.damage.samples_dropped = *declared_samples - scan.sample_count;
  return scan;
}

Result<std::unique_ptr<RecordingSource>> open_binary_recording(const std::string& path) {
  PosixFile file = TRY(PosixFile::open_to_read(path));
  const RecordingScan scan = TRY(scan_recording(file));
  if (scan.sample_count == 0) return input_error(path + ": no samples in it");
  return std::unique_ptr<RecordingSource>(std::make_unique<BinaryRecording>(std::move(file), scan));
}

}  // namespace turncal
