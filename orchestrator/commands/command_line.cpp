#include "orchestrator/commands/command_line.h"

#include <exception>

#include "orchestrator/station/version.h"

namespace turncal {

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
