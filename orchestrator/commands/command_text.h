// `turncal import TEXTDIR --out DIR` and `turncal export RECORDING --out DIR`: between the text form of a recording and the
// binary one. Nothing is overwritten, and a failure leaves nothing behind.
#pragma once

#include "orchestrator/commands/command_line.h"

namespace turncal {

void add_import_command(CLI::App& app, CommandContext& context);
void add_export_command(CLI::App& app, CommandContext& context);

}  // namespace turncal
