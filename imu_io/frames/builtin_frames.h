// The frame descriptions of imu_io/frames, compiled into the program, so that it runs wherever it is copied to.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "calib/types/status.h"
#include "imu_io/frames/frame_description.h"

namespace turncal {

// "laser_gyro", "stim300", ...: the files' names without ".frame", in alphabetical order.
std::vector<std::string_view> builtin_frame_names();
// Empty when there is none of that name.
std::string_view builtin_frame_text(std::string_view name);

// A built-in name, or the path of a file where it has a '/' or ends in ".frame".
Result<FrameDescription> find_frame(const std::string& name_or_path);

}  // namespace turncal
