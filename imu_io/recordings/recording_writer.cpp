#include "imu_io/recordings/recording_writer.h"

#include <xxhash.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "imu_io/base/atomic_file.h"
#include "imu_io/recordings/binary_layout.h"
#include "imu_io/recordings/recording_check.h"

namespace turncal {

struct RecordingWriter::State {
  struct Free {
    void operator()(XXH32_state_t* state) const { XXH32_freeState(state); }
  };
  // Of all bytes of the file. Not a CRC: each record ends with its own, after which the CRC of everything depends on nothing but the length.
  std::unique_ptr<XXH32_state_t, Free> written{XXH32_createState()};
  PosixFile file;
  RecordingInfo info;
  Segments segments;
  std::optional<Segment> open_segment;
  std::uint64_t sample_count = 0;
  std::int64_t first_counter = 0;
  std::int64_t last_counter = 0;
  std::uint32_t next_number = 0;
  std::uint64_t cut_bytes = 0;
  bool unusable = false;  // a write failed, or finish() went through
  std::vector<ImuSample> pending;
  std::vector<std::byte> bytes;

  State() { XXH32_reset(written.get(), 0); }
  void hash(std::span<const std::byte> some) { XXH32_update(written.get(), some.data(), some.size()); }
  Status hash_file(std::uint64_t end) {
    std::vector<std::byte> buffer(std::size_t{1} << 16);
    for (std::uint64_t at = 0; at < end;) {
      const auto wanted = static_cast<std::size_t>(std::min<std::uint64_t>(buffer.size(), end - at));
      const std::size_t got = TRY(file.read_at(at, std::span(buffer).first(wanted)));
      if (got == 0) return device_error(file.path() + ": ends before its last record");
      hash(std::span(buffer).first(got));
      at += got;
    }
    return {};
  }

  Error refusal(const std::string& what) const { return input_error(file.path() + ": " + what); }

  Status check_usable() const {
    if (unusable) return Error{ErrorKind::internal, file.path() + ": recording is closed after an error or its end"};
    return {};
  }

  template <class AppendPayload>
  Status write_record(RecordType type, AppendPayload append_payload) {
    bytes.clear();
    const std::size_t begun = begin_record(bytes, recording_magic, static_cast<std::uint32_t>(type), next_number++);
    append_payload(bytes);
    end_record(bytes, begun);
    Status status = file.write_all(bytes);
    if (!status) unusable = true;
    hash(bytes);
    return status;
  }

