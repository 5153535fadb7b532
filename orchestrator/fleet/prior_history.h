// Parameter files of earlier calibrations as what was known of a fleet before (calib/fleet/fleet_prior.h): every parameters.conf whose 21
// parameters are all known, that is trusted and without effects. The same recording counts once: the newest version of it. Left out: the
// recording itself, what has a prior in it already, simulated ones beside real ones.
#pragma once

#include <string>

#include "orchestrator/jobs/calibration_job.h"

namespace turncal {

struct PriorSource {
  std::string from;  // a folder, or a results database (fleet_members.h)
  std::string part;  // record.part; empty: any
};

// `output` with the prior in it, and what came from it in keys quality.prior.*; notes say so. Errors: a method other than joint, too few
// calibrations.
Status add_prior(const PriorSource& source, const LoadedRecording& recording, const CalibrationRequest& request,
                 CalibrationOutput& output);

}  // namespace turncal
