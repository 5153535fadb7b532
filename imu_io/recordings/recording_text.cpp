#include "imu_io/recordings/recording_text.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <span>
#include <utility>

#include <fmt/format.h>

#include "imu_io/base/clock.h"
#include "imu_io/base/data_text.h"
#include "imu_io/base/files.h"
#include "imu_io/base/key_value.h"
#include "imu_io/base/text.h"
#include "imu_io/recordings/recording_check.h"
#include "imu_io/recordings/recording_writer.h"

namespace turncal {
namespace {

constexpr std::size_t longest_row = 4096;
constexpr std::size_t samples_in_block = 1024;

// In the order of SegmentKind.
constexpr std::string_view kind_names[] = {"align", "static", "rotate"};

std::string at_line(const std::string& file, std::int64_t line) { return file + ":" + std::to_string(line); }

Error cut_off(const std::string& path, std::int64_t line) {
  return input_error(at_line(path, line) + ": the last line is cut off: expected a line end");
}

// A row of one of our tables, with its error messages. It refers to the text that it was made from.
class CsvRow {
 public:
  CsvRow(std::string_view text, const std::string& file, std::int64_t line, std::span<const std::string_view> names)
      : text_(text), file_(file), line_(line), names_(names), cells_(split(text, ',')) {}
  std::string_view operator[](std::size_t column) const { return cells_[column]; }
  std::string_view text() const { return text_; }
  std::string where() const { return at_line(file_, line_); }
  Status check_count() const {  // as many cells as names
    if (cells_.size() == names_.size()) return {};
    return input_error("{}: {}: expected {}", where(), counted(std::ssize(cells_), "column"), names_.size());
  }
  Error defect(std::size_t column, std::string_view expected) const {
    return input_error("{}: column {} = {}: expected {}", where(), names_[column], quoted(cells_[column]), expected);
  }

