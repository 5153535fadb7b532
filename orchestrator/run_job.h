// A run from beginning to end: `begin_run` in a new folder, `take_up_run` where one was interrupted.
//
// The folder holds journal.tcj, run.log, recording.partial.tcr (recording.tcr once sealed), parameters.conf, and after a dry
// run truth.conf. A run that failed before its first sample leaves nothing; one that failed later can be taken up.
#pragma once

#include <string>

#include "orchestrator/command_line.h"
#include "orchestrator/run_request.h"

namespace turncal {

Status begin_run(const RunRequest& request, const std::string& folder, CommandContext& context);

// `now`: where the files are now that the journal names (station, sequence, rig); empty: where they were; and
// listen and pace. The devices must
// be the same kind (simulated or not), the unit and every hash those of the journal.
Status take_up_run(const std::string& folder, const RunRequest& now, CommandContext& context);

}  // namespace turncal
