#include "imu_io/recordings/recording_text.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include <fmt/format.h>

#include "imu_io/base/atomic_file.h"
#include "imu_io/base/clock.h"
#include "imu_io/base/format_number.h"
#include "imu_io/base/key_table.h"
#include "imu_io/base/posix_file.h"
#include "imu_io/base/text_pieces.h"
#include "imu_io/recordings/imu_csv.h"
#include "imu_io/recordings/recording_check.h"
#include "imu_io/recordings/recording_writer.h"

namespace turncal {
namespace {

constexpr std::size_t block_bytes = std::size_t{1} << 20;
constexpr std::size_t longest_row = 4096;
constexpr std::size_t slack_bytes = 64;  // the number parser may look a little beyond a line end
constexpr std::size_t samples_in_block = 1024;

// In the order of SegmentKind.
constexpr std::string_view kind_names[] = {"align", "static", "rotate"};

std::string at_line(const std::string& file, std::int64_t line) { return file + ":" + std::to_string(line); }

Error cut_off(const std::string& path, std::int64_t line) {
  return input_error(at_line(path, line) + ": the last line is cut off: expected a line end");
}

// ---- reading ----

Result<RecordingInfo> read_info(const std::string& path) {
  KeyValueFile file = TRY(KeyValueFile::read(path));
  RecordingInfo info;
  if (file.integer("format") != 1) file.reject("format", "1");
  info.sample_period_s = file.number("sample_period_s", sample_period_range);
  info.latitude_deg = file.number("latitude_deg", site_latitude_deg);
  info.gravity_mps2 = file.number("gravity_mps2", recorded_gravity_mps2);
  info.unit_serial = file.text("unit_serial");
  read_increments(file, info.gyro_increment, info.accel_increment);
  info.accel_pulse_mps = info.accel_increment == IncrementKind::pulses
                             ? file.number("accel_pulse_mps", accel_pulse_range)
                             : file.number_or("accel_pulse_mps", 0.0, not_negative);
  info.started_utc_s = started_utc(file);
  info.simulated = file.boolean_or("simulated", false);
  TRY(file.check_all_used());
  TRY(check_info(info, path));
  return info;
}

// Every line of a small table but its header, each with a line end. `take` gets the cells and the row's place.
template <class Take>
Status read_table(const std::string& path, std::string_view header, Take take) {
  const std::string content = TRY(read_whole_file(path));
  std::string_view text = content;
  if (text.empty()) return input_error(path + ": empty file: expected the header " + std::string(header));
  bool had_end = false;
  std::string_view first = next_line(text, &had_end);
  if (first.starts_with("\xEF\xBB\xBF")) first.remove_prefix(3);
  if (first != header)
    return input_error(at_line(path, 1) + ": header " + quoted(first) + ": expected " + std::string(header));
  const std::vector<std::string_view> names = split(header, ',');
  std::vector<std::string_view> rows;
  while (had_end && !text.empty()) rows.push_back(next_line(text, &had_end));
  std::int64_t line = 1;
  if (!had_end) return cut_off(path, static_cast<std::int64_t>(rows.size()) + line);
  for (const std::string_view row : rows) TRY(take(TableRow(row, path, ++line, names)));
  return {};
}

Result<Segment> parse_segment(const TableRow& row) {
  TRY(row.check_count());
  Segment segment;
  const auto step = parse_integer<int>(row[0]);
  if (!step || *step < 0) return row.defect(0, "a whole number >= 0");
  segment.step = *step;
  const auto kind = std::find(std::begin(kind_names), std::end(kind_names), row[1]);
  if (kind == std::end(kind_names)) return row.defect(1, "align, static or rotate");
  segment.kind = static_cast<SegmentKind>(kind - std::begin(kind_names));
  std::size_t column = 2;
  for (std::int64_t* const counter : {&segment.start_sample, &segment.end_sample}) {
    const auto value = parse_integer(row[column]);
    if (!value || !is_counter(*value)) return row.defect(column, counter_words);
    *counter = *value;
    ++column;
  }
  for (double* const angle : {&segment.heading_deg, &segment.pitch_deg, &segment.roll_deg}) {
    const auto value = parse_number(row[column]);
    if (!value) return row.defect(column, "a number, degrees");
    *angle = *value;
    ++column;
  }
  return segment;
}

struct FlaggedSample {
  std::int64_t counter = 0;
  std::uint32_t flags = 0;
};

class TextRecording final : public RecordingSource {
 public:
  explicit TextRecording(const std::string& folder)
      : RecordingSource(folder), csv_path_(folder + "/imu.csv"), segments_path_(folder + "/segments.csv") {}

