#include "orchestrator/records/recording_sink.h"

#include "imu_io/base/atomic_file.h"

namespace turncal {

Status RecordingSink::start(const RecordingInfo& info) {
  RecordingWriter writer = TRY(RecordingWriter::create(folder_ + "/" + partial_recording_name, info));
  writer_.emplace(std::move(writer));
  return {};
}

namespace {

bool same(const RecordingInfo& a, const RecordingInfo& b) {
  return a.sample_period_s == b.sample_period_s && a.latitude_deg == b.latitude_deg &&
         a.gravity_mps2 == b.gravity_mps2 && a.unit_serial == b.unit_serial && a.gyro_increment == b.gyro_increment &&
         a.accel_increment == b.accel_increment && a.accel_pulse_mps == b.accel_pulse_mps &&
         a.has_temperature == b.has_temperature && a.simulated == b.simulated;
}

}  // namespace

Status RecordingSink::resume(const RecordingInfo& info, std::int64_t end_sample, std::optional<std::uint32_t> written) {
  const std::string path = folder_ + "/" + partial_recording_name;
  TRY(RecordingWriter::check_reopens(path, end_sample, written));
  RecordingWriter writer = TRY(RecordingWriter::reopen(path, RecordingWriter::OpenSegment::drop, end_sample));
  if (!same(writer.info(), info)) {
    const bool kind = writer.info().simulated != info.simulated;
    return input_error(path +
                       (kind ? std::string(": simulated and real data cannot be one recording")
                             : ": was made with another unit, site or kind of samples than this station has now"));
  }
  writer_.emplace(std::move(writer));
  return {};
}

std::optional<std::uint32_t> RecordingSink::written() const {
  if (!writer_) return {};
  return writer_->hash();
}

Status RecordingSink::finish() {
  TRY(writer_->finish());
  writer_.reset();
  return rename_durably(folder_ + "/" + partial_recording_name, path());
}

std::string RecordingSink::path() const { return folder_ + "/" + binary_recording_name; }

}  // namespace turncal
