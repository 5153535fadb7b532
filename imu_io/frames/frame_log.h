// A file of a unit's raw bytes, as some terminal or logger wrote them: decoded by a frame description into the samples of a recording.
//
// A log has no times of arrival. So the counter alone says what was lost: a jump of up to ten minutes is a gap, and how often a narrow counter
// wrapped within one cannot be told. A larger jump, or one back, is a unit that began anew: an error, since its biases may be others.
#pragma once

#include <string>
#include <vector>

#include "calib/types/recording_types.h"
#include "calib/types/status.h"
#include "imu_io/frames/frame_description.h"

namespace turncal {

struct FrameLog {
  std::vector<ImuSample> samples;
  std::string summary;  // "12000 frames, 0 bad, 3 samples lost, ..."
};

// Error: no frame of that description in it.
Result<FrameLog> read_frame_log(const std::string& path, const FrameDescription& frame);

}  // namespace turncal
