// `turncal run`: the whole main job. Checks everything, walks the sequence, calibrates, judges, writes the results.
// `turncal resume`: goes on with one that was interrupted. `turncal journal`: what happened. See run_job.h.
#pragma once

#include "orchestrator/commands/command_line.h"

namespace turncal {

struct RunRequest;

void add_record_options(CLI::App& command, RunRequest& request);
void add_view_options(CLI::App& command, RunRequest& request);
void add_run_command(CLI::App& app, CommandContext& context);
void add_resume_command(CLI::App& app, CommandContext& context);
void add_journal_command(CLI::App& app, CommandContext& context);

}  // namespace turncal
