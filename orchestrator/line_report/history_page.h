// The control charts of a results database as one self-contained page: every parameter over the calibrations, with mean, control
// limits, limits in force and Cpk. Plots by gnuplot; without it the page has its tables and says so.
#pragma once

#include <string>
#include <vector>

#include "orchestrator/figures/gnuplot.h"
#include "orchestrator/records/results_database.h"

namespace turncal {

// `all`: oldest first, either real or simulated. `source`: where they come from, for the page.
std::string history_page(const std::vector<StoredCalibration>& all, const std::string& source,
                         const GnuplotOptions& gnuplot = {});

}  // namespace turncal
