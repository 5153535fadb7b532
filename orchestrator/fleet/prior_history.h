// Parameter files of earlier calibrations as what was known of a fleet before (calib/fleet/fleet_prior.h).
#pragma once

#include <string>
#include <vector>

#include "calib/fleet/fleet_prior.h"
#include "imu_io/recordings/parameter_file.h"
#include "orchestrator/jobs/calibration_job.h"

namespace turncal {

struct PriorSource {
  std::string from;  // a folder, or a results database (fleet_members.h)
  std::string part;  // record.part; empty: any
};

// Every parameters.conf in it whose 21 parameters are all known, that is trusted and without effects. The same recording counts once: the newest
// version of it. Left out: `recording_hash` itself, what has a prior in it already, simulated ones beside real ones.
Result<std::vector<EarlierCalibration>> read_history(const PriorSource& source, const std::string& recording_hash,
                                                     bool simulated);

// `output` with the prior in it, and what came from it in keys quality.prior.*; notes say so. Errors: a method other than joint, too few
// calibrations.
Status add_prior(const PriorSource& source, const LoadedRecording& recording, const CalibrationRequest& request,
                 CalibrationOutput& output);

}  // namespace turncal
