// `turncal batch`: calibrates the units of a queue one after the other, or several at once, unattended. `turncal queue`: shows and
// changes it.
//
// A unit that fails, drops out while others go on, or is not the one on the table, does not stop the next; a fault of table, link or
// disk, and the operator, by a pause too, stop the batch, and the same command goes on with the units that were interrupted.
#pragma once

#include "orchestrator/commands/command_line.h"

namespace turncal {

void add_batch_command(CLI::App& app, CommandContext& context);
void add_queue_command(CLI::App& app, CommandContext& context);

}  // namespace turncal
