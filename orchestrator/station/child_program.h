// Runs another program as a child. Its input is a text or this program's own; its output is kept or goes where this program's goes.
// The child and its own children are killed at the deadline, or when they print too much.
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
  std::vector<std::string> words;              // program, looked up in PATH when it has no slash, and its arguments
  std::string package;                         // Debian package that provides it
  std::vector<std::string> environment;        // KEY=value, set in place of `replaced`
  std::string replaced;                        // variables of this program that begin like this are not passed on
  std::optional<std::string_view> input = {};  // standard input; empty: this program's own
  std::size_t most_printed = 0;  // bytes of output, and of errors, that are kept; 0: both go to this program's own
  double time_s = 15.0;
  std::function<bool()> give_up = {};  // asked while it runs: true kills it
};

struct ChildEnd {
  std::string killed;  // why: "did not end within its time and was killed"; empty: it ended by itself
  int code = 0, signal = 0;
  std::string output, errors;
  bool good() const { return killed.empty() && code == 0 && signal == 0; }
  std::string message() const;  // ": " and the first line of standard error; empty when there is none
};

// Runs the program to its end. An error of kind internal when it could not be started.
Result<ChildEnd> run_child(const ChildProgram& program);

// Runs a program as a filter, in the C locale, and returns what it prints for the input. An error of kind internal, one line, when it is not
// installed, took too long, ended with an error (its first line is quoted) or printed more than 64 MiB.
Result<ChildEnd> pipe_through(const std::string& package, std::vector<std::string> words, std::string_view input,
                              double time_s = 15.0);

// ---- commands of the station ----

// Commands of the station, run when a unit is done, has failed its limits, or an operator is needed. /bin/sh runs them; the environment tells:
//
//   TURNCAL_EVENT (done, fail, needs_operator, mount, switch_on)  TURNCAL_UNIT  TURNCAL_FOLDER  TURNCAL_MESSAGE  TURNCAL_DRY_RUN (true, false)
//   TURNCAL_OUTCOME: the unit's outcome in one word (pass, hold, fail, dropped ...; empty: it has none)
//
// A hook runs when the table is at rest and the results are durable. After hook_time_s it is killed, with its children.
// A hook that fails does not change the run, with one exception: no run begins unless its mount hook succeeds.

struct HookCommands {  // empty: none
  std::string done, fail, needs_operator;
  std::string mount;  // before each unit of a batch (mount_unit)
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
  std::string input = {};  // standard input of the hook; empty: this program's own
};

inline constexpr double hook_time_s = 60.0;

// Returns the call for a finished run: done on success, fail when the unit failed, otherwise needs_operator (also without a verdict: run_job.cpp).
HookCall call_for(const Status& outcome);

// Runs the hook of the call's event; an empty command succeeds. An error when it cannot be run, exceeds its time or ends with a code other than 0.
// `give_up` is polled while it runs; true kills it.
Status run_hook(const HookCommands& commands, const HookCall& call, double time_s = hook_time_s,
                const std::function<bool()>& give_up = {});
// Runs a command that is not a hook of a station in the same way; `name` is its key in messages.
Status run_command(const std::string& name, const std::string& command, const HookCall& call, double time_s,
                   const std::function<bool()>& give_up);

}  // namespace turncal