  Status load() {
    info_ = TRY(read_info(path_ + "/recording.conf"));
    const auto add_segment = [&](const TableRow& row) -> Status {
      segments_.push_back(TRY(parse_segment(row)));
      return {};
    };
    TRY(read_table(segments_path_, segments_csv_header, add_segment));
    TRY(read_flags());
    csv_ = TRY(PosixFile::open_to_read(csv_path_));
    TRY(read_header());
    ImuSample first;
    ImuSample last;
    TRY(read_ends(first, last));
    return check_segments(segments_, first.counter, last.counter,
                          [&](std::size_t i) { return at_line(segments_path_, static_cast<std::int64_t>(i) + 2); });
  }

 private:
  // Without the file no sample is flagged.
  Status read_flags() {
    const std::string path = path_ + "/" + flags_csv_name;
    if (!path_exists(path)) return {};
    return read_table(path, flags_csv_header, [&](const TableRow& row) -> Status {
      const auto counter = parse_integer(row[0]);
      const auto flags = row.check_count() ? parse_integer<std::uint32_t>(row[1]) : std::nullopt;
      if (!counter || !flags || *flags == 0 || (!flagged_.empty() && *counter <= flagged_.back().counter))
        return input_error(row.where() + ": " + quoted(row.text()) +
                           ": expected sample,flags with increasing sample and flags > 0");
      flagged_.push_back({*counter, *flags});
      return {};
    });
  }

  Status read_header() {
    size_ = TRY(csv_.size());
    const std::string expected = imu_csv_header(false) + " and optionally ,temperature_c";
    if (size_ == 0) return input_error(csv_path_ + ": empty file: expected the header " + expected);
    const std::string start = TRY(piece_at(0));
    std::string_view remaining = start;
    bool had_end = false;
    std::string_view header = next_line(remaining, &had_end);
    if (header.starts_with("\xEF\xBB\xBF")) header.remove_prefix(3);  // byte order mark of some editors
    info_.has_temperature = header == imu_csv_header(true);
    if (!info_.has_temperature && header != imu_csv_header(false))
      return input_error(at_line(csv_path_, 1) + ": header " + quoted(header) + ": expected " + expected);
    rows_begin_ = start.size() - remaining.size();
    if (!had_end || rows_begin_ == size_) return input_error(csv_path_ + ": no samples in it");
    return {};
  }

  Result<std::string> piece_at(std::uint64_t offset) const {
    std::string text(longest_row, '\0');
    text.resize(TRY(csv_.read_at(offset, std::as_writable_bytes(std::span(text.data(), text.size())))));
    return text;
  }

  // The first and the last row: what the segments must lie in.
  Status read_ends(ImuSample& first, ImuSample& last) const {
    const ImuCsvParser parser(csv_path_, info_);
    const std::string begin = TRY(piece_at(rows_begin_));
    std::string_view piece = begin;
    bool had_end = false;
    std::string_view row = next_line(piece, &had_end);
    if (!had_end && begin.size() == longest_row) return too_long(2);
    if (had_end) TRY(parser.parse(row, 2, first));

    const std::uint64_t tail = std::max(rows_begin_, size_ - std::min<std::uint64_t>(size_, longest_row));
    const std::string end = TRY(piece_at(tail));
    piece = end;
    if (!piece.ends_with('\n')) return cut_off(csv_path_, TRY(count_lines()) + 1);
    piece.remove_suffix(1);
    const std::size_t before = piece.find_last_of('\n');
    row = before == std::string_view::npos ? piece : piece.substr(before + 1);
    if (row.ends_with('\r')) row.remove_suffix(1);
    const bool whole = before != std::string_view::npos || tail == rows_begin_;
    if (whole && parser.parse(row, 0, last).ok()) return {};
    // Only a defect is worth counting lines for.
    const std::int64_t lines = TRY(count_lines());
    return whole ? parser.parse(row, lines, last) : Status(too_long(lines));
  }

