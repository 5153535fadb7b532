// `turncal history`: what is in the results database. `turncal restore`: versions of the parameter file in use.
#pragma once

#include "orchestrator/commands/command_line.h"

namespace turncal {

void add_history_command(CLI::App& app, CommandContext& context);
void add_restore_command(CLI::App& app, CommandContext& context);

}  // namespace turncal
