#include "orchestrator/commands/command_check_line.h"

#include <memory>

#include "orchestrator/commands/command_check.h"

namespace turncal {

void add_check_command(CLI::App& app, CommandContext& context) {
  const auto options = std::make_shared<CheckOptions>();
  CLI::App* command = app.add_subcommand("check", "validate station and sequence, print the plan; nothing moves");
  command->add_option("--station", options->station, "station configuration; default: the built-in rig station");
  command->add_option("--sequence", options->sequence, "sequence file")->required();
  command->callback([options, &context] { context.exit_code = run_check(*options, context.out, context.err); });
}

}  // namespace turncal
