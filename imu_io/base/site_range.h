// Where on the earth's surface a unit can stand.
#pragma once

#include "imu_io/base/key_value.h"

namespace turncal {

inline constexpr NumberRange site_latitude_deg = between(-90.0, 90.0);
inline constexpr NumberRange site_gravity_mps2 = between(9.7, 9.9);
// Of a recording, whoever made it: a value outside is a slip of unit or of pen.
inline constexpr NumberRange recorded_gravity_mps2 = between(9.0, 11.0);

}  // namespace turncal