  Error too_long(std::int64_t line) const {
    return input_error(fmt::format("{}:{}: line longer than {} bytes", csv_path_, line, longest_row));
  }

  Result<std::int64_t> count_lines() const {
    std::int64_t lines = 0;
    std::vector<std::byte> buffer(block_bytes);
    std::size_t got = 0;
    for (std::uint64_t offset = 0; offset < size_; offset += got) {
      got = TRY(csv_.read_at(offset, buffer));
      if (got == 0) break;
      lines += std::count(buffer.begin(), buffer.begin() + static_cast<std::ptrdiff_t>(got), std::byte{'\n'});
    }
    return lines;
  }

  Status stream(const Sink& sink) override {
    const ImuCsvParser parser(csv_path_, info_);
    std::vector<char> buffer(block_bytes + longest_row + slack_bytes);
    std::vector<ImuSample> block;
    block.reserve(samples_in_block);
    auto flagged = flagged_.begin();
    std::size_t carried = 0;
    std::int64_t line = 1;
    bool any = false;
    std::int64_t last_counter = 0;
    for (std::uint64_t offset = rows_begin_; offset < size_;) {
      const auto wanted = static_cast<std::size_t>(std::min<std::uint64_t>(block_bytes, size_ - offset));
      const std::size_t got =
          TRY(csv_.read_at(offset, std::as_writable_bytes(std::span(buffer).subspan(carried, wanted))));
      if (got == 0) break;
      offset += got;
      const char* const end = buffer.data() + carried + got;
      const auto* last_end = static_cast<const char*>(::memrchr(buffer.data(), '\n', carried + got));
      const char* at = buffer.data();
      while (last_end != nullptr && at <= last_end) {
        ++line;
        ImuSample& sample = block.emplace_back();
        if (!parser.parse_plain(at, sample)) {
          const auto* row_end = static_cast<const char*>(std::memchr(at, '\n', static_cast<std::size_t>(end - at)));
          std::string_view row(at, static_cast<std::size_t>(row_end - at));
          if (row.ends_with('\r')) row.remove_suffix(1);
          TRY(parser.parse(row, line, sample));
          at = row_end + 1;
        }
        if (any && sample.counter <= last_counter) {
          return input_error(fmt::format("{}:{}: column sample = '{}': expected more than {} in the line before",
                                         csv_path_, line, sample.counter, last_counter));
        }
        any = true;
        last_counter = sample.counter;
        if (flagged != flagged_.end() && flagged->counter <= sample.counter) {
          if (flagged->counter < sample.counter) break;
          sample.flags = flagged->flags;
          ++flagged;
        }
        if (block.size() == samples_in_block) {
          TRY(sink(block));
          block.clear();
        }
      }
      if (flagged != flagged_.end() && any && flagged->counter < last_counter) break;
      carried = static_cast<std::size_t>(end - at);
      if (carried > longest_row) return too_long(line + 1);
      std::memmove(buffer.data(), at, carried);
    }
    if (flagged != flagged_.end()) {
      return input_error(fmt::format("{}/{}: sample {} is not in imu.csv", path_, flags_csv_name, flagged->counter));
    }
    if (carried > 0) return cut_off(csv_path_, line + 1);
    return block.empty() ? Status() : sink(block);
  }

