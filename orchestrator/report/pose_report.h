// What a recording of one pose tells (calib/rests/single_pose.h), for the terminal and for diagnosis.conf.
#pragma once

#include <string>
#include <vector>

#include "calib/rests/single_pose.h"

namespace turncal {

std::vector<std::string> pose_table(const SinglePose& pose);
// diagnosis.conf: verdict = not_tested, `noise.*` and `coefficient.<effect>.<axis>` with their sigmas.
std::string format_pose(const SinglePose& pose);

}  // namespace turncal
