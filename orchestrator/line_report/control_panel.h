// Control charts as figures: every point with its sigma, control limits, limits in force, and what the run rules say.
#pragma once

#include <string>
#include <vector>

#include "orchestrator/figures/report_figure.h"
#include "orchestrator/line/parameter_history.h"

namespace turncal {

// In groups of one unit each, three charts to a row; a quantity without values, or that is in no group, is left out.
std::vector<Figure> control_figures(const std::vector<ChartedQuantity>& quantities);

// Mean, limits and capability of each; bold where a point is outside the control limits, or Cpk below 1.
std::string control_table(const std::vector<ChartedQuantity>& quantities);

}  // namespace turncal
