// The command line of `turncal check`; what it does is in command_check.h.
#pragma once

#include "orchestrator/commands/command_line.h"

namespace turncal {

void add_check_command(CLI::App& app, CommandContext& context);

}  // namespace turncal
