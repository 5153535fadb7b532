// Does the table turn by itself? A pure function of what was read: an axis that nothing sent has to stay where it stood, and the one that
// was sent on its way. One rule for a run and for commissioning; both stop the table at the first poll that shows it.
#pragma once

#include <algorithm>
#include <optional>
#include <string>

#include "calib/types/axis.h"
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

}  // namespace turncal
