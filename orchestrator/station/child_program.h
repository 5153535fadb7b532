// Another program as a child: it reads a text or what this program reads, what it prints is kept or goes where this program's output goes,
// and it is killed, with its own children, at its deadline or when it prints too much.
#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
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

}  // namespace turncal