 private:
  std::string_view text_;
  const std::string& file_;
  std::int64_t line_;
  std::span<const std::string_view> names_;
  std::vector<std::string_view> cells_;
};

// ---- rows of imu.csv ----

constexpr std::array<std::string_view, 8> columns = {"sample",  "gyro_x",  "gyro_y",  "gyro_z",
                                                     "accel_x", "accel_y", "accel_z", "temperature_c"};
constexpr std::span<const std::string_view> columns_of(bool has_temperature) {
  return std::span(columns).first(has_temperature ? columns.size() : columns.size() - 1);
}
constexpr std::int64_t min_pulses = std::numeric_limits<std::int32_t>::min();
constexpr std::int64_t max_pulses = std::numeric_limits<std::int32_t>::max();

// Reads a number that ends at a comma or a line end.
template <class T>
bool plain_number(const char*& at, T& value) {
  // 40 bytes hold every shortest form; the parser stops earlier at the line end.
  const auto result = std::from_chars(at, at + 40, value);
  if (result.ec != std::errc{} || !std::isfinite(double(value))) return false;
  at = result.ptr;
  return true;
}

std::string imu_csv_header(bool has_temperature) {
  return fmt::format("{}", fmt::join(columns_of(has_temperature), ","));
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

// Returns the first line without the byte order mark of some editors.
std::string_view first_line(std::string_view& text, bool* had_end) {
  const std::string_view line = next_line(text, had_end);
  return line.starts_with("\xEF\xBB\xBF") ? line.substr(3) : line;
}

// Reads the rows of a small table with a header; every line must have its end. `take` gets the row.
template <class Take>
Status read_table(const std::string& path, std::string_view header, Take take) {
  const std::string content = TRY(read_whole_file(path));
  std::string_view text = content;
  if (text.empty()) return input_error(path + ": empty file: expected the header " + std::string(header));
  bool had_end = false;
  const std::string_view first = first_line(text, &had_end);
  if (first != header)
    return input_error(at_line(path, 1) + ": header " + quoted(first) + ": expected " + std::string(header));
  const std::vector<std::string_view> names = split(header, ',');
  std::vector<std::string_view> rows;
  while (had_end && !text.empty()) rows.push_back(next_line(text, &had_end));
  std::int64_t line = 1;
  if (!had_end) return cut_off(path, std::int64_t(rows.size()) + line);
  for (const std::string_view row : rows) TRY(take(CsvRow(row, path, ++line, names)));
  return {};
}

Result<Segment> parse_segment(const CsvRow& row) {
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
    const auto add_segment = [&](const CsvRow& row) -> Status {
      segments_.push_back(TRY(parse_segment(row)));
      return {};
    };
    TRY(read_table(segments_path_, segments_csv_header, add_segment));
    TRY(read_flags());
    csv_ = TRY(PosixFile::open_to_read(csv_path_));
    size_ = TRY(csv_.size());
    FileWindow window(csv_, size_);
    ImuSample first, last;
    TRY(read_header(window));
    TRY(read_ends(window, first, last));
    return check_segments(segments_, first.counter, last.counter,
                          [&](std::size_t i) { return at_line(segments_path_, std::int64_t(i) + 2); });
  }

 private:
  // No sample is flagged if the file is missing.
  Status read_flags() {
    const std::string path = path_ + "/" + flags_csv_name;
    if (!path_exists(path)) return {};
    return read_table(path, flags_csv_header, [&](const CsvRow& row) -> Status {
      const auto counter = parse_integer(row[0]);
      const auto flags = row.check_count() ? parse_integer<std::uint32_t>(row[1]) : std::nullopt;
      if (!counter || !flags || *flags == 0 || (!flagged_.empty() && *counter <= flagged_.back().counter))
        return input_error(row.where() + ": " + quoted(row.text()) +
                           ": expected sample,flags with increasing sample and flags > 0");
      flagged_.push_back({*counter, *flags});
      return {};
    });
  }

  static Result<std::string_view> text_at(FileWindow& window, std::uint64_t offset) {
    const std::span<const std::byte> bytes = TRY(window.at(offset, longest_row));
    return std::string_view(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  }

  Status read_header(FileWindow& window) {
    const std::string expected = imu_csv_header(false) + " and optionally ,temperature_c";
    if (size_ == 0) return input_error(csv_path_ + ": empty file: expected the header " + expected);
    const std::string_view start = TRY(text_at(window, 0));
    std::string_view remaining = start;
    bool had_end = false;
    const std::string_view header = first_line(remaining, &had_end);
    info_.has_temperature = header == imu_csv_header(true);
    if (!info_.has_temperature && header != imu_csv_header(false))
      return input_error(at_line(csv_path_, 1) + ": header " + quoted(header) + ": expected " + expected);
    rows_begin_ = start.size() - remaining.size();
    if (!had_end || rows_begin_ == size_) return input_error(csv_path_ + ": no samples in it");
    return {};
  }

  // Reads the first and the last row, between which the segments must lie.
  Status read_ends(FileWindow& window, ImuSample& first, ImuSample& last) const {
    const ImuCsvParser parser(csv_path_, info_);
    std::string_view piece = TRY(text_at(window, rows_begin_));
    bool had_end = false;
    std::string_view row = next_line(piece, &had_end);
    if (row.size() >= longest_row) return too_long(2);
    if (had_end) TRY(parser.parse(row, 2, first));

    const std::uint64_t tail = std::max(rows_begin_, size_ - std::min<std::uint64_t>(size_, longest_row));
    const std::string end(TRY(text_at(window, tail)));  // copied, because count_lines() may move the window
    piece = end;
    if (!piece.ends_with('\n')) return cut_off(csv_path_, TRY(count_lines(window)) + 1);
    piece.remove_suffix(1);
    const std::size_t before = piece.find_last_of('\n');
    row = before == std::string_view::npos ? piece : piece.substr(before + 1);
    if (row.ends_with('\r')) row.remove_suffix(1);
    const bool whole = before != std::string_view::npos || tail == rows_begin_;
    if (whole && parser.parse(row, 0, last).ok()) return {};
    // Lines are counted only for an error message.
    const std::int64_t lines = TRY(count_lines(window));
    return whole ? parser.parse(row, lines, last) : Status(too_long(lines));
  }

  Error too_long(std::int64_t line) const {
    return input_error("{}:{}: line longer than {} bytes", csv_path_, line, longest_row);
  }

  static Result<std::int64_t> count_lines(FileWindow& window) {
    std::int64_t lines = 0;
    for (std::uint64_t offset = 0; offset < window.end();) {
      const std::string_view text = TRY(text_at(window, offset));
      lines += std::ranges::count(text, '\n');
      offset += text.size();
    }
    return lines;
  }

  Status stream(const Sink& sink) override {
    const ImuCsvParser parser(csv_path_, info_);
    FileWindow window(csv_, size_);
    std::vector<ImuSample> block;
    block.reserve(samples_in_block);
    auto flagged = flagged_.begin();
    const auto not_there = [&] {
      return input_error("{}/{}: sample {} is not in imu.csv", path_, flags_csv_name, flagged->counter);
    };
    std::int64_t line = 1, last_counter = std::numeric_limits<std::int64_t>::min();
    for (std::uint64_t offset = rows_begin_; offset < window.end();) {
      const std::string_view text = TRY(text_at(window, offset));
      const std::size_t size = text.rfind('\n') + 1;  // whole rows
      offset += size;
      if (size == 0 && (text.size() > longest_row || offset + text.size() < window.end())) return too_long(line + 1);
      if (size == 0) return flagged != flagged_.end() ? not_there() : cut_off(csv_path_, line + 1);
      const char* const end = text.data() + size;
      for (const char* at = text.data(); at < end;) {
        ++line;
        ImuSample& sample = block.emplace_back();
        if (!parser.parse_plain(at, sample)) {
          std::string_view left(at, std::size_t(end - at));
          TRY(parser.parse(next_line(left), line, sample));
          at = left.data();
        }
        if (sample.counter <= last_counter)
          return input_error("{}:{}: column sample = '{}': expected more than {} in the line before", csv_path_, line,
                             sample.counter, last_counter);
        last_counter = sample.counter;
        if (flagged != flagged_.end() && flagged->counter <= sample.counter) {
          if (flagged->counter < sample.counter) return not_there();
          sample.flags = (flagged++)->flags;
        }
        if (block.size() == samples_in_block) {
          TRY(sink(block));
          block.clear();
        }
      }
    }
    if (flagged != flagged_.end()) return not_there();
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
  KeyValues conf("format = 1\n");
  conf.number("sample_period_s", info.sample_period_s);
  conf.number("latitude_deg", info.latitude_deg);
  conf.number("gravity_mps2", info.gravity_mps2);
  conf.text("unit_serial", info.unit_serial);
  conf.text("gyro_increment", gyro_increment_name(info.gyro_increment));
  conf.text("accel_increment", accel_increment_name(info.accel_increment));
  if (info.accel_increment == IncrementKind::pulses || info.accel_pulse_mps != 0.0)
    conf.number("accel_pulse_mps", info.accel_pulse_mps);
  if (info.started_utc_s) conf.text("started_utc", format_utc(double(*info.started_utc_s)));
  if (info.simulated) conf.flag("simulated", true);
  return conf.take();
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

bool ImuCsvParser::parse_plain(const char*& at, ImuSample& sample) const {
  const char* p = at;
  if (!plain_number(p, sample.counter)) return false;
  for (std::size_t i = 0; i < 6; ++i) {
    double& value = channel_of(sample, i);
    std::int32_t pulses = 0;
    if (*p++ != ',') return false;
    if ((i < 3 ? info_.gyro_increment : info_.accel_increment) == IncrementKind::physical) {
      if (!plain_number(p, value)) return false;
    } else {
      if (!plain_number(p, pulses)) return false;
      value = pulses;
    }
  }
  sample.temperature_c = std::numeric_limits<float>::quiet_NaN();
  if (info_.has_temperature && *p++ != ',') return false;
  const bool blank = *p == '\n' || *p == '\r';  // not measured at this sample
  if (info_.has_temperature && !blank && !plain_number(p, sample.temperature_c)) return false;
  if (*p == '\r') ++p;
  if (*p != '\n') return false;
  at = p + 1;
  return true;
}

Status ImuCsvParser::parse(std::string_view text, std::int64_t line, ImuSample& sample) const {
  const CsvRow row(text, file_name_, line, columns_of(info_.has_temperature));
  TRY(row.check_count());
  const auto counter = parse_integer(row[0]);
  if (!counter || !is_counter(*counter)) return row.defect(0, std::string(counter_words) + ", the unit's counter");
  sample.counter = *counter;
  for (std::size_t i = 1; i <= 6; ++i) {
    const bool is_gyro = i <= 3;
    const IncrementKind kind = is_gyro ? info_.gyro_increment : info_.accel_increment;
    const auto value = parse_number(row[i]);
    double& place = is_gyro ? sample.gyro[i - 1] : sample.accel[i - 4];
    if (kind == IncrementKind::physical) {
      if (!value) return row.defect(i, is_gyro ? "a number, rad" : "a number, m/s");
      place = *value;
    } else {
      const bool whole =
          value && *value == std::floor(*value) && *value >= double(min_pulses) && *value <= double(max_pulses);
      if (!whole) return row.defect(i, "a whole number of pulses within 32 bits");
      place = *value + 0.0;  // removes the sign of a zero
    }
  }
  sample.temperature_c = std::numeric_limits<float>::quiet_NaN();
  if (info_.has_temperature && !row[7].empty()) {
    const auto value = parse_number<float>(row[7]);
    if (!value) return row.defect(7, "a number in degrees Celsius, or nothing when it was not measured");
    sample.temperature_c = *value;
  }
  return {};
}

void append_imu_row(std::string& out, const ImuSample& sample, const RecordingInfo& info) {
  NumberBuffer buffer;
  out += format_number(sample.counter, buffer);
  const auto append_triple = [&](const std::array<double, 3>& value, IncrementKind kind) {
    for (const double x : value) {
      out += ',';
      out += kind == IncrementKind::pulses ? format_number(std::int32_t(x), buffer) : format_number(x, buffer);
    }
  };
  append_triple(sample.gyro, info.gyro_increment);
  append_triple(sample.accel, info.accel_increment);
  if (info.has_temperature) {
    out += ',';
    const float t = sample.temperature_c;
    if (!std::isnan(t)) {
      // Writes three decimals if they are exact, as sensors usually give; otherwise the shortest form.
      const double thousandths = std::round(double(t) * 1000.0);
      if (std::abs(thousandths) < 8e6 && float(thousandths / 1000.0) == t) {
        if (std::signbit(t)) out += '-';
        const auto magnitude = std::int64_t(std::abs(thousandths));
        out += format_number(magnitude / 1000, buffer);
        out += '.';
        out += format_number(1000 + magnitude % 1000, buffer).substr(1);
      } else {
        out += format_number(t, buffer);
      }
    }
  }
  out += '\n';
}

Result<std::unique_ptr<RecordingSource>> open_text_recording(const std::string& folder) {
  auto recording = std::make_unique<TextRecording>(folder);
  TRY(recording->load());
  return std::unique_ptr<RecordingSource>(std::move(recording));
}

std::string_view to_string(SegmentKind kind) { return kind_names[std::size_t(kind)]; }
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
  // A folder must not look complete while its files belong to two recordings.
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
