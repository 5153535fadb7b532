// `turncal run --continue DIR`: a further recording of the unit of an earlier run, in a folder and with a journal of its own. What comes of it
// is calibrated and diagnosed together with the recordings that it continues, with six biases for each of them (docs/design.md).
#pragma once

#include <string>
#include <vector>

#include "orchestrator/jobs/loaded_recording.h"
#include "orchestrator/jobs/run_request.h"

namespace turncal {

// `asked` with unit, station, rig and what is on record of the run in asked.continues. An error where that is not a run of one unit that has
// a whole recording, or where something is asked for that a continuation does not do.
Result<RunRequest> continuing(const RunRequest& asked);

// What the run in `folder` recorded, and before it what that run continues: oldest first. An error when one is not as it was sealed.
Result<std::vector<LoadedRecording>> recordings_up_to(const std::string& folder);

}  // namespace turncal
