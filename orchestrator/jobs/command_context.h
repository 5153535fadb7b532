// Where a command says things, and what it leaves as exit code.
#pragma once

#include <ostream>
#include <string>

#include "calib/types/status.h"

namespace turncal {

struct CommandContext {
  std::ostream& out;
  std::ostream& err;
  bool out_is_terminal = false;
  int terminal_columns = 80;  // meaningful when out is a terminal
  bool quiet = false;         // nothing is to be printed but errors
  bool output_is_result = false;
  std::string tag = {};  // of errors: "[dry run] ", "[simulated] " or nothing
  int exit_code = 0;     // what the command that ran has to say

  // One line on err; sets the exit code.
  void fail(const Error& error);
};

}  // namespace turncal
