// `turncal twin`: serves the rig outside, as the table and the unit that the station file describes, until a signal ends it (docs/twin.md).
#pragma once

#include "orchestrator/commands/command_line.h"

namespace turncal {

void add_twin_command(CLI::App& app, CommandContext& context);

}  // namespace turncal
