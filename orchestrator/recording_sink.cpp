#include "orchestrator/recording_sink.h"

#include "imu_io/atomic_file.h"

namespace turncal {

Status RecordingSink::start(const RecordingInfo& info) {
  Result<RecordingWriter> writer = RecordingWriter::create(folder_ + "/" + partial_recording_name, info);
  if (!writer) return writer.error();
  writer_.emplace(std::move(*writer));
  return {};
}

Status RecordingSink::finish() {
  if (Status status = writer_->finish(); !status) return status;
  writer_.reset();
  return rename_durably(folder_ + "/" + partial_recording_name, path());
}

std::string RecordingSink::path() const { return folder_ + "/" + binary_recording_name; }

}  // namespace turncal
