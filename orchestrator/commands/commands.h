// The commands `turncal COMMAND ...`, in the order of `turncal --help`; main.cpp registers them. Commands of one kind share a
// file. They declare their options with the classes below; only command_line.cpp sees the parser (CLI11).
//
// Exit codes are those of calib/types/status.h; every error is one line on `err`. No exception leaves a command.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <ostream>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "imu_io/base/clock.h"
#include "orchestrator/jobs/command_context.h"
#include "orchestrator/report/document.h"
#include "orchestrator/station/number_text.h"
#include "orchestrator/station/station_config.h"

namespace CLI {
class App;
class Option;
}  // namespace CLI

namespace turncal {

// A condition on an option's value; a value that breaks it is an input error.
using Condition = std::function<void(CLI::Option&)>;
namespace is {
void required(CLI::Option& option);
void positive(CLI::Option& option);
void one_word_each(CLI::Option& option);  // for a list: every word needs the option before it
void default_in_help(CLI::Option& option);
Condition words(int count);       // for a list: exactly so many
Condition in(int low, int high);  // limits included
Condition in(double low, double high);
Condition one_of(const std::vector<std::string>& values);
// A time with its unit (90s, 40min, 1h30min, 30d); low, high and the result are in `unit`.
Condition time(double low, double high, const std::string& unit = "s");
}  // namespace is
void needs(CLI::Option* option, CLI::Option* other);  // requires `other`

// The variable that an option sets; it must live as long as the parser.
struct Place {
  template <class Value>
  Place(Value& filled) : value(&filled) {}
  std::variant<std::string*, double*, std::optional<double>*, int*, std::size_t*, std::vector<std::string>*,
               std::vector<std::int64_t>*>
      value;
};

class Command {
 public:
  explicit Command(CLI::App* app) : app_(app) {}

  // Adds an option. A name without dashes is a positional argument.
  CLI::Option* option(const std::string& name, const Place& place, const std::vector<Condition>& conditions,
                      const std::string& help) const;
  CLI::Option* option(const std::string& name, const Place& place, const std::string& help) const {
    return option(name, place, {}, help);
  }
  void flag(const std::string& name, bool& value, const std::string& help) const;
  // Adds --format, for output that other programs read.
  void format(std::string& value, const std::string& help) const;

 private:
  friend class CommandLine;
  CLI::App* app_;
};

class CommandLine {
 public:
  CommandLine(CLI::App& app, CommandContext& context) : app_(app), context_(context) {}

  // Adds a command; `job` gets its options. An error of it is printed and sets the exit code.
  template <class Options>
  std::pair<Command, Options&> command(const std::string& name, const std::string& help,
                                       Status (*job)(const Options&, CommandContext&)) {
    const auto options = std::make_shared<Options>();
    return {add(name, help, [job, options, &context = context_] { return job(*options, context); }), *options};
  }
  // Adds a command that has only actions, which are commands of the result: `turncal records check DB`.
  CommandLine family(const std::string& name, const std::string& help);
  void set_group(const std::string& group) { group_ = group; }  // group in --help of the commands added next

 private:
  Command add(const std::string& name, const std::string& help, std::function<Status()> job);
  CLI::App* add(const std::string& name, const std::string& help);  // with its examples
  CLI::App& app_;
  CommandContext& context_;
  std::string group_ = "Actions";
};

using AddCommand = void(CommandLine& line);  // adds one command
// A group of commands, as `turncal --help` lists it.
struct CommandGroup {
  std::string name;
  std::vector<AddCommand*> commands;
};

// Runs a command line. `help X` is X --help. A command's former name still works, and the new one is mentioned.
int run_command_line(int argc, const char* const* argv, const std::vector<CommandGroup>& groups,
                     CommandContext& context);

AddCommand add_run_command, add_resume_command, add_campaign_command, add_check_command, add_commission_command,
    add_monitor_command, add_twin_command, add_verify_command, add_journal_command, add_import_command,
    add_export_command, add_segment_command, add_apply_command, add_convert_command, add_calibrate_command,
    add_diagnose_command, add_allan_command, add_thermal_command, add_navigate_command, add_predict_command,
    add_design_command, add_batch_command, add_queue_command, add_serve_command, add_shift_command, add_fleet_command,
    add_recalibrate_command, add_history_command, add_certificate_command, add_records_command;

// The progress of long work: one line on a terminal, redrawn.
class Phases {
 public:
  // `silent`: the output is for a program.
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
    show("  " + significant(1e-6 * double(count), 3) + " million samples");
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

// Prints a result, given as the text of its file, in a form for programs. False: none was requested.
inline bool printed_as(const std::string& format, const std::string& conf, std::ostream& out) {
  if (!format.empty()) out << key_values_as(format, conf) << std::flush;
  return !format.empty();
}

struct RunRequest;
// Options that several commands share.
void add_record_options(const Command& command, RunRequest& request);
void add_watch_options(const Command& command, RunRequest& request);

// Returns "FILE:LINE: KEY is a guess" for each such line of the table's file and the unit's frame; moving: only for those that
// decide what moves.
std::vector<std::string> guesses_of(const StationConfig& station, bool moving, bool heating = false);

}  // namespace turncal
