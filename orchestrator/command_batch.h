// `turncal batch`: calibrates the units of a queue one after the other, unattended. `turncal queue`: shows and changes it.
//
// A unit that fails, or that is not the one on the table, does not stop the next; a fault of table, link or disk, and the
// operator, by a pause too, stop the batch, and the same command goes on with the unit that was interrupted.
#pragma once

#include "orchestrator/command_line.h"

namespace turncal {

void add_batch_command(CLI::App& app, CommandContext& context);
void add_queue_command(CLI::App& app, CommandContext& context);

}  // namespace turncal
