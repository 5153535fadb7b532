// Angles as the operator of a table turned by hand reads them.
#pragma once

#include <cmath>
#include <cstdio>
#include <string>

#include "imu_io/base/format_number.h"

namespace turncal {

// To four digits.
inline std::string shown(double angle_deg) {
  char text[40];
  std::snprintf(text, sizeof text, "%.4g", std::abs(angle_deg) < 1e-9 ? 0.0 : angle_deg);
  return text;
}

inline std::string exact(double angle_deg) { return format_number(angle_deg); }

}  // namespace turncal
