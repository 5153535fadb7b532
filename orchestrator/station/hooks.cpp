#include "orchestrator/station/hooks.h"

#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstring>
#include <thread>
#include <vector>

#include "imu_io/base/clock.h"
#include "imu_io/base/posix_file.h"

extern char** environ;

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
  const auto failed = [&name](const std::string& what) { return device_error(name + ": " + what); };
  Descriptor input;
  if (!call.input.empty()) {  // in memory, so that nobody waits for who does not read
    input = ::memfd_create("event", MFD_CLOEXEC);
    const auto size = static_cast<ssize_t>(call.input.size());
    if (input < 0 || ::write(input, call.input.data(), call.input.size()) != size || ::lseek(input, 0, SEEK_SET) != 0)
      return failed(std::string("its input cannot be made: ") + std::strerror(errno));
  }

  // Everything is allocated before the fork: there may be other threads.
  std::vector<std::string> texts = {
      "TURNCAL_EVENT=" + call.event,     "TURNCAL_UNIT=" + call.unit,
      "TURNCAL_FOLDER=" + call.folder,   "TURNCAL_MESSAGE=" + call.message,
      "TURNCAL_OUTCOME=" + call.outcome, std::string("TURNCAL_DRY_RUN=") + (call.dry_run ? "true" : "false")};
  std::vector<char*> environment;
  for (std::string& text : texts) environment.push_back(text.data());
  for (char** entry = environ; *entry; ++entry) {
    if (std::strncmp(*entry, "TURNCAL_", 8) != 0) environment.push_back(*entry);
  }
  environment.push_back(nullptr);
  std::string text = command, shell = "/bin/sh", option = "-c";
  char* const arguments[] = {shell.data(), option.data(), text.data(), nullptr};

  const pid_t pid = ::fork();
  if (pid < 0) return failed(std::string("cannot be started: ") + std::strerror(errno));
  if (pid == 0) {
    ::setpgid(0, 0);
    if (input >= 0) ::dup2(input, STDIN_FILENO);
    // What a run ignores is its own affair.
    for (const int ignored : {SIGPIPE, SIGXFSZ, SIGTSTP, SIGTTIN, SIGTTOU}) ::signal(ignored, SIG_DFL);
    ::execve(shell.c_str(), arguments, environment.data());
    ::_exit(127);
  }
  const Deadline deadline(time_s);
  for (;;) {
    int status = 0;
    const pid_t ended = ::waitpid(pid, &status, WNOHANG);
    if (ended == pid) {
      if (WIFEXITED(status) && WEXITSTATUS(status) == 0) return {};
      return failed(WIFEXITED(status) ? "ended with code " + std::to_string(WEXITSTATUS(status))
                                      : "was ended by signal " + std::to_string(WTERMSIG(status)));
    }
    if (ended < 0 && errno != EINTR) return failed(std::string("cannot be waited for: ") + std::strerror(errno));
    const bool late = deadline.passed();
    if (late || (give_up && give_up())) {
      ::kill(-pid, SIGKILL);
      ::waitpid(pid, &status, 0);
      return failed(late ? "did not end within its time and was killed" : "was interrupted and killed");
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
}

}  // namespace turncal
