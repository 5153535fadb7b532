// The commands, in the order in which `turncal --help` lists them; main.cpp registers them. Those of one kind are one file.
#pragma once

#include <ostream>
#include <string>
#include <vector>

#include "orchestrator/commands/command_line.h"
#include "orchestrator/station/station_config.h"

namespace turncal {

void add_run_command(CommandLine& line);
void add_resume_command(CommandLine& line);
void add_journal_command(CommandLine& line);
void add_twin_command(CommandLine& line);
void add_monitor_command(CommandLine& line);
void add_commission_command(CommandLine& line);
void add_check_command(CommandLine& line);
void add_predict_command(CommandLine& line);
void add_design_command(CommandLine& line);
void add_import_command(CommandLine& line);
void add_export_command(CommandLine& line);
void add_segment_command(CommandLine& line);
void add_allan_command(CommandLine& line);
void add_calibrate_command(CommandLine& line);
void add_diagnose_command(CommandLine& line);
void add_thermal_command(CommandLine& line);
void add_apply_command(CommandLine& line);
void add_navigate_command(CommandLine& line);
void add_verify_command(CommandLine& line);
void add_certificate_command(CommandLine& line);
void add_convert_command(CommandLine& line);
void add_batch_command(CommandLine& line);
void add_queue_command(CommandLine& line);
void add_serve_command(CommandLine& line);
void add_history_command(CommandLine& line);
void add_shift_command(CommandLine& line);
void add_recalibrate_command(CommandLine& line);
void add_fleet_command(CommandLine& line);
void add_database_command(CommandLine& line);
void add_restore_command(CommandLine& line);
void add_prune_command(CommandLine& line);

struct RunRequest;
// Options that several commands have.
void add_record_options(const Command& command, RunRequest& request);
void add_verify_option(const Command& command, RunRequest& request);
void add_until_option(const Command& command, RunRequest& request);
void add_watch_options(const Command& command, RunRequest& request);

// `turncal check`: validates station and sequence before anything moves, and prints the plan. Exit code 0 when the station may run the
// sequence; else 1 and one line for each problem on `err`. Nothing is written, opened or moved.
struct CheckOptions {
  std::string station;   // file; empty: the built-in rig station
  std::string sequence;  // file
  std::string overdue_reason = {};
  std::string out = {};  // folder of a run; empty: not looked at
  std::vector<std::string> units = {};
  bool verify = false;
  bool explain = false;  // the table, too; without a sequence it alone
};
int run_check(const CheckOptions& options, std::ostream& out, std::ostream& err);

// "FILE:LINE: KEY is a guess" of each line of the table's file, and of the unit's frame, that is one; moving: of those alone that
// decide what moves.
std::vector<std::string> guesses_of(const StationConfig& station, bool moving);

}  // namespace turncal
