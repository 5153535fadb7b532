// Does the table turn by itself? A pure function of what was read: an axis that nothing sent has to stay where it stood, and the one that
// was sent on its way. One rule for a run and for commissioning; both stop the table at the first poll that shows it.
#pragma once

#include <algorithm>
#include <array>
#include <optional>
#include <string>

#include "calib/types/axis.h"
#include "sequences/plan.h"
#include "sequences/sequence.h"
#include "turntable_drivers/table/turntable.h"

namespace turncal {

// Further than any overshoot of a move, and than an axis slips that somebody knocks against: beyond it nothing is put right by a move.
inline double least_runaway_deg(double position_tolerance_deg) { return std::max(1.0, position_tolerance_deg); }

// What is said of it; nothing: all is well. held_deg: where the axes stood when the move, if there is one, was sent. standing_deg: how far
// from there an axis may read that was not sent.
std::optional<std::string> stray_axis(const TableStatus& axes, const AxisTriple& held_deg,
                                      const std::optional<Move>& move, double standing_deg,
                                      double position_tolerance_deg);

// Whether the axes look for their zero. How far each turns meanwhile counts by its rate and by its angle, whichever says more: the angle may be
// set anew on the way, and a rate may not be told. A search goes there and back within its travel, and needs no more than a turn beyond it.
// A drive that was told to, and has not begun, is not waited for until the whole search should be over.
class HomingWatch {
 public:
  explicit HomingWatch(const std::array<AxisLimits, 3>& limits) : limits_(limits) {}
  // What is said of an axis that has turned further, or does not begin; nothing: all is well.
  std::optional<std::string> add(const TableStatus& axes);

 private:
  std::array<AxisLimits, 3> limits_;
  AxisTriple turned_deg_{};
  double idle_s_ = 0.0;  // since any of them turned
  std::optional<TableStatus> before_;
};

}  // namespace turncal
