// The commands, in the order in which `turncal --help` lists them; main.cpp registers them. Each is a file command_<name>.cpp.
#pragma once

#include "orchestrator/commands/command_line.h"

namespace turncal {

struct RecordFilter;
// Which rows of the results database: --station, --part, --from, --to.
void add_filter_options(const Command& command, RecordFilter& filter);

void add_run_command(CommandLine& line, CommandContext& context);
void add_resume_command(CommandLine& line, CommandContext& context);
void add_journal_command(CommandLine& line, CommandContext& context);
void add_twin_command(CommandLine& line, CommandContext& context);
void add_monitor_command(CommandLine& line, CommandContext& context);
void add_commission_command(CommandLine& line, CommandContext& context);
void add_check_command(CommandLine& line, CommandContext& context);
void add_predict_command(CommandLine& line, CommandContext& context);
void add_design_command(CommandLine& line, CommandContext& context);
void add_import_command(CommandLine& line, CommandContext& context);
void add_export_command(CommandLine& line, CommandContext& context);
void add_segment_command(CommandLine& line, CommandContext& context);
void add_calibrate_command(CommandLine& line, CommandContext& context);
void add_diagnose_command(CommandLine& line, CommandContext& context);
void add_apply_command(CommandLine& line, CommandContext& context);
void add_navigate_command(CommandLine& line, CommandContext& context);
void add_verify_command(CommandLine& line, CommandContext& context);
void add_certificate_command(CommandLine& line, CommandContext& context);
void add_convert_command(CommandLine& line, CommandContext& context);
void add_batch_command(CommandLine& line, CommandContext& context);
void add_queue_command(CommandLine& line, CommandContext& context);
void add_serve_command(CommandLine& line, CommandContext& context);
void add_history_command(CommandLine& line, CommandContext& context);
void add_shift_command(CommandLine& line, CommandContext& context);
void add_recalibrate_command(CommandLine& line, CommandContext& context);
void add_fleet_command(CommandLine& line, CommandContext& context);
void add_database_command(CommandLine& line, CommandContext& context);
void add_restore_command(CommandLine& line, CommandContext& context);
void add_prune_command(CommandLine& line, CommandContext& context);

}  // namespace turncal
