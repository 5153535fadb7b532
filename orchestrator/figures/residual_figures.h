// The report's figures of the residual against what it may depend on, dwell by dwell (report_dwells.h).
#pragma once

#include <string>
#include <vector>

#include "calib/evidence/diagnosis.h"
#include "orchestrator/figures/report_dwells.h"
#include "orchestrator/figures/report_figure.h"

namespace turncal {

// Before and after an effect was added, against the quantity the effect depends on (specific force, temperature, time, time
// since the rotation, angle turned, rate, heading): one panel for each of its strongest components.
Figure effect_figure(const Diagnosis& diagnosis, const std::vector<DwellResidual>& dwells, const std::string& effect,
                     std::size_t number);
// For a residual without a name: against table angles, specific force, rate, temperature and time; once as an accelerometer
// error, once as a gyro error.
std::vector<Figure> unexplained_figures(const std::vector<DwellResidual>& dwells);

}  // namespace turncal
