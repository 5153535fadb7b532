// The moves to a step's initial position: the axes that stand elsewhere, the inner ones first.
#pragma once

#include <vector>

#include "sequences/sequence.h"

namespace turncal {

std::vector<SequenceItem> approach(const AxisTriple& from_deg, const AxisTriple& to_deg, double rate_degps,
                                   double acceleration_degps2, int line);

}  // namespace turncal
