#include "imu_io/recordings/recording_writer.h"

#include <xxhash.h>

#include <algorithm>
#include <utility>

#include <fmt/format.h>

#include "imu_io/base/bytes.h"
#include "imu_io/recordings/recording_check.h"

namespace turncal {

RecordingWriter::RecordingWriter(PosixFile file, RecordingScan held)
    : written_(XXH32_createState()), file_(std::move(file)), held_(std::move(held)) {
  XXH32_reset(written_.get(), 0);
  pending_.reserve(block_samples);
}
RecordingWriter::RecordingWriter(RecordingWriter&&) noexcept = default;

RecordingWriter::~RecordingWriter() {
  if (!file_.is_open() || unusable_) return;
  // Best effort: a caller who needs certainty calls sync() or finish().
  static_cast<void>(write_pending().ok());
}

void RecordingWriter::FreeHash::operator()(XXH32_state_s* state) const { XXH32_freeState(state); }
std::uint32_t RecordingWriter::hash() const { return XXH32_digest(written_.get()); }
void RecordingWriter::hash_bytes(std::span<const std::byte> some) {
  XXH32_update(written_.get(), some.data(), some.size());
}

Status RecordingWriter::hash_file(std::uint64_t end) {
  FileWindow window(file_, end);
  for (std::uint64_t at = 0; at < end;) {
    const std::span<const std::byte> some = TRY(window.at(at, 1));
    if (some.empty()) return device_error(file_.path() + ": ends before its last record");
    hash_bytes(some);
    at += some.size();
  }
  return {};
}

Status RecordingWriter::check_usable() const {
  if (unusable_) return Error{ErrorKind::internal, file_.path() + ": recording is closed after an error or its end"};
  return {};
}

template <class AppendPayload>
Status RecordingWriter::write_record(RecordType type, AppendPayload append_payload) {
  bytes_.clear();
  const std::size_t begun = begin_record(bytes_, recording_magic, std::uint32_t(type), held_.next_number++);
  append_payload(bytes_);
  end_record(bytes_, begun);
  Status status = file_.write_all(bytes_);
  if (!status) unusable_ = true;
  hash_bytes(bytes_);
  return status;
}

Status RecordingWriter::write_segment(RecordType type, const Segment& segment) {
  return write_record(type, [&](std::vector<std::byte>& out) { append_segment(out, segment); });
}

Status RecordingWriter::write_pending() {
  if (pending_.empty()) return {};
  Status status = write_record(RecordType::samples,
                               [&](std::vector<std::byte>& out) { append_samples(out, pending_, held_.info); });
  pending_.clear();
  return status;
}

Result<RecordingWriter> RecordingWriter::create(const std::string& path, const RecordingInfo& info) {
  TRY(check_info(info, path));
  RecordingWriter writer(TRY(PosixFile::create_new(path)), {.info = info});
  TRY(writer.file_.lock_exclusive());
  // Written twice, because nothing else can be read without it: one damaged record must not cost the recording.
  for (int copy = 0; copy < 2; ++copy)
    TRY(writer.write_record(RecordType::info, [&](std::vector<std::byte>& out) { append_info(out, info); }));
  TRY(writer.file_.sync());
  TRY(sync_folder(folder_of(path)));
  return writer;
}

Result<RecordingWriter> RecordingWriter::reopen(const std::string& path, OpenSegment open_segment,
                                                std::optional<std::int64_t> last_end_sample) {
  PosixFile file = TRY(PosixFile::open_to_change(path));
  TRY(file.lock_exclusive());
  RecordingScan scan = TRY(scan_recording(file, last_end_sample));
  if (scan.damage.complete) return input_error(path + ": this recording is finished: nothing can be added to it");
  std::uint64_t end = scan.good_end;
  if (open_segment == OpenSegment::drop && scan.closed_end < end) {
    end = scan.closed_end;
    TRY(file.truncate(end));
    scan = TRY(scan_recording(file));
  } else {
    TRY(file.truncate(end));
  }
  TRY(file.seek(end));
  TRY(file.sync());

  RecordingWriter writer(std::move(file), std::move(scan));
  TRY(writer.hash_file(end));
  return writer;
}

Status RecordingWriter::check_reopens(const std::string& path, std::int64_t end_sample,
                                      std::optional<std::uint32_t> written) {
  PosixFile file = TRY(PosixFile::open_to_read(path));
  const RecordingScan scan = TRY(scan_recording(file, end_sample));
  const bool ends_there =
      std::ranges::any_of(scan.segments, [end_sample](const Segment& one) { return one.end_sample == end_sample; });
  RecordingWriter kept(std::move(file), {.info = scan.info});
  TRY(kept.hash_file(scan.closed_end));
  const bool damaged = scan.damage.lost_data();
  if (ends_there && (written ? kept.hash() == *written : !damaged)) return {};
  return Error{
      damaged ? ErrorKind::device : ErrorKind::input,
      fmt::format("{}: {} what this run had recorded by sample {}{}", path, ends_there ? "is not" : "does not hold",
                  end_sample, damaged ? ", the recording is damaged: " + describe(scan.damage) : "")};
}

Status RecordingWriter::begin_segment(const Segment& segment) {
  TRY(check_usable());
  if (held_.open_segment) return refusal("a segment begins before the one before has ended");
  if (!held_.segments.empty() && segment.start_sample != held_.segments.back().end_sample)
    return refusal(fmt::format("segment start_sample = '{}': expected {}, where the one before ended",
                               segment.start_sample, held_.segments.back().end_sample));
  if (!has_finite_angles(segment)) return refusal("segment with an angle that is not finite");
  TRY(write_pending());
  Segment begun = segment;
  begun.end_sample = begun.start_sample;
  TRY(write_segment(RecordType::segment_begin, begun));
  held_.open_segment = begun;
  return {};
}

Status RecordingWriter::end_segment(SegmentKind kind, std::int64_t end_sample, const AxisTriple& angles_deg) {
  TRY(check_usable());
  if (!held_.open_segment) return refusal("a segment ends that did not begin");
  const Segment segment{held_.open_segment->step,
                        kind,
                        held_.open_segment->start_sample,
                        end_sample,
                        angles_deg[Axis::heading],
                        angles_deg[Axis::pitch],
                        angles_deg[Axis::roll]};
  if (end_sample <= segment.start_sample)
    return refusal(
        fmt::format("segment end_sample = '{}': expected more than its start, {}", end_sample, segment.start_sample));
  if (!has_finite_angles(segment)) return refusal("segment with an angle that is not finite");
  TRY(write_pending());
  TRY(write_segment(RecordType::segment_end, segment));
  held_.segments.push_back(segment);
  held_.open_segment.reset();
  return {};
}

Status RecordingWriter::set_aside(const Segment& rest) {
  TRY(check_usable());
  return write_segment(RecordType::set_aside, rest);
}

Status RecordingWriter::add(std::span<const ImuSample> samples) {
  TRY(check_usable());
  for (const ImuSample& sample : samples) {
    if (held_.sample_count > 0 && sample.counter <= held_.last_counter)
      return refusal(fmt::format("sample counter = '{}': expected more than {} of the sample before", sample.counter,
                                 held_.last_counter));
    if (const char* what = check_sample(sample, held_.info); what != nullptr)
      return refusal(fmt::format("sample {}: {}", sample.counter, what));
    if (held_.sample_count == 0) held_.first_counter = sample.counter;
    held_.last_counter = sample.counter;
    ++held_.sample_count;
    pending_.push_back(sample);
    if (pending_.size() == block_samples) TRY(write_pending());
  }
  return {};
}

Status RecordingWriter::sync() {
  TRY(check_usable());
  TRY(write_pending());
  Status status = file_.sync();
  // After a failed sync the contents of the disk are unknown, even if a second sync succeeds.
  if (!status) unusable_ = true;
  return status;
}

Status RecordingWriter::finish() {
  TRY(check_usable());
  if (held_.open_segment) return refusal("recording ends inside a segment");
  if (held_.sample_count == 0) return refusal("recording without samples");
  TRY(check_segments(held_.segments, held_.first_counter, held_.last_counter,
                     [&](std::size_t i) { return fmt::format("{}: segment {}", file_.path(), i + 1); }));
  TRY(write_pending());
  TRY(write_record(RecordType::end, [&](std::vector<std::byte>& out) { append_bytes(out, held_.sample_count); }));
  TRY(sync());
  unusable_ = true;
  return file_.close();
}

}  // namespace turncal
