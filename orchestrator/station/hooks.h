// Commands of the station, run when a unit is done, has failed its limits, or an operator is needed. /bin/sh gets them, and what happened:
//
//   TURNCAL_EVENT (done, fail, needs_operator, mount, switch_on)  TURNCAL_UNIT  TURNCAL_FOLDER  TURNCAL_MESSAGE  TURNCAL_DRY_RUN (true, false)
//   TURNCAL_OUTCOME: the unit's outcome in one word (pass, hold, fail, dropped ...; empty: it has none)
//
// A hook runs when the table stands and the results are durable, and has hook_time_s; then it and its children are killed.
// What a hook does or fails to do changes nothing of the run; but without a mount that succeeds none begins.
#pragma once

#include <functional>
#include <string>
#include <utility>

#include "calib/types/status.h"

namespace turncal {

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
