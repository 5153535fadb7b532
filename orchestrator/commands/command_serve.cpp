// `turncal serve`: what several stations do, on a page of a process of its own, whether a run is going on or not.
#include <chrono>
#include <memory>
#include <thread>

#include "orchestrator/commands/commands.h"
#include "orchestrator/devices/stop_signals.h"
#include "orchestrator/service/service_page.h"
#include "orchestrator/watch/progress.h"

namespace turncal {

namespace {

struct ServeOptions {
  std::string file, listen = "127.0.0.1:8081";
};

Status serve(const ServeOptions& options, CommandContext& context) {
  const ServiceConfig config = TRY(read_service_config(options.file));
  const std::unique_ptr<ServicePage> page = TRY(ServicePage::open(options.listen, config, wall_utc_s));
  const StopSignals signals;
  context.out << "stations  " << page->url() << std::endl;
  if (!page->loopback())
    context.out << "warning: whoever reaches " << page->url()
                << " can read the page: it has no access control and is not encrypted" << std::endl;
  while (!StopSignals::any()) std::this_thread::sleep_for(std::chrono::milliseconds(100));
  return {};
}

}  // namespace

void add_serve_command(CommandLine& line, CommandContext& context) {
  const auto options = std::make_shared<ServeOptions>();
  const Command command = line.command("serve", "show what stations do, and what waits for a person, as a page");
  command.option("stations", options->file, "file that names the stations, their queues and folders").required();
  command.option("--listen", options->listen, "address and port of the page").default_in_help();
  command.runs(context, [options, &context] { return serve(*options, context); });
}

}  // namespace turncal
