// Opens the binary form of a recording (docs/recording-format.md). Internal to imu_io: RecordingSource::open().
#pragma once

#include <memory>
#include <string>

#include "imu_io/recordings/recording_source.h"

namespace turncal {

Result<std::unique_ptr<RecordingSource>> open_binary_recording(const std::string& path);

}  // namespace turncal
