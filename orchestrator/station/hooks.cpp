#include "orchestrator/station/hooks.h"

#include <algorithm>

#include "orchestrator/station/child_program.h"

namespace turncal {

HookCall call_for(const Status& outcome) {
  HookCall call;
  call.event = outcome ? "done" : outcome.error().kind == ErrorKind::unit_failed ? "fail" : "needs_operator";
  call.message = outcome ? "" : outcome.error().message;
  return call;
}

Status run_hook(const HookCommands& commands, const HookCall& call, double time_s,
                const std::function<bool()>& give_up) {
  const auto hook = std::ranges::find_if(hook_events, [&](const auto& one) { return call.event == one.first; });
  return run_command("hook." + call.event, commands.*hook->second, call, time_s, give_up);
}

Status run_command(const std::string& name, const std::string& command, const HookCall& call, double time_s,
                   const std::function<bool()>& give_up) {
  if (command.empty()) return {};
  constexpr std::size_t most_printed = std::size_t{1} << 20U;  // of one that is given an input: nobody reads along
  const auto failed = [&name](const std::string& what) { return device_error(name + ": " + what); };
  ChildProgram child{
      .words = {"/bin/sh", "-c", command},
      .package = "",
      .environment = {"TURNCAL_EVENT=" + call.event, "TURNCAL_UNIT=" + call.unit, "TURNCAL_FOLDER=" + call.folder,
                      "TURNCAL_MESSAGE=" + call.message, "TURNCAL_OUTCOME=" + call.outcome,
                      std::string("TURNCAL_DRY_RUN=") + (call.dry_run ? "true" : "false")},
      .replaced = "TURNCAL_",
      .time_s = time_s,
      .give_up = give_up};
  if (!call.input.empty()) {
    child.input = call.input;
    child.most_printed = most_printed;
  }
  const Result<ChildEnd> end = run_child(child);
  if (!end) return failed(end.error().message);
  if (end->good()) return {};
  const std::string how = !end->killed.empty() ? end->killed
                          : end->signal == 0   ? "ended with code " + std::to_string(end->code)
                                               : "was ended by signal " + std::to_string(end->signal);
  return failed(how + end->message());
}

}  // namespace turncal
