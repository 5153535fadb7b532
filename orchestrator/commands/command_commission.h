// `turncal commission`: is the table what its map or dialect says, and does the unit feel its axes as it should? (docs/twin.md)
#pragma once

#include "orchestrator/commands/command_line.h"

namespace turncal {

void add_commission_command(CLI::App& app, CommandContext& context);

}  // namespace turncal
