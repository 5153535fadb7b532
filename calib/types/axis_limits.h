// What one axis of the table may do.
#pragma once

namespace turncal {

// Degrees, deg/s, deg/s^2. Positions are cumulative, as everywhere in this project.
struct AxisLimits {
  double soft_min_deg = -540.0;
  double soft_max_deg = 540.0;
  double max_rate_degps = 100.0;
  double max_acceleration_degps2 = 100.0;
  // The cable's total winding from end to end: the largest minus the smallest cumulative angle a run may use.
  // 0: slip rings, no limit.
  double wrap_deg = 720.0;
};

}  // namespace turncal
