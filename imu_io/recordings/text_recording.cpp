// Reading of the text form: recording.conf, imu.csv, segments.csv and, when samples were flagged, flags.csv.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include "imu_io/base/format_number.h"
#include "imu_io/base/key_table.h"
#include "imu_io/base/key_value.h"
#include "imu_io/base/posix_file.h"
#include "imu_io/base/text_pieces.h"
#include "imu_io/recordings/imu_csv.h"
#include "imu_io/recordings/recording_check.h"
#include "imu_io/recordings/recording_text.h"

namespace turncal {
namespace {

constexpr std::size_t block_bytes = std::size_t{1} << 20;
constexpr std::size_t longest_row = 4096;
constexpr std::size_t slack_bytes = 64;  // the number parser may look a little beyond a line end
constexpr std::size_t samples_in_block = 1024;

std::string at_line(const std::string& file, std::int64_t line) { return file + ":" + std::to_string(line); }

Result<RecordingInfo> read_info(const std::string& path) {
  auto file = KeyValueFile::read(path);
  if (!file) return file.error();
  RecordingInfo info;
  if (file->integer("format") != 1) file->reject("format", "1");
  info.sample_period_s = file->number("sample_period_s", sample_period_range);
  info.latitude_deg = file->number("latitude_deg", site_latitude_deg);
  info.gravity_mps2 = file->number("gravity_mps2", recorded_gravity_mps2);
  info.unit_serial = file->text("unit_serial");
  const auto kind = [](const std::string& name) {
    return name == "pulses" ? IncrementKind::pulses : IncrementKind::physical;
  };
  info.gyro_increment = kind(file->one_of("gyro_increment", {"pulses", "rad"}));
  info.accel_increment = kind(file->one_of("accel_increment", {"pulses", "mps"}));
  if (info.accel_increment == IncrementKind::pulses) {
    info.accel_pulse_mps = file->number("accel_pulse_mps", accel_pulse_range);
  } else {
    info.accel_pulse_mps = file->number_or("accel_pulse_mps", 0.0, not_negative);
  }
  info.started_utc_s = started_utc(*file);
  info.simulated = file->boolean_or("simulated", false);
  TRY(file->check_all_used());
  TRY(check_info(info, path));
  return info;
}

// A small table held in memory: every line but the header, each with a line end.
Result<std::vector<std::string_view>> table_rows(const std::string& path, std::string_view text,
                                                 std::string_view header) {
  if (text.empty()) return input_error(path + ": empty file: expected the header " + std::string(header));
  bool had_end = false;
  std::string_view first = next_line(text, &had_end);
  if (first.starts_with("\xEF\xBB\xBF")) first.remove_prefix(3);
  if (first != header)
    return input_error(at_line(path, 1) + ": header " + quoted(first) + ": expected " + std::string(header));
  std::vector<std::string_view> rows;
  while (had_end && !text.empty()) rows.push_back(next_line(text, &had_end));
  if (!had_end) {
    return input_error(at_line(path, static_cast<std::int64_t>(rows.size()) + 1) +
                       ": the last line is cut off: expected a line end");
  }
  return rows;
}

Result<Segment> parse_segment_row(std::string_view row, const std::string& where) {
  const auto fields = split(row, ',');
  if (fields.size() != 7) {
    return input_error(where + ": " + std::to_string(fields.size()) + " columns: expected 7");
  }
  const auto defect = [&](const char* column, std::string_view value, const char* expected) {
    return input_error(where + ": column " + column + " = " + quoted(value) + ": expected " + expected);
  };
  Segment segment;
  const auto step = parse_integer<int>(fields[0]);
  if (!step || *step < 0) return defect("step", fields[0], "a whole number >= 0");
  segment.step = *step;
  if (fields[1] == "align") {
    segment.kind = SegmentKind::align;
  } else if (fields[1] == "static") {
    segment.kind = SegmentKind::still;
  } else if (fields[1] == "rotate") {
    segment.kind = SegmentKind::rotate;
  } else {
    return defect("kind", fields[1], "align, static or rotate");
  }
  const auto start = parse_integer(fields[2]);
  if (!start || !is_counter(*start)) return defect("start_sample", fields[2], counter_words);
  const auto end = parse_integer(fields[3]);
  if (!end || !is_counter(*end)) return defect("end_sample", fields[3], counter_words);
  segment.start_sample = *start;
  segment.end_sample = *end;
  const std::pair<const char*, double*> angles[] = {
      {"heading_deg", &segment.heading_deg}, {"pitch_deg", &segment.pitch_deg}, {"roll_deg", &segment.roll_deg}};
  for (std::size_t i = 0; i < 3; ++i) {
    const auto angle = parse_number(fields[4 + i]);
    if (!angle) return defect(angles[i].first, fields[4 + i], "a number, degrees");
    *angles[i].second = *angle;
  }
  return segment;
}

Result<Segments> read_segments(const std::string& path) {
  const auto text = read_whole_file(path);
  if (!text) return text.error();
  const auto rows = table_rows(path, *text, segments_csv_header);
  if (!rows) return rows.error();
  Segments segments;
  for (const std::string_view row : *rows) {
    const auto segment = parse_segment_row(row, at_line(path, static_cast<std::int64_t>(segments.size()) + 2));
    if (!segment) return segment.error();
    segments.push_back(*segment);
  }
  return segments;
}

struct FlaggedSample {
  std::int64_t counter = 0;
  std::uint32_t flags = 0;
};

// Missing file: no sample is flagged.
Result<std::vector<FlaggedSample>> read_flags(const std::string& path) {
  std::vector<FlaggedSample> flagged;
  if (!path_exists(path)) return flagged;
  const auto text = read_whole_file(path);
  if (!text) return text.error();
  const auto rows = table_rows(path, *text, flags_csv_header);
  if (!rows) return rows.error();
  for (const std::string_view row : *rows) {
    const auto fields = split(row, ',');
    const auto counter = parse_integer(fields[0]);
    const auto flags = fields.size() == 2 ? parse_integer<std::uint32_t>(fields[1]) : std::nullopt;
    if (!counter || !flags || *flags == 0 || (!flagged.empty() && *counter <= flagged.back().counter)) {
      return input_error(at_line(path, static_cast<std::int64_t>(flagged.size()) + 2) + ": " + quoted(row) +
                         ": expected sample,flags with increasing sample and flags > 0");
    }
    flagged.push_back({*counter, *flags});
  }
  return flagged;
}

class TextRecording final : public RecordingSource {
 public:
  explicit TextRecording(const std::string& folder)
      : RecordingSource(folder), csv_path_(folder + "/imu.csv"), segments_path_(folder + "/segments.csv") {}

