// Forward selection of what is common to units of a fleet (fleet_diagnosis.h, 1 and 2). Used by fleet_diagnosis.cpp only.
#pragma once

#include <vector>

#include "calib/fleet/fleet_hypotheses.h"

namespace turncal {

struct Found {
  std::size_t component = 0;
  Hypothesis hypothesis;
  Estimate estimate;
  double log10_p = 0.0;
};

struct Selected {
  Found found;
  FleetEffect effect;
};

// What was found is off the scores when this returns; d.tests is set.
std::vector<Selected> select_common(FleetScores& scores, const FleetOptions& options, bool with_shapes,
                                    FleetDiagnosis& d);
// Each of those chosen again beside the others.
void settle(FleetScores& scores, std::vector<Selected>& chosen);
// Back onto the scores.
void put_back(FleetScores& scores, const std::vector<Selected>& chosen);

}  // namespace turncal
