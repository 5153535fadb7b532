// The commands, in the order in which `turncal --help` lists them; main.cpp registers them. Each is a file command_<name>.cpp.
//
// Options that `run`, `resume` and `batch` have in common.
//
// `turncal check`: validates station and sequence before anything moves, and prints the plan.
//
// Exit code 0 and the plan on `out` when the station may run the sequence; 1 and one line for each problem on `err`
// otherwise (the plan is printed too when both files could be read). Nothing is written, opened or moved.
//
// `turncal predict --sequence FILE [--sequence FILE ...]`: what each sequence would determine and how well, before anything is
// run (calib/prediction/predict.h). Several sequences stand side by side, each with its sigma over that of the first.
//
//   --station FILE             site, settling time and unit; default: the built-in rig station
//   --latitude, --gravity      another site, deg and m/s^2
//   --arw, --vrw               angle random walk, deg/sqrt(h); velocity random walk, ug/sqrt(Hz)
//   --gyro-bias-instability, --accel-bias-instability
//                              sigma of the bias's slow part (Gauss-Markov, 600 s), deg/h and ug; 0: none
//   --effects                  also what every effect of the catalogue would have to be to be caught, and which are confused
//   --temperature-rise, --temperature-tau   C and s; with --effects. Without it effects of temperature are not looked at
//   --format json              the same for other programs
//   --navigate TIME, --align   what the calibration would be worth: drift of free navigation after 1h, 90min or 5400 (s)
//
// Nothing is written or moved. Exit code 0 also when parameters are not determined: they are named. A sequence that the
// station cannot run is predicted all the same, with a note.
//
// Data without a table: `turncal import --map MAP CSV --out DIR` reads any CSV, .npy or .mat into a recording without segments, and
// `turncal segment RECORDING --out DIR` finds its rests, prints them with the threshold and the reason for it, and
// writes the recording with segments static and rotate, all angles 0. Nothing is overwritten.
#pragma once

#include <ostream>
#include <string>
#include <vector>

#include "calib/types/status.h"
#include "orchestrator/commands/command_line.h"
#include "orchestrator/jobs/command_context.h"
#include "orchestrator/jobs/planned_unit.h"
#include "orchestrator/station/station_config.h"
#include "sequences/plan.h"

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

struct RunRequest;

void add_record_options(const Command& command, RunRequest& request);
void add_verify_option(const Command& command, RunRequest& request);
void add_until_option(const Command& command, RunRequest& request);
void add_watch_options(const Command& command, RunRequest& request);

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

// The table that run_check prints.
void print_plan(const Sequence& sequence, const StationConfig& station, const Plan& plan, std::ostream& out);

// What check and commission warn of in the table's map or dialect; else empty.
std::string caution_of(const TableConfig& table);
// Whether its map or dialect, where it has one, says so.
bool is_commissioned(const TableConfig& table);
// "FILE:LINE: KEY is a guess" of each line of the table's file, and of the unit's frame, that is one; moving: of those alone that
// decide what moves.
std::vector<std::string> guesses_of(const StationConfig& station, bool moving);

struct PredictRequest {
  std::vector<std::string> sequences;  // files
  PlannedSite site;
  bool effects = false;
  double temperature_rise_c = 0.0;  // 0: the temperature stands still
  double temperature_tau_s = 2400.0;
  std::string navigate;  // how long; empty: not asked
  double align_s = 300.0;
  std::string format;  // json; empty: words
};

// What `predict` and `design` are made for.
void add_site_options(const Command& command, PlannedSite& site);

Status run_predict(const PredictRequest& request, std::ostream& out);

// What `import` does when it is given a map.
struct MappedImport {
  std::string map;
  std::string file;
  std::string accel;  // of the accelerometers, where they have a file of their own
  bool skip_bad_rows = false;
};
Status import_mapped_csv(const MappedImport& from, const std::string& out, CommandContext& context);

}  // namespace turncal
