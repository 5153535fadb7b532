// Where a command prints, and the exit code that it leaves.
#pragma once

#include <algorithm>
#include <ostream>
#include <string>

#include "calib/types/status.h"
#include "orchestrator/watch/progress.h"

namespace turncal {

// Prefix of every error; coloured on a terminal.
inline constexpr const char* error_prefix = "turncal: ";
// Makes one line of a message: errors are printed on one line.
inline std::string one_line(std::string text) {
  text.erase(text.find_last_not_of("\n ") + 1);
  std::ranges::replace(text, '\n', ' ');
  return text;
}

struct CommandContext {
  std::ostream& out;
  std::ostream& err;
  bool out_is_terminal = false;
  int terminal_columns = 80;  // meaningful when out is a terminal
  bool quiet = false;         // print errors only
  std::string tag = {};       // of errors: "[dry run] ", "[simulated] " or nothing
  int exit_code = 0;          // of the command that ran

  // Prints one line on err and sets the exit code.
  void fail(const Error& error);
  void warn(const std::string& text) { err << tag << "warning: " << one_line(text) << std::endl; }
};

// Returns the program's exit code for each kind of error. 0: success.
constexpr int exit_code(ErrorKind kind) {
  switch (kind) {
    case ErrorKind::input: return 1;
    case ErrorKind::unit_failed: return 20;
    case ErrorKind::aborted: return 30;
    case ErrorKind::device: return 50;
    case ErrorKind::internal: return 70;
    case ErrorKind::interrupted: return 75;
  }
  return 70;
}

inline void CommandContext::fail(const Error& error) {
  err << tag << in_tone(err, Tone::bad, error_prefix) << one_line(error.message) << std::endl;
  exit_code = turncal::exit_code(error.kind);
}

}  // namespace turncal
