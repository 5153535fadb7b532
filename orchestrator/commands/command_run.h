// Options that `run`, `resume` and `batch` have in common.
#pragma once

#include "orchestrator/commands/command_line.h"

namespace turncal {

struct RunRequest;

void add_record_options(const Command& command, RunRequest& request);
void add_verify_option(const Command& command, RunRequest& request);
void add_until_option(const Command& command, RunRequest& request);
void add_watch_options(const Command& command, RunRequest& request);

}  // namespace turncal
