#include "orchestrator/commands/commands.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <exception>
#include <map>
#include <optional>
#include <type_traits>
#include <utility>

#include <CLI/CLI.hpp>

#include "imu_io/base/data_text.h"
#include "imu_io/base/text.h"
#include "orchestrator/station/version.h"

namespace turncal {

extern const std::string_view command_examples;  // examples.txt

namespace {

// A pipe whose reader has left (| head -1) is no error: the reader has read enough, and the work goes on.
bool reader_has_left() {
  pollfd output{STDOUT_FILENO, POLLOUT, 0};
  return ::poll(&output, 1, 0) == 1 && (output.revents & POLLERR) != 0;
}

// Replaces CLI11's own checks, which let "nan" pass and print limits with 300 digits.
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

// Rejects an empty word, which is an unset variable of a script; CLI11 would treat the option as not given.
CLI::Validator some_text() {
  return CLI::Validator([](std::string& text) { return text.empty() ? "expected a text that is not empty" : ""; }, "");
}

// Discards what a command prints, for --quiet.
class Nowhere : public std::streambuf {
  int_type overflow(int_type c) override { return traits_type::not_eof(c); }
  std::streamsize xsputn(const char*, std::streamsize n) override { return n; }
};

// Accepts one of `values`, which the help shows.
CLI::Validator word_of(const std::vector<std::string>& values) {
  return CLI::Validator(
      [values](std::string& text) {
        if (std::ranges::find(values, text) != values.end()) return std::string();
        return fmt::format("'{}': expected {}", text, one_of(text, values));
      },
      fmt::format("{{{}}}", fmt::join(values, ",")));
}

const std::map<std::string_view, double> seconds_of = {{"s", 1.0}, {"min", 60.0}, {"h", 3600.0}, {"d", 86400.0}};

// Parses "1h30min": numbers, each with its unit.
std::optional<double> seconds_in(std::string_view text) {
  double sum_s = 0.0;
  do {
    const std::size_t number = std::min(text.find_first_of("smhd"), text.size());
    const std::size_t end = std::min(text.find_first_not_of("sminhd", number), text.size());
    const auto unit = seconds_of.find(text.substr(number, end - number));
    const std::optional<double> value = parse_number(text.substr(0, number));
    if (unit == seconds_of.end() || !value || *value < 0.0) return {};
    sum_s += *value * unit->second;
    text.remove_prefix(end);
  } while (!text.empty());
  return sum_s;
}

// Converts a time to a number of `unit`.
CLI::Validator time_in(double low, double high, const std::string& unit) {
  return CLI::Validator(
      [=](std::string& text) {
        const double value = seconds_in(text).value_or(NAN) / seconds_of.at(unit);
        if (!(value >= low && value <= high))
          return fmt::format("'{}': expected a time from {}{} to {}{}, with its unit (s, min, h, d)", text, low, unit,
                             high, unit);
        text = format_number(value);
        return std::string();
      },
      "");
}

// Wraps lines at 100 characters; text in the column of descriptions continues in that column.
std::string wrapped(const std::string& help) {
  constexpr std::size_t width = 100;
  std::string result;
  for (std::string_view rest = help; !rest.empty();) {
    std::string line(next_line(rest));
    const std::size_t column = line.starts_with("  ") ? 30 : 0;
    for (; line.size() > width && line.find(' ', column) < width;
         line = std::string(column, ' ') + line.substr(line.rfind(' ', width) + 1))
      result += line.substr(0, line.rfind(' ', width)) + '\n';
    result += line + '\n';
  }
  return result;
}

class HelpText : public CLI::Formatter {
  std::string make_help(const CLI::App* app, std::string name, CLI::AppFormatMode mode) const override {
    return wrapped(Formatter::make_help(app, std::move(name), mode));
  }
};

// Returns the first two lines of examples.txt for a command, "turncal run", or for turncal itself.
std::string examples_of(const std::string& command) {
  std::string text = "Examples:";
  int found = 0;
  for (std::string_view rest = command_examples; !rest.empty() && found < 2;)
    if (const std::string_view line = next_line(rest); line.starts_with(command + " ") && ++found > 0)
      text += "\n  " + std::string(line);
  return text;
}

// Command names of the previous version.
constexpr std::pair<const char*, const char*> renamed[] = {
    {"database", "records"}, {"restore", "records restore"}, {"prune", "records prune"}, {"fleet report", "shift"}};

// Returns the words of the command line in reverse order, as CLI11 takes them.
std::vector<std::string> words_of(int argc, const char* const* argv, std::ostream& err) {
  std::vector<std::string> words(argv + 1, argv + argc);
  const std::string first = words.empty() ? "" : words.front();
  if (first == "help") {
    std::erase(words, first);
    words.emplace_back("--help");
  }
  for (const auto& [old_name, name] : renamed) {
    const std::vector<std::string_view> before = split(old_name, ' '), now = split(name, ' ');
    if (words.size() < before.size() || !std::equal(before.begin(), before.end(), words.begin())) continue;
    words.erase(words.begin(), words.begin() + std::ssize(before));
    words.insert(words.begin(), now.begin(), now.end());
    err << fmt::format("{}'turncal {}' is 'turncal {}' now; the old name will be removed in the next version\n",
                       error_prefix, old_name, name);
    break;
  }
  std::ranges::reverse(words);
  return words;
}

// Returns the last command named, or the first one that got a word it does not know.
const CLI::App& command_meant(const CLI::App& app) {
  const std::vector<CLI::App*> named = app.get_subcommands();
  return app.remaining().empty() && !named.empty() ? command_meant(*named.front()) : app;
}

// Reports an unknown word before whatever is missing because of it.
Error misunderstood(const CLI::App& app, const std::string& why) {
  const CLI::App* const command = &command_meant(app);
  std::string name;
  for (const CLI::App* one = command; one != nullptr; one = one->get_parent()) name.insert(0, one->get_name() + " ");
  const std::string help = " (see " + name + "--help)";
  const std::vector<std::string> unknown = command->remaining();
  if (unknown.empty()) return input_error(why + help);
  const std::string typed = unknown.front().substr(0, unknown.front().find('='));
  std::vector<std::string> known;
  if (command == &app) known.emplace_back("help");
  for (const CLI::App* other : command->get_subcommands([](const CLI::App*) { return true; }))
    known.push_back(other->get_name());
  for (const CLI::Option* option : command->get_options()) {
    for (const std::string& word : option->get_lnames()) known.push_back("--" + word);
    for (const std::string& word : option->get_snames()) known.push_back("-" + word);
  }
  return input_error("'" + unknown.front() + "' is not understood" + did_you_mean(typed, known) + help);
}

}  // namespace

namespace is {
void required(CLI::Option& option) { option.required(); }
void positive(CLI::Option& option) {
  option.check(number_that([](double x) { return x > 0.0; }, "a number above 0", "POSITIVE"));
}
void one_word_each(CLI::Option& option) { option.allow_extra_args(false); }
void default_in_help(CLI::Option& option) {
  option.capture_default_str();
  if (option.get_type_name() == "TIME") option.default_str(option.get_default_str() + "s");
}
Condition words(int count) {
  return [=](CLI::Option& option) { option.expected(count); };
}
Condition in(int low, int high) {
  return [=](CLI::Option& option) { option.check(number_in(low, high, "a whole number")); };
}
Condition in(double low, double high) {
  return [=](CLI::Option& option) { option.check(number_in(low, high, "a number")); };
}
Condition one_of(const std::vector<std::string>& values) {
  return [=](CLI::Option& option) { option.check(word_of(values)); };
}
Condition time(double low, double high, const std::string& unit) {
  return [=](CLI::Option& option) {
    option.type_name("TIME")->transform(time_in(low, high, unit));
    option.description(option.get_description() + " (90s, 40min, 1h30min, 30d)");
  };
}
}  // namespace is
void needs(CLI::Option* option, CLI::Option* other) { option->needs(other); }

CLI::Option* Command::option(const std::string& name, const Place& place, const std::vector<Condition>& conditions,
                             const std::string& help) const {
  const auto add = [&](auto* value) {
    CLI::Option* const option = app_->add_option(name, *value, help);
    using Value = std::remove_pointer_t<decltype(value)>;
    if constexpr (std::is_same_v<Value, std::string> || std::is_same_v<Value, std::vector<std::string>>)
      option->check(some_text());
    return option;
  };
  CLI::Option* const option = std::visit(add, place.value);
  for (const Condition& condition : conditions) condition(*option);
  return option;
}

void Command::flag(const std::string& name, bool& value, const std::string& help) const {
  app_->add_flag(name, value, help);
}

void Command::format(std::string& value, const std::string& help) const {
  option("--format", value, {is::one_of(data_formats)}, help);
}

CLI::App* CommandLine::add(const std::string& name, const std::string& help) {
  CLI::App* const app = app_.add_subcommand(name, help)->group(group_);
  std::string command = name;
  for (const CLI::App* above = &app_; above != nullptr; above = above->get_parent())
    command = above->get_name() + " " + command;
  return app->footer(examples_of(command));
}

CommandLine CommandLine::family(const std::string& name, const std::string& help) {
  return {*add(name, help)->require_subcommand(1), context_};
}

Command CommandLine::add(const std::string& name, const std::string& help, std::function<Status()> job) {
  const Command command(add(name, help));
  command.flag("--quiet", context_.quiet, "print nothing but errors");
  command.app_->callback([&context = context_, job = std::move(job)] {
    static Nowhere nowhere;
    if (context.quiet) context.out.rdbuf(&nowhere);
    if (Status status = job(); !status) context.fail(status.error());
  });
  return command;
}

int run_command_line(int argc, const char* const* argv, const std::vector<CommandGroup>& groups,
                     CommandContext& context) {
  std::streambuf* const out = context.out.rdbuf();
  try {
    CLI::App app("Calibrates a strapdown laser-gyro IMU on a three-axis turntable.", "turncal");
    app.formatter(std::make_shared<HelpText>());
    app.set_help_flag("-h,--help", "print this help and exit");
    app.set_version_flag("-V,--version", std::string("turncal ") + software_version(), "print the version and exit");
    app.require_subcommand(1);
    app.footer(examples_of("turncal"));
    CommandLine line(app, context);
    for (const CommandGroup& group : groups) {
      line.set_group(group.name);
      for (AddCommand* const add : group.commands) add(line);
    }
    try {
      app.parse(words_of(argc, argv, context.err));
    } catch (const CLI::Success& success) {  // --help, --version
      const CLI::App& command = command_meant(app);
      const bool knows_it = command.remaining().empty() || command.get_require_subcommand_min() == 0;
      knows_it ? void(app.exit(success, context.out, context.err)) : context.fail(misunderstood(app, ""));
    } catch (const CLI::ParseError& error) {
      // Replaces CLI11's own words.
      constexpr std::string_view no_number = "Could not convert: ", no_word = ": 1 required ";
      std::string why = error.what();
      if (why.starts_with(no_number)) why = why.substr(no_number.size()) + ": expected a number of its kind";
      if (const std::size_t at = why.find(no_word); at < why.size()) why = why.substr(0, at) + ": expected a value";
      if (why == "A subcommand is required") why = "expected a command";
      context.fail(misunderstood(app, why));
    }
  } catch (const std::exception& error) {
    context.fail({ErrorKind::internal, std::string("internal error: ") + error.what()});
  } catch (...) {  // so that the stack is unwound, which stops a table
    context.fail({ErrorKind::internal, "internal error"});
  }
  if (context.quiet) context.out.rdbuf(out);
  context.out.flush();
  if (!context.out && context.exit_code == 0 && !reader_has_left())
    context.fail(device_error("standard output: not all could be written"));
  return context.exit_code;
}

}  // namespace turncal
