// `turncal monitor`: looks at the station's table and unit, one line a second; moves nothing (docs/twin.md).
#pragma once

#include "orchestrator/commands/command_line.h"

namespace turncal {

void add_monitor_command(CLI::App& app, CommandContext& context);

}  // namespace turncal
