// `turncal run`: the whole main job. Checks everything, walks the sequence, calibrates, writes the results.
//
// The folder then holds recording.tcr, parameters.conf and run.log, and after a dry run truth.conf. A run that failed
// before its first sample leaves nothing; one that failed later leaves run.log and recording.partial.tcr.
#pragma once

#include "orchestrator/command_line.h"

namespace turncal {

void add_run_command(CLI::App& app, CommandContext& context);

}  // namespace turncal
