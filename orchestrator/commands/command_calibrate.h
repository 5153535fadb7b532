// `turncal calibrate RECORDING --out DIR [--method ...]`: writes DIR/parameters.conf from any recording. A truth.conf beside the
// recording (as after a dry run) is compared with the result.
#pragma once

#include "orchestrator/commands/command_line.h"

namespace turncal {

void add_calibrate_command(CLI::App& app, CommandContext& context);

}  // namespace turncal
