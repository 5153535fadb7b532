// The command line of turncal: `turncal COMMAND ...`, one file command_<name> each, registered in one line of main.cpp.
//
// Exit codes are those of calib/types/status.h; every error is one line on `err`. Nothing throws out of here.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>

#include "orchestrator/jobs/command_context.h"

namespace turncal {

// Adds one subcommand, whose callback leaves its result in the context.
using AddCommand = void (*)(CLI::App& app, CommandContext& context);

int run_command_line(int argc, const char* const* argv, const std::vector<AddCommand>& commands,
                     CommandContext& context);

}  // namespace turncal