  std::string csv_path_;
  std::string segments_path_;
  PosixFile csv_;
  std::uint64_t size_ = 0;
  std::uint64_t rows_begin_ = 0;
  std::vector<FlaggedSample> flagged_;
};

// ---- writing ----

std::string conf_text(const RecordingInfo& info) {
  std::string text = "format = 1\n";
  const auto add = [&](const char* key, const std::string& value) { text += std::string(key) + " = " + value + "\n"; };
  add("sample_period_s", format_number(info.sample_period_s));
  add("latitude_deg", format_number(info.latitude_deg));
  add("gravity_mps2", format_number(info.gravity_mps2));
  add("unit_serial", info.unit_serial);
  add("gyro_increment", gyro_increment_name(info.gyro_increment));
  add("accel_increment", accel_increment_name(info.accel_increment));
  if (info.accel_increment == IncrementKind::pulses || info.accel_pulse_mps != 0.0)
    add("accel_pulse_mps", format_number(info.accel_pulse_mps));
  if (info.started_utc_s) add("started_utc", format_utc(static_cast<double>(*info.started_utc_s)));
  if (info.simulated) add("simulated", "true");
  return text;
}

std::string segments_text(const Segments& segments) {
  std::string text = std::string(segments_csv_header) + "\n";
  for (const Segment& segment : segments) {
    text += fmt::format("{},{},{},{}", segment.step, to_string(segment.kind), segment.start_sample, segment.end_sample);
    for (const double angle : {segment.heading_deg, segment.pitch_deg, segment.roll_deg})
      text += "," + format_number(angle);
    text += '\n';
  }
  return text;
}

Status write_binary(RecordingSource& source, const Segments& segments, const std::string& path) {
  RecordingWriter writer = TRY(RecordingWriter::create(path, source.info()));
  for (const Segment& segment : segments) {
    TRY(writer.begin_segment(segment));
    const AxisTriple angles{{segment.heading_deg, segment.pitch_deg, segment.roll_deg}};
    TRY(writer.end_segment(segment.kind, segment.end_sample, angles));
  }
  TRY(source.read([&](std::span<const ImuSample> samples) { return writer.add(samples); }));
  return writer.finish();
}

}  // namespace

Result<std::unique_ptr<RecordingSource>> open_text_recording(const std::string& folder) {
  auto recording = std::make_unique<TextRecording>(folder);
  TRY(recording->load());
  return std::unique_ptr<RecordingSource>(std::move(recording));
}

std::string_view to_string(SegmentKind kind) { return kind_names[static_cast<std::size_t>(kind)]; }
const char* gyro_increment_name(IncrementKind kind) { return kind == IncrementKind::pulses ? "pulses" : "rad"; }
const char* accel_increment_name(IncrementKind kind) { return kind == IncrementKind::pulses ? "pulses" : "mps"; }

Status export_text(RecordingSource& source, const std::string& folder) {
  TRY(make_folder(folder));
  const RecordingInfo& info = source.info();
  AtomicFile csv = TRY(AtomicFile::create(folder + "/imu.csv"));
  std::string flags;
  std::string rows = imu_csv_header(info.has_temperature) + "\n";
  TRY(source.read([&](std::span<const ImuSample> samples) {
    for (const ImuSample& sample : samples) {
      append_imu_row(rows, sample, info);
      if (sample.flags != 0) flags += fmt::format("{},{}\n", sample.counter, sample.flags);
    }
    Status written = csv.write(rows);
    rows.clear();
    return written;
  }));
  // A recording that is replaced must not seem whole while its parts are of two recordings.
  const std::string conf_path = folder + "/recording.conf";
  const std::string flags_path = folder + "/" + flags_csv_name;
  ::unlink(conf_path.c_str());
  TRY(csv.commit());
  if (flags.empty())
    ::unlink(flags_path.c_str());
  else
    TRY(write_file_atomically(flags_path, std::string(flags_csv_header) + "\n" + flags));
  TRY(write_file_atomically(folder + "/segments.csv", segments_text(source.segments())));
  return write_file_atomically(conf_path, conf_text(info));
}

Status import_binary(RecordingSource& source, const std::string& path) {
  return import_binary(source, source.segments(), path);
}

Status import_binary(RecordingSource& source, const Segments& segments, const std::string& path) {
  const std::string temporary = temporary_name(path);
  Status status = write_binary(source, segments, temporary);
  if (status) status = rename_durably(temporary, path);
  if (status) return {};
  ::unlink(temporary.c_str());
  return named(status.error(), temporary, path);
}

}  // namespace turncal
