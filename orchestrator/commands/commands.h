// The commands, in the order in which `turncal --help` lists them; main.cpp registers them. Those of one kind are one file.
#pragma once

#include <ostream>
#include <string>
#include <vector>

#include "imu_io/base/clock.h"
#include "orchestrator/commands/command_line.h"
#include "orchestrator/figures/report_format.h"
#include "orchestrator/jobs/command_context.h"
#include "orchestrator/station/station_config.h"

namespace turncal {

AddCommand add_run_command, add_resume_command, add_campaign_command, add_check_command, add_commission_command,
    add_monitor_command, add_twin_command, add_verify_command, add_journal_command, add_import_command,
    add_export_command, add_segment_command, add_apply_command, add_convert_command, add_calibrate_command,
    add_diagnose_command, add_allan_command, add_thermal_command, add_navigate_command, add_predict_command,
    add_design_command, add_batch_command, add_queue_command, add_serve_command, add_shift_command, add_fleet_command,
    add_recalibrate_command, add_history_command, add_certificate_command, add_records_command;

// The progress of work that takes longer than a moment: one line of a terminal, redrawn.
class Phases {
 public:
  // `silent`: what is printed is for a program.
  Phases(const CommandContext& context, bool silent) : out_(context.out), shows_(context.out_is_terminal && !silent) {}
  ~Phases() { clear(); }
  void begin(const std::string& what) {
    what_ = what;
    show("");
  }
  void samples(std::int64_t count) {
    const double now_s = monotonic_s();
    if (now_s - drawn_s_ < 0.1) return;
    drawn_s_ = now_s;
    show("  " + significant(1e-6 * static_cast<double>(count), 3) + " million samples");
  }
  void clear() { show("", ""); }

 private:
  void show(const std::string& more) { show(what_, more); }
  void show(const std::string& what, const std::string& more) {
    if (shows_) out_ << '\r' << what << more << "\x1b[K" << std::flush;
  }
  std::ostream& out_;
  bool shows_;
  std::string what_;
  double drawn_s_ = -1e9;
};

struct RunRequest;
// Options that several commands have.
void add_record_options(const Command& command, RunRequest& request);
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
  bool explain = false;  // explain the table, too; without a sequence, only that
};
int run_check(const CheckOptions& options, std::ostream& out, std::ostream& err);

// "FILE:LINE: KEY is a guess" of each line of the table's file, and of the unit's frame, that is one; moving: of those alone that
// decide what moves.
std::vector<std::string> guesses_of(const StationConfig& station, bool moving, bool heating = false);

}  // namespace turncal
