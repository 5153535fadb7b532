// Control charts as figures: every point with its sigma, control limits, limits in force, and what the run rules say.
#pragma once

#include <vector>

#include "orchestrator/line/parameter_history.h"
#include "orchestrator/report/document.h"

namespace turncal {

// A table of mean, limits and capability of each quantity, then charts in groups of one unit each, three to a row. A quantity without
// values has no row, and one that is in no group, or always the same, no chart.
void add_control_charts(const std::vector<ChartedQuantity>& quantities, Document& document);

}  // namespace turncal
