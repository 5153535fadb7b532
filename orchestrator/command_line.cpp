#include "orchestrator/command_line.h"

#include <algorithm>
#include <exception>

namespace turncal {

namespace {

std::string one_line(std::string text) {
  while (!text.empty() && (text.back() == '\n' || text.back() == ' ')) text.pop_back();
  std::replace(text.begin(), text.end(), '\n', ' ');
  return text;
}

}  // namespace

void CommandContext::fail(const Error& error) {
  err << tag << "turncal: " << one_line(error.message) << std::endl;
  exit_code = turncal::exit_code(error.kind);
}

const char* software_version() { return TURNCAL_VERSION; }

int run_command_line(int argc, const char* const* argv, const std::vector<AddCommand>& commands,
                     CommandContext& context) {
  try {
    CLI::App app("Calibrates a strapdown laser-gyro IMU on a three-axis turntable.", "turncal");
    app.set_version_flag("--version", std::string("turncal ") + software_version());
    app.require_subcommand(1);
    for (const AddCommand add : commands) add(app, context);
    try {
      app.parse(argc, argv);
    } catch (const CLI::Success& success) {  // --help, --version
      app.exit(success, context.out, context.err);
      return 0;
    } catch (const CLI::ParseError& error) {
      // A word that is not understood is said before what is missing because of it.
      const std::vector<std::string> unknown = app.remaining(true);
      const std::string what = unknown.empty() ? error.what() : "'" + unknown.front() + "' is not understood";
      context.fail(input_error(what + " (see turncal --help)"));
    }
  } catch (const std::exception& error) {
    context.fail({ErrorKind::internal, std::string("internal error: ") + error.what()});
  }
  return context.exit_code;
}

}  // namespace turncal