  Status write_pending() {
    if (pending.empty()) return {};
    Status status =
        write_record(RecordType::samples, [&](std::vector<std::byte>& out) { append_samples(out, pending, info); });
    pending.clear();
    return status;
  }
};

RecordingWriter::RecordingWriter(std::unique_ptr<State> state) : state_(std::move(state)) {}
RecordingWriter::RecordingWriter(RecordingWriter&&) noexcept = default;

RecordingWriter::~RecordingWriter() {
  if (!state_ || state_->unusable) return;
  // Best effort: whoever needs to know calls sync() or finish().
  const Status ignored = state_->write_pending();
  static_cast<void>(ignored);
}

Result<RecordingWriter> RecordingWriter::create(const std::string& path, const RecordingInfo& info) {
  TRY(check_info(info, path));
  auto file = PosixFile::create_new(path);
  if (!file) return file.error();
  auto state = std::make_unique<State>();
  state->file = std::move(*file);
  state->info = info;
  state->pending.reserve(block_samples);
  TRY(state->file.lock_exclusive());
  // Twice, because without it nothing else can be read: one damaged record must not cost the recording.
  for (int copy = 0; copy < 2; ++copy) {
    Status status = state->write_record(RecordType::info, [&](std::vector<std::byte>& out) { append_info(out, info); });
    if (!status) return status.error();
  }
  TRY(state->file.sync());
  TRY(sync_folder(folder_of(path)));
  return RecordingWriter(std::move(state));
}

Result<RecordingWriter> RecordingWriter::reopen(const std::string& path, OpenSegment open_segment,
                                                std::optional<std::int64_t> last_end_sample) {
  auto file = PosixFile::open_to_change(path);
  if (!file) return file.error();
  TRY(file->lock_exclusive());
  const auto size = file->size();
  if (!size) return size.error();
  auto scan = scan_recording(*file, last_end_sample);
  if (!scan) return scan.error();
  if (scan->damage.complete) return input_error(path + ": this recording is finished: nothing can be added to it");
  std::uint64_t end = scan->good_end;
  if (open_segment == OpenSegment::drop && scan->closed_end < end) {
    end = scan->closed_end;
    TRY(file->truncate(end));
    scan = scan_recording(*file);
    if (!scan) return scan.error();
  } else if (end < *size) {
    TRY(file->truncate(end));
  }
  TRY(file->seek(end));
  TRY(file->sync());

  auto state = std::make_unique<State>();
  state->file = std::move(*file);
  TRY(state->hash_file(end));
  state->info = scan->info;
  state->segments = std::move(scan->segments);
  state->open_segment = scan->open_segment;
  state->sample_count = scan->sample_count;
  state->first_counter = scan->first_counter;
  state->last_counter = scan->last_counter;
  state->next_number = scan->next_number;
  state->cut_bytes = *size - end;
  state->pending.reserve(block_samples);
  return RecordingWriter(std::move(state));
}

Status RecordingWriter::begin_segment(const Segment& segment) {
  State& s = *state_;
  TRY(s.check_usable());
  if (s.open_segment) return s.refusal("a segment begins before the one before has ended");
  if (!s.segments.empty() && segment.start_sample != s.segments.back().end_sample) {
    return s.refusal("segment start_sample = '" + std::to_string(segment.start_sample) + "': expected " +
                     std::to_string(s.segments.back().end_sample) + ", where the one before ended");
  }
  if (!std::isfinite(segment.heading_deg) || !std::isfinite(segment.pitch_deg) || !std::isfinite(segment.roll_deg)) {
    return s.refusal("segment with an angle that is not finite");
  }
  TRY(s.write_pending());
  Segment begun = segment;
  begun.end_sample = begun.start_sample;
  Status status =
      s.write_record(RecordType::segment_begin, [&](std::vector<std::byte>& out) { append_segment(out, begun); });
  if (status) s.open_segment = begun;
  return status;
}

Status RecordingWriter::end_segment(SegmentKind kind, std::int64_t end_sample, const AxisTriple& angles_deg) {
  State& s = *state_;
  TRY(s.check_usable());
  if (!s.open_segment) return s.refusal("a segment ends that did not begin");
  Segment segment = *s.open_segment;
  if (end_sample <= segment.start_sample) {
    return s.refusal("segment end_sample = '" + std::to_string(end_sample) + "': expected more than its start, " +
                     std::to_string(segment.start_sample));
  }
  segment.kind = kind;
  segment.end_sample = end_sample;
  segment.heading_deg = angles_deg[Axis::heading];
  segment.pitch_deg = angles_deg[Axis::pitch];
  segment.roll_deg = angles_deg[Axis::roll];
  if (!std::isfinite(segment.heading_deg) || !std::isfinite(segment.pitch_deg) || !std::isfinite(segment.roll_deg)) {
    return s.refusal("segment with an angle that is not finite");
  }
  TRY(s.write_pending());
  Status status =
      s.write_record(RecordType::segment_end, [&](std::vector<std::byte>& out) { append_segment(out, segment); });
  if (!status) return status;
  s.segments.push_back(segment);
  s.open_segment.reset();
  return status;
}

Status RecordingWriter::set_aside(const Segment& rest) {
  State& s = *state_;
  TRY(s.check_usable());
  return s.write_record(RecordType::set_aside, [&](std::vector<std::byte>& out) { append_segment(out, rest); });
}

Status RecordingWriter::add(std::span<const ImuSample> samples) {
  State& s = *state_;
  TRY(s.check_usable());
  for (const ImuSample& sample : samples) {
    if (s.sample_count > 0 && sample.counter <= s.last_counter) {
      return s.refusal("sample counter = '" + std::to_string(sample.counter) + "': expected more than " +
                       std::to_string(s.last_counter) + " of the sample before");
    }
    if (const char* what = check_sample(sample, s.info); what != nullptr) {
      return s.refusal("sample " + std::to_string(sample.counter) + ": " + what);
    }
    if (s.sample_count == 0) s.first_counter = sample.counter;
    s.last_counter = sample.counter;
    ++s.sample_count;
    s.pending.push_back(sample);
    if (s.pending.size() == block_samples) {
      TRY(s.write_pending());
    }
  }
  return {};
}

Status RecordingWriter::sync() {
  State& s = *state_;
  TRY(s.check_usable());
  TRY(s.write_pending());
  Status status = s.file.sync();
  // After a failed sync nobody knows what is on disk, also if a second one succeeds.
  if (!status) s.unusable = true;
  return status;
}

Status RecordingWriter::finish() {
  State& s = *state_;
  TRY(s.check_usable());
  if (s.open_segment) return s.refusal("recording ends inside a segment");
  if (s.sample_count == 0) return s.refusal("recording without samples");
  const auto where = [&](std::size_t i) { return s.file.path() + ": segment " + std::to_string(i + 1); };
  TRY(check_segments(s.segments, s.first_counter, s.last_counter, where));
  TRY(s.write_pending());
  Status status =
      s.write_record(RecordType::end, [&](std::vector<std::byte>& out) { append_end(out, s.sample_count); });
  if (!status) return status;
  if (status = sync(); !status) return status;
  s.unusable = true;
  return s.file.close();
}

Status RecordingWriter::check_kept() const { return state_->file.check_kept(); }
const RecordingInfo& RecordingWriter::info() const { return state_->info; }
const Segments& RecordingWriter::segments() const { return state_->segments; }
std::optional<Segment> RecordingWriter::open_segment() const { return state_->open_segment; }
std::uint64_t RecordingWriter::sample_count() const { return state_->sample_count; }
std::optional<std::int64_t> RecordingWriter::first_counter() const {
  if (state_->sample_count == 0) return {};
  return state_->first_counter;
}
std::optional<std::int64_t> RecordingWriter::last_counter() const {
  if (state_->sample_count == 0) return {};
  return state_->last_counter;
}
std::uint64_t RecordingWriter::cut_bytes() const { return state_->cut_bytes; }
std::uint32_t RecordingWriter::hash() const { return XXH32_digest(state_->written.get()); }

}  // namespace turncal
