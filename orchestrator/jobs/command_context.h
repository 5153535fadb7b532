// Where a command says things, and what it leaves as exit code.
#pragma once

#include <algorithm>
#include <ostream>
#include <string>

#include "calib/types/status.h"
#include "orchestrator/watch/progress.h"

namespace turncal {

// In front of every error; coloured on a terminal.
inline constexpr const char* error_prefix = "turncal: ";
// An error is one line, whatever it was made of.
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
  bool quiet = false;         // nothing is to be printed but errors
  std::string tag = {};       // of errors: "[dry run] ", "[simulated] " or nothing
  int exit_code = 0;          // what the command that ran has to say

  // One line on err; sets the exit code.
  void fail(const Error& error);
  void warn(const std::string& text) { err << tag << "warning: " << one_line(text) << std::endl; }
};

// What the program ends with for each kind of error. 0: all is well.
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
