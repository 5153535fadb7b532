// Another program as a child: it reads a text or what this program reads, what it prints is kept or goes where this program's output goes,
// and it is killed, with its own children, at its deadline or when it prints too much.
#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "calib/types/status.h"

namespace turncal {

struct ChildProgram {
  std::vector<std::string> words;              // its name, looked up in PATH when it has no slash, and its arguments
  std::string package;                         // of Debian, that has it
  std::vector<std::string> environment;        // KEY=value, in place of
  std::string replaced;                        // what begins like this in this program's environment
  std::optional<std::string_view> input = {};  // empty: this program's own
  std::size_t most_printed = 0;  // bytes of its output, and of its errors, which are kept; 0: both are this program's
  double time_s = 15.0;
  std::function<bool()> give_up = {};  // asked while it runs: true kills it
};

struct ChildEnd {
  std::string killed;  // why: "did not end within its time and was killed"; empty: it ended by itself
  int code = 0, signal = 0;
  std::string output, errors;
  bool good() const { return killed.empty() && code == 0 && signal == 0; }
  std::string message() const;  // ": " and the first line of its errors; empty: there is none
};

// An error of kind internal where it could not be started.
Result<ChildEnd> run_child(const ChildProgram& program);

// A program as a filter, in the C locale: what it makes of the input. An error of kind internal, one line, where it is not there, took too
// long, ended with an error (its first line is quoted) or printed more than 64 MiB.
Result<ChildEnd> pipe_through(const std::string& package, std::vector<std::string> words, std::string_view input,
                              double time_s = 15.0);

// ---- commands of the station ----

// Commands of the station, run when a unit is done, has failed its limits, or an operator is needed. /bin/sh gets them, and what happened:
//
//   TURNCAL_EVENT (done, fail, needs_operator, mount, switch_on)  TURNCAL_UNIT  TURNCAL_FOLDER  TURNCAL_MESSAGE  TURNCAL_DRY_RUN (true, false)
//   TURNCAL_OUTCOME: the unit's outcome in one word (pass, hold, fail, dropped ...; empty: it has none)
//
// A hook runs when the table stands and the results are durable, and has hook_time_s; then it and its children are killed.
// What a hook does or fails to do changes nothing of the run; but without a mount that succeeds none begins.

struct HookCommands {  // empty: none
  std::string done, fail, needs_operator;
  std::string mount;  // before a unit of a batch (mount_unit)
  double mount_time_s = 3600.0;
  std::string switch_on;  // switches the unit off and on, between legs of a campaign
};

inline constexpr std::pair<const char*, std::string HookCommands::*> hook_events[] = {
    {"done", &HookCommands::done},
    {"fail", &HookCommands::fail},
    {"needs_operator", &HookCommands::needs_operator},
    {"mount", &HookCommands::mount},
    {"switch_on", &HookCommands::switch_on}};

struct HookCall {
  std::string event, unit, folder, message;
  std::string outcome = {};
  bool dry_run = false;
  std::string input = {};  // what it reads on standard input; empty: the program's own
};

inline constexpr double hook_time_s = 60.0;

// Of a finished run: done on success, fail when the unit failed, otherwise needs_operator (also of a unit that nobody judged: run_job.cpp).
HookCall call_for(const Status& outcome);

// An error when it could not be run, did not end in time, or ended with another code than 0. An empty command is fine.
// `give_up` is asked while it runs: true kills it.
Status run_hook(const HookCommands& commands, const HookCall& call, double time_s = hook_time_s,
                const std::function<bool()>& give_up = {});
// The same of a command that is no station's; `name` is its key.
Status run_command(const std::string& name, const std::string& command, const HookCall& call, double time_s,
                   const std::function<bool()>& give_up);

}  // namespace turncal
