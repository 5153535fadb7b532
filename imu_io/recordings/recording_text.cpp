#include "imu_io/recordings/recording_text.h"

#include <unistd.h>

#include "imu_io/base/atomic_file.h"
#include "imu_io/base/clock.h"
#include "imu_io/base/format_number.h"
#include "imu_io/base/posix_file.h"
#include "imu_io/recordings/imu_csv.h"
#include "imu_io/recordings/recording_check.h"
#include "imu_io/recordings/recording_writer.h"

namespace turncal {
namespace {

std::string conf_text(const RecordingInfo& info) {
  std::string text = "format = 1\n";
  const auto add = [&](const char* key, const std::string& value) { text += std::string(key) + " = " + value + "\n"; };
  add("sample_period_s", format_number(info.sample_period_s));
  add("latitude_deg", format_number(info.latitude_deg));
  add("gravity_mps2", format_number(info.gravity_mps2));
  add("unit_serial", info.unit_serial);
  add("gyro_increment", gyro_increment_name(info.gyro_increment));
  add("accel_increment", accel_increment_name(info.accel_increment));
  if (info.accel_increment == IncrementKind::pulses || info.accel_pulse_mps != 0.0) {
    add("accel_pulse_mps", format_number(info.accel_pulse_mps));
  }
  if (info.started_utc_s) add("started_utc", format_utc(static_cast<double>(*info.started_utc_s)));
  if (info.simulated) add("simulated", "true");
  return text;
}

std::string segments_text(const Segments& segments) {
  std::string text(segments_csv_header);
  text += '\n';
  for (const Segment& segment : segments) {
    text += format_number(segment.step);
    text += ',';
    text += to_string(segment.kind);
    for (const std::int64_t counter : {segment.start_sample, segment.end_sample}) {
      text += ',';
      text += format_number(counter);
    }
    for (const double angle : {segment.heading_deg, segment.pitch_deg, segment.roll_deg}) {
      text += ',';
      text += format_number(angle);
    }
    text += '\n';
  }
  return text;
}

// Removes the half-made file unless it was released.
class RemoveOnFailure {
 public:
  explicit RemoveOnFailure(std::string path) : path_(std::move(path)) {}
  ~RemoveOnFailure() {
    if (!path_.empty()) ::unlink(path_.c_str());
  }
  RemoveOnFailure(const RemoveOnFailure&) = delete;
  RemoveOnFailure& operator=(const RemoveOnFailure&) = delete;
  void release() { path_.clear(); }

 private:
  std::string path_;
};

Status write_binary(RecordingSource& source, const Segments& segments, const std::string& path) {
  auto writer = RecordingWriter::create(path, source.info());
  if (!writer) return writer.error();
  for (const Segment& segment : segments) {
    TRY(writer->begin_segment(segment));
    const AxisTriple angles{{segment.heading_deg, segment.pitch_deg, segment.roll_deg}};
    TRY(writer->end_segment(segment.kind, segment.end_sample, angles));
  }
  Status status = source.read([&](std::span<const ImuSample> samples) { return writer->add(samples); });
  if (!status) return status;
  return writer->finish();
}

}  // namespace

const char* to_string(SegmentKind kind) {
  switch (kind) {
    case SegmentKind::align: return "align";
    case SegmentKind::still: return "static";
    case SegmentKind::rotate: return "rotate";
  }
  return "rotate";
}

const char* gyro_increment_name(IncrementKind kind) { return kind == IncrementKind::pulses ? "pulses" : "rad"; }
const char* accel_increment_name(IncrementKind kind) { return kind == IncrementKind::pulses ? "pulses" : "mps"; }

Status export_text(RecordingSource& source, const std::string& folder) {
  TRY(make_folder(folder));
  const RecordingInfo& info = source.info();
  auto csv = AtomicFile::create(folder + "/imu.csv");
  if (!csv) return csv.error();
  std::string flags;
  std::string rows = imu_csv_header(info.has_temperature) + "\n";
  Status status = source.read([&](std::span<const ImuSample> samples) {
    for (const ImuSample& sample : samples) {
      append_imu_row(rows, sample, info);
      if (sample.flags != 0) flags += format_number(sample.counter) + "," + format_number(sample.flags) + "\n";
    }
    Status written = csv->write(rows);
    rows.clear();
    return written;
  });
  if (!status) return status;
  // A recording that is replaced must not seem whole while its parts are of two recordings.
  const std::string conf_path = folder + "/recording.conf";
  const std::string flags_path = folder + "/" + flags_csv_name;
  ::unlink(conf_path.c_str());
  if (status = csv->commit(); !status) return status;
  if (flags.empty()) {
    ::unlink(flags_path.c_str());
  } else if (status = write_file_atomically(flags_path, std::string(flags_csv_header) + "\n" + flags); !status) {
    return status;
  }
  if (status = write_file_atomically(folder + "/segments.csv", segments_text(source.segments())); !status)
    return status;
  return write_file_atomically(conf_path, conf_text(info));
}

Status import_binary(RecordingSource& source, const std::string& path) {
  return import_binary(source, source.segments(), path);
}

Status import_binary(RecordingSource& source, const Segments& segments, const std::string& path) {
  const std::string temporary = temporary_name(path);
  RemoveOnFailure cleanup(temporary);
  Status status = write_binary(source, segments, temporary);
  if (status) status = rename_durably(temporary, path);
  if (status) {
    cleanup.release();
    return {};
  }
  // The user knows the file by its own name.
  Error error = status.error();
  if (const std::size_t place = error.message.find(temporary); place != std::string::npos) {
    error.message.replace(place, temporary.size(), path);
  }
  return error;
}

}  // namespace turncal
