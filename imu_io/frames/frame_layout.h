// What a frame description must be beyond what each of its keys is checked for: every place inside the frame and nobody else's, numbers that
// their fields can hold, scales with which a unit shows gravity and a turn. Pure functions.
#pragma once

#include "imu_io/base/key_value.h"
#include "imu_io/frames/frame_description.h"

namespace turncal {

// Remembers in the file what no unit's frames can be. REQUIRES: the variant is one of the frame's.
void check_layout(KeyValueFile& file, const FrameDescription& frame, const FrameVariant& variant);

}  // namespace turncal
