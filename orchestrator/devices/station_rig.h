// The rig that stands in for a station's table and units: in a dry run, in the twin, and where a plan is looked at for a station
// without a unit of its own.
#pragma once

#include <string>

#include "orchestrator/station/station_config.h"
#include "turntable_drivers/rig/rig_config.h"

namespace turncal {

// `file`, where it is not empty, else rig.file of the station, else the built-in one. It stands where the station does unless the
// file says another site, and samples as the station's unit does: a file that says otherwise is refused, and so are pulses that are not whole.
Result<RigConfig> rig_of(const StationConfig& station, const std::string& file = "");

}  // namespace turncal