  Status load() {
    auto info = read_info(path_ + "/recording.conf");
    if (!info) return info.error();
    info_ = *info;
    auto segments = read_segments(segments_path_);
    if (!segments) return segments.error();
    segments_ = std::move(*segments);
    auto flagged = read_flags(path_ + "/" + flags_csv_name);
    if (!flagged) return flagged.error();
    flagged_ = std::move(*flagged);
    auto file = PosixFile::open_to_read(csv_path_);
    if (!file) return file.error();
    csv_ = std::move(*file);
    TRY(read_header());
    ImuSample first;
    ImuSample last;
    TRY(read_ends(first, last));
    return check_segments(segments_, first.counter, last.counter,
                          [&](std::size_t i) { return at_line(segments_path_, static_cast<std::int64_t>(i) + 2); });
  }

 private:
  Status read_header() {
    const auto size = csv_.size();
    if (!size) return size.error();
    size_ = *size;
    const std::string expected = imu_csv_header(false) + " and optionally ,temperature_c";
    if (size_ == 0) return input_error(csv_path_ + ": empty file: expected the header " + expected);
    std::string start(longest_row, '\0');
    const auto got = csv_.read_at(0, std::as_writable_bytes(std::span(start.data(), start.size())));
    if (!got) return got.error();
    std::string_view remaining(start.data(), *got);
    bool had_end = false;
    std::string_view header = next_line(remaining, &had_end);
    if (header.starts_with("\xEF\xBB\xBF")) header.remove_prefix(3);  // byte order mark of some editors
    info_.has_temperature = header == imu_csv_header(true);
    if (!info_.has_temperature && header != imu_csv_header(false)) {
      return input_error(at_line(csv_path_, 1) + ": header " + quoted(header) + ": expected " + expected);
    }
    rows_begin_ = *got - remaining.size();
    if (!had_end || rows_begin_ == size_) return input_error(csv_path_ + ": no samples in it");
    return {};
  }

