// Angles of devices that know a circle only.
#pragma once

#include <cmath>

namespace turncal {

// Which of angle_deg + n turns lies nearest to near_deg: how a cumulative position is kept.
inline double unwrapped_deg(double angle_deg, double near_deg, double turn_deg) {
  return angle_deg + turn_deg * std::round((near_deg - angle_deg) / turn_deg);
}

}  // namespace turncal
