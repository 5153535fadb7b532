// The fleet on one page (HTML): what is common, stations side by side, units as points over time, what to do next.
#pragma once

#include <string>
#include <vector>

#include "calib/fleet/fleet_diagnosis.h"
#include "orchestrator/figures/gnuplot.h"
#include "orchestrator/fleet/fleet_members.h"

namespace turncal {

std::string fleet_page(const FleetDiagnosis& diagnosis, const FleetSource& source,
                       const std::vector<std::string>& factors, const GnuplotOptions& gnuplot = {});

}  // namespace turncal
