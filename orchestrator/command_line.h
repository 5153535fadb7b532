// The command line of turncal: `turncal COMMAND ...`, one file command_<name> each, registered in one line of main.cpp.
//
// Exit codes are those of calib/status.h; every error is one line on `err`. Nothing throws out of here.
#pragma once

#include <functional>
#include <ostream>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>

#include "calib/status.h"

namespace turncal {

struct CommandContext {
  std::ostream& out;
  std::ostream& err;
  bool out_is_terminal = false;
  int terminal_columns = 80;  // meaningful when out is a terminal
  std::string tag = {};  // of errors: "[dry run] ", "[simulated] " or nothing
  int exit_code = 0;  // what the command that ran has to say

  // One line on err; sets the exit code.
  void fail(const Error& error);
};

// Adds one subcommand, whose callback leaves its result in the context.
using AddCommand = void (*)(CLI::App& app, CommandContext& context);

int run_command_line(int argc, const char* const* argv, const std::vector<AddCommand>& commands, CommandContext& context);

const char* software_version();

}  // namespace turncal