  // The first and the last row: what the segments must lie in.
  Status read_ends(ImuSample& first, ImuSample& last) const {
    const ImuCsvParser parser(csv_path_, info_);
    std::string text(longest_row, '\0');
    auto got = csv_.read_at(rows_begin_, std::as_writable_bytes(std::span(text.data(), text.size())));
    if (!got) return got.error();
    std::string_view piece(text.data(), *got);
    bool had_end = false;
    std::string_view row = next_line(piece, &had_end);
    if (!had_end && *got == longest_row) return too_long(2);
    if (had_end) {
      TRY(parser.parse(row, 2, first));
    }

    const std::uint64_t tail = std::max(rows_begin_, size_ - std::min<std::uint64_t>(size_, longest_row));
    got = csv_.read_at(tail, std::as_writable_bytes(std::span(text.data(), text.size())));
    if (!got) return got.error();
    piece = std::string_view(text.data(), *got);
    if (!piece.ends_with('\n')) {
      const auto lines = count_lines();
      return lines ? cut_off(*lines + 1) : lines.error();
    }
    piece.remove_suffix(1);
    const std::size_t before = piece.find_last_of('\n');
    row = before == std::string_view::npos ? piece : piece.substr(before + 1);
    if (row.ends_with('\r')) row.remove_suffix(1);
    const bool whole = before != std::string_view::npos || tail == rows_begin_;
    if (whole && parser.parse(row, 0, last).ok()) return {};
    // Only a defect is worth counting lines for.
    const auto lines = count_lines();
    if (!lines) return lines.error();
    return whole ? parser.parse(row, *lines, last) : Status(too_long(*lines));
  }

  Error cut_off(std::int64_t line) const {
    return input_error(at_line(csv_path_, line) + ": the last line is cut off: expected a line end");
  }

  Error too_long(std::int64_t line) const {
    return input_error(at_line(csv_path_, line) + ": line longer than " + std::to_string(longest_row) + " bytes");
  }

  Result<std::int64_t> count_lines() const {
    std::int64_t lines = 0;
    std::vector<std::byte> buffer(block_bytes);
    for (std::uint64_t offset = 0; offset < size_;) {
      const auto got = csv_.read_at(offset, buffer);
      if (!got) return got.error();
      if (*got == 0) break;
      lines += std::count(buffer.begin(), buffer.begin() + static_cast<std::ptrdiff_t>(*got), std::byte{'\n'});
      offset += *got;
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
      const auto got = csv_.read_at(offset, std::as_writable_bytes(std::span(buffer.data() + carried, wanted)));
      if (!got) return got.error();
      if (*got == 0) break;
      offset += *got;
      const char* const end = buffer.data() + carried + *got;
      const auto* last_end = static_cast<const char*>(::memrchr(buffer.data(), '\n', carried + *got));
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
          return input_error(at_line(csv_path_, line) + ": column sample = '" + std::to_string(sample.counter) +
                             "': expected more than " + std::to_string(last_counter) + " in the line before");
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
      return input_error(path_ + "/" + flags_csv_name + ": sample " + std::to_string(flagged->counter) +
                         " is not in imu.csv");
    }
    if (carried > 0) return cut_off(line + 1);
    return block.empty() ? Status() : sink(block);
  }

  std::string csv_path_;
  std::string segments_path_;
  PosixFile csv_;
  std::uint64_t size_ = 0;
  std::uint64_t rows_begin_ = 0;
  std::vector<FlaggedSample> flagged_;
};

}  // namespace

Result<std::unique_ptr<RecordingSource>> open_text_recording(const std::string& folder) {
  auto recording = std::make_unique<TextRecording>(folder);
  TRY(recording->load());
  return std::unique_ptr<RecordingSource>(std::move(recording));
}

}  // namespace turncal
