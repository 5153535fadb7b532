// A recording read once, from its beginning, into the sufficient statistics that every estimate starts from.
#pragma once

#include <cstdint>
#include <functional>

#include "calib/statistics/compression.h"
#include "calib/types/status.h"
#include "imu_io/recordings/recording_source.h"

namespace turncal {

// Blocks as short as the recording needs: those of rests found by hand where it has no table angles. `progress`, if given, is
// told the number of samples read so far. An error when the recording has no segments.
Result<CompressedRecording> compress_source(RecordingSource& source,
                                            const std::function<void(std::int64_t)>& progress = {});
// The same with blocks as asked for.
Result<CompressedRecording> compress_source(RecordingSource& source, const CompressionOptions& options,
                                            const std::function<void(std::int64_t)>& progress = {});

}  // namespace turncal
