#include "orchestrator/commands/command_line.h"

#include <poll.h>
#include <unistd.h>

#include <cmath>
#include <cstdint>
#include <exception>
#include <optional>
#include <type_traits>

#include <CLI/CLI.hpp>

#include "imu_io/base/data_text.h"
#include "imu_io/base/format_number.h"
#include "imu_io/base/text_pieces.h"
#include "orchestrator/station/version.h"

namespace turncal {
namespace {

// A pipe that nobody reads any more (| head -1): what is made goes on.
bool reader_has_left() {
  pollfd output{STDOUT_FILENO, POLLOUT, 0};
  return ::poll(&output, 1, 0) == 1 && (output.revents & POLLERR) != 0;
}

// CLI11's own checks let "nan" pass, and name a limit of 300 digits.
CLI::Validator number_that(const std::function<bool(double)>& holds, const std::string& expected,
                           const std::string& name) {
  return CLI::Validator(
      [holds, expected](std::string& text) {
        const std::optional<double> value = parse_number<double>(text);
        return value && std::isfinite(*value) && holds(*value) ? "" : "'" + text + "': expected " + expected;
      },
      name);
}

CLI::Validator number_in(double low, double high, const std::string& kind) {
  const std::string from = format_number(low), to = format_number(high);
  return number_that([low, high](double x) { return x >= low && x <= high; }, kind + " from " + from + " to " + to,
                     "in [" + from + " - " + to + "]");
}

// An empty word is a variable of a script that was not set: without it the option would count as not given.
CLI::Validator some_text() {
  return CLI::Validator([](std::string& text) { return text.empty() ? "expected a text that is not empty" : ""; }, "");
}

// Where --quiet sends what a command prints.
class Nowhere : public std::streambuf {
  int_type overflow(int_type c) override { return traits_type::not_eof(c); }
  std::streamsize xsputn(const char*, std::streamsize n) override { return n; }
};

// A word that is not understood is said before what is missing because of it.
Error misunderstood(const CLI::App& app, const std::string& why) {
  const std::vector<CLI::App*> chosen = app.get_subcommands();
  const CLI::App& command = chosen.empty() ? app : *chosen.front();
  const std::string help = std::string(" (see turncal ") + (chosen.empty() ? "" : command.get_name() + " ") + "--help)";
  const std::vector<std::string> unknown = app.remaining(true);
  if (unknown.empty()) return input_error(why + help);
  const std::string typed = unknown.front().substr(0, unknown.front().find('='));
  std::vector<std::string> known;
  if (typed.starts_with("-"))
    for (const CLI::Option* option : command.get_options()) known.push_back(option->get_name());
  else if (chosen.empty())
    for (const CLI::App* other : app.get_subcommands([](const CLI::App*) { return true; }))
      known.push_back(other->get_name());
  return input_error("'" + unknown.front() + "' is not understood" + did_you_mean(typed, known) + help);
}

}  // namespace

const Option& Option::required() const { return option_->required(), *this; }
const Option& Option::positive() const {
  return option_->check(number_that([](double x) { return x > 0.0; }, "a number above 0", "POSITIVE")), *this;
}
const Option& Option::not_negative() const {
  return option_->check(number_that([](double x) { return x >= 0.0; }, "a number of 0 or more", "NONNEGATIVE")), *this;
}
const Option& Option::range(int low, int high) const {
  return option_->check(number_in(low, high, "a whole number")), *this;
}
const Option& Option::range(double low, double high) const {
  return option_->check(number_in(low, high, "a number")), *this;
}
const Option& Option::one_of(const std::vector<std::string>& values) const {
  return option_->check(CLI::IsMember(values)), *this;
}
const Option& Option::needs(const Option& other) const { return option_->needs(other.option_), *this; }
const Option& Option::words(int count) const { return option_->expected(count), *this; }
const Option& Option::one_word_each() const { return option_->allow_extra_args(false), *this; }
const Option& Option::default_in_help() const { return option_->capture_default_str(), *this; }

template <class Value>
Option Command::option(const std::string& name, Value& value, const std::string& help) const {
  CLI::Option* const option = app_->add_option(name, value, help);
  if constexpr (std::is_same_v<Value, std::string> || std::is_same_v<Value, std::vector<std::string>>)
    option->check(some_text());
  return Option(option);
}
template Option Command::option(const std::string&, std::string&, const std::string&) const;
template Option Command::option(const std::string&, double&, const std::string&) const;
template Option Command::option(const std::string&, std::optional<double>&, const std::string&) const;
template Option Command::option(const std::string&, int&, const std::string&) const;
template Option Command::option(const std::string&, std::size_t&, const std::string&) const;
template Option Command::option(const std::string&, std::vector<std::string>&, const std::string&) const;
template Option Command::option(const std::string&, std::vector<std::int64_t>&, const std::string&) const;

void Command::flag(const std::string& name, bool& value, const std::string& help) const {
  app_->add_flag(name, value, help);
}

void Command::format(std::string& value, const std::string& help) const {
  option("--format", value, help).one_of(data_formats);
}

Command CommandLine::add(const std::string& name, const std::string& help, std::function<Status()> job, Output output) {
  const Command command(app_.add_subcommand(name, help));
  command.flag("--quiet", context_.quiet, "print nothing but errors");
  command.app_->callback([&context = context_, job = std::move(job), output] {
    static Nowhere nowhere;
    if (context.quiet) context.out.rdbuf(&nowhere);
    context.output_is_result = output == Output::result;
    if (Status status = job(); !status) context.fail(status.error());
  });
  return command;
}

int run_command_line(int argc, const char* const* argv, const std::vector<AddCommand>& commands,
                     CommandContext& context) {
  std::streambuf* const out = context.out.rdbuf();
  try {
    CLI::App app("Calibrates a strapdown laser-gyro IMU on a three-axis turntable.", "turncal");
    app.set_version_flag("--version", std::string("turncal ") + software_version());
    app.require_subcommand(1);
    CommandLine line(app, context);
    for (const AddCommand add : commands) add(line);
    try {
      app.parse(argc, argv);
    } catch (const CLI::Success& success) {  // --help, --version
      app.exit(success, context.out, context.err);
    } catch (const CLI::ParseError& error) {
      // CLI11's own words for a text that is no number of the option's kind.
      constexpr std::string_view no_number = "Could not convert: ";
      std::string why = error.what();
      if (why.starts_with(no_number)) why = why.substr(no_number.size()) + ": expected a number of its kind";
      context.fail(misunderstood(app, why));
    }
  } catch (const std::exception& error) {
    context.fail({ErrorKind::internal, std::string("internal error: ") + error.what()});
  } catch (...) {  // so that everything on the way out is unwound: a table is stopped by that
    context.fail({ErrorKind::internal, "internal error"});
  }
  if (context.quiet) context.out.rdbuf(out);
  context.out.flush();
  if (!context.out && context.exit_code == 0 && (context.output_is_result || !reader_has_left()))
    context.fail(device_error("standard output: not all could be written"));
  return context.exit_code;
}

}  // namespace turncal
