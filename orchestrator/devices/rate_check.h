// Does an axis say how fast it turns? While it goes its way, what its rate sums up to must be what its position says, and it must say that
// it moves: a stop is judged by both, and a register that is dead reads 0 of a table that turns. Plain arithmetic.
//
//   RateCheck check(where it stood);
//   check.add(what was read, poll after poll);
//   check.judge(axis, tolerance)
//
// Fewer than fewest_polls readings on the way (a station in fast motion) are too few to judge. A rate that is not known (NaN) counts as 0.
#pragma once

#include "calib/types/axis.h"
#include "calib/types/status.h"
#include "turntable_drivers/table/turntable.h"

namespace turncal {

class RateCheck {
 public:
  explicit RateCheck(const AxisStatus& began) : began_deg_(began.position_deg), last_(began) {}
  void add(const AxisStatus& now);
  // tolerance: of 1, of the way. The error is of the kind input: the map or dialect does not fit.
  Status judge(Axis axis, double tolerance) const;

  static constexpr int fewest_polls = 10;

 private:
  double began_deg_;
  AxisStatus last_;
  int polls_ = 0;  // with another position than before
  bool said_moving_ = false;
  double summed_deg_ = 0.0;
};

}  // namespace turncal
