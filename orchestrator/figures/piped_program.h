// Another program as a filter: text goes in and what it makes of it comes back as files in memory; nothing is written to disk. It is
// started in the C locale and killed at the deadline.
//
// Errors are one line of kind internal: the program is not there (its Debian package is named), took too long, or stopped with an error
// (its first line is quoted).
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "calib/types/status.h"

namespace turncal {

struct PipedProgram {
  std::string name;  // looked up in PATH when it has no slash
  std::vector<std::string> arguments;
  std::string package;  // that has it
  double deadline_s = 15.0;
};

struct PipedOutput {
  std::string output;
  std::string message;  // the first line on its standard error; empty: nothing
};

Result<PipedOutput> pipe_through(const PipedProgram& program, std::string_view input);

}  // namespace turncal
