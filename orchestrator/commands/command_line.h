// The command line of turncal: `turncal COMMAND ...`. Commands declare their options with the classes below; what the parser
// (CLI11) makes of them is command_line.cpp's alone, since it takes ten seconds to compile.
//
// Exit codes are those of calib/types/status.h; every error is one line on `err`. Nothing throws out of here.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "orchestrator/jobs/command_context.h"

namespace CLI {
class App;
class Option;
}  // namespace CLI

namespace turncal {

// An option of a command. Each call adds a condition and returns the same option; a value that breaks one is an input error.
class Option {
 public:
  explicit Option(CLI::Option* option) : option_(option) {}
  const Option& required() const;
  const Option& positive() const;
  const Option& not_negative() const;
  const Option& range(int low, int high) const;  // both included
  const Option& range(double low, double high) const;
  const Option& one_of(const std::vector<std::string>& values) const;
  // A time with its unit (90s, 40min, 2h, 30d), from low to high; a bare number is in `unit`, and so are low, high and the value.
  const Option& time(double low, double high, const std::string& unit = "s") const;
  const Option& needs(const Option& other) const;
  const Option& words(int count) const;  // of a list: just as many
  const Option& one_word_each() const;   // of a list: the option stands before every word of it
  const Option& default_in_help() const;

 private:
  CLI::Option* option_;
};

class Command {
 public:
  explicit Command(CLI::App* app) : app_(app) {}

  // Fills `value`, which must live as long as the parser: a std::string, double, std::optional<double>, int, std::size_t,
  // std::vector<std::string> or std::vector<std::int64_t>. A name without dashes is a word that stands by itself.
  template <class Value>
  Option option(const std::string& name, Value& value, const std::string& help) const;
  void flag(const std::string& name, bool& value, const std::string& help) const;
  // --format, for what other programs read.
  void format(std::string& value, const std::string& help) const;

 private:
  friend class CommandLine;
  CLI::App* app_;
};

class CommandLine {
 public:
  CommandLine(CLI::App& app, CommandContext& context) : app_(app), context_(context) {}

  // A command and its options, which `job` is given. An error of it is said and becomes the exit code.
  template <class Options>
  std::pair<Command, Options&> command(const std::string& name, const std::string& help,
                                       Status (*job)(const Options&, CommandContext&)) {
    const auto options = std::make_shared<Options>();
    return {add(name, help, [job, options, &context = context_] { return job(*options, context); }), *options};
  }
  // A command that has only actions, each a command of what is returned: `turncal records check DB`.
  CommandLine family(const std::string& name, const std::string& help);
  void set_group(const std::string& group) { group_ = group; }  // of those that are added next, in --help

 private:
  Command add(const std::string& name, const std::string& help, std::function<Status()> job);
  CLI::App* add(const std::string& name, const std::string& help);  // with its examples
  CLI::App& app_;
  CommandContext& context_;
  std::string group_ = "Actions";
};

using AddCommand = void(CommandLine& line);  // adds one command
// As `turncal --help` lists them.
struct CommandGroup {
  std::string name;
  std::vector<AddCommand*> commands;
};

// `help X` is X --help. A name that a command had in the version before is answered with the new one, and works.
int run_command_line(int argc, const char* const* argv, const std::vector<CommandGroup>& groups,
                     CommandContext& context);

}  // namespace turncal
