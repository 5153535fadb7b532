#include "orchestrator/station/child_program.h"

#include <fmt/format.h>
#include <spawn.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstring>
#include <thread>

#include "imu_io/base/clock.h"
#include "imu_io/base/files.h"
#include "imu_io/base/text.h"

namespace turncal {

namespace {

Error failed(const std::string& what, int error) { return {ErrorKind::internal, what + ": " + std::strerror(error)}; }

// Returns a file in memory, positioned at its start. Unlike a pipe it never blocks a writer whose reader does not read.
Result<Descriptor> file_with(std::string_view text) {
  Descriptor file(::memfd_create("child", MFD_CLOEXEC));
  while (file >= 0 && !text.empty()) {
    const ssize_t written = ::write(file, text.data(), text.size());
    if (written > 0)
      text.remove_prefix(std::size_t(written));
    else if (written == 0 || errno != EINTR)
      break;
  }
  if (file < 0 || !text.empty() || ::lseek(file, 0, SEEK_SET) != 0)
    return failed("cannot make a file in memory", errno);
  return file;
}
Result<std::string> text_in(const Descriptor& file) {  // from its start, wherever the child's position is
  if (file < 0) return std::string();
  return read_whole_file("/proc/self/fd/" + std::to_string(file), std::string::npos);
}
bool is_longer(const Descriptor& file, std::size_t bytes) {
  struct stat facts {};
  return file >= 0 && ::fstat(file, &facts) == 0 && std::size_t(facts.st_size) > bytes;
}

std::vector<char*> pointers_to(std::vector<std::string>& texts) {
  std::vector<char*> pointers;
  for (std::string& text : texts) pointers.push_back(text.data());
  pointers.push_back(nullptr);
  return pointers;
}

// Starts the program in a process group of its own, with default signal handling, so that it is killed as a whole. Returns an error number, or 0.
int spawn(const ChildProgram& program, const std::array<const Descriptor*, 3>& files, pid_t& pid) {
  std::vector<std::string> words = program.words, environment = program.environment;
  for (char** entry = environ; *entry != nullptr; ++entry)
    if (!std::string_view(*entry).starts_with(program.replaced)) environment.emplace_back(*entry);
  posix_spawn_file_actions_t actions;
  posix_spawnattr_t how;
  posix_spawn_file_actions_init(&actions);
  posix_spawnattr_init(&how);
  for (std::size_t k = 0; k < files.size(); ++k)
    if (*files[k] >= 0) posix_spawn_file_actions_adddup2(&actions, *files[k], int(k));
  sigset_t signals;
  sigemptyset(&signals);
  posix_spawnattr_setsigmask(&how, &signals);
  for (const int ignored : {SIGPIPE, SIGXFSZ, SIGTSTP, SIGTTIN, SIGTTOU}) sigaddset(&signals, ignored);
  posix_spawnattr_setsigdefault(&how, &signals);
  posix_spawnattr_setflags(&how, POSIX_SPAWN_SETPGROUP | POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETSIGMASK);
  const int error = ::posix_spawnp(&pid, words.front().c_str(), &actions, &how, pointers_to(words).data(),
                                   pointers_to(environment).data());
  posix_spawnattr_destroy(&how);
  posix_spawn_file_actions_destroy(&actions);
  return error;
}

}  // namespace

std::string ChildEnd::message() const {
  constexpr std::size_t longest = 160;
  for (std::string_view rest = errors; !rest.empty();) {
    const std::string_view line = next_line(rest);
    const std::size_t start = line.find_first_not_of(" \t^\r");
    if (start != std::string_view::npos) return ": " + std::string(line.substr(start, longest));
  }
  return "";
}

Result<ChildEnd> run_child(const ChildProgram& program) {
  const Deadline deadline(program.time_s);
  Descriptor input, output, errors;
  if (program.input) input = TRY(file_with(*program.input));
  if (program.most_printed > 0) {
    output = TRY(file_with(""));
    errors = TRY(file_with(""));
  }
  pid_t pid = -1;
  const int error = spawn(program, {&input, &output, &errors}, pid);
  if (error == ENOENT && !program.package.empty())
    return Error{ErrorKind::internal,
                 fmt::format("{} is not installed (Debian package {})", program.words.front(), program.package)};
  if (error != 0) return failed("cannot start " + program.words.front(), error);
  ChildEnd end;
  for (;;) {
    int status = 0;
    const pid_t ended = ::waitpid(pid, &status, end.killed.empty() ? WNOHANG : 0);
    if (ended < 0 && errno != EINTR) return failed("cannot wait for " + program.words.front(), errno);
    if (ended == pid) {
      end.code = WIFEXITED(status) ? WEXITSTATUS(status) : 0;
      end.signal = WIFSIGNALED(status) ? WTERMSIG(status) : 0;
      end.output = TRY(text_in(output));
      end.errors = TRY(text_in(errors));
      return end;
    }
    if (deadline.passed()) end.killed = "did not end within its time and was killed";
    if (program.give_up && program.give_up()) end.killed = "was interrupted and killed";
    if (is_longer(output, program.most_printed) || is_longer(errors, program.most_printed))
      end.killed = fmt::format("printed more than {} KiB and was killed", program.most_printed >> 10U);
    if (end.killed.empty())
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    else
      ::kill(-pid, SIGKILL);
  }
}

Result<ChildEnd> pipe_through(const std::string& package, std::vector<std::string> words, std::string_view input,
                              double time_s) {
  const std::string name = words.front();
  ChildEnd end = TRY(run_child({.words = std::move(words),
                                .package = package,
                                .environment = {"LC_ALL=C.UTF-8"},
                                .replaced = "LC_",
                                .input = input,
                                .most_printed = std::size_t{1} << 26U,
                                .time_s = time_s}));
  if (end.good()) return end;
  return Error{ErrorKind::internal,
               name + " " + (end.killed.empty() ? "stopped with an error" + end.message() : end.killed)};
}

// ---- commands of the station ----

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
  constexpr std::size_t most_printed = std::size_t{1} << 20U;  // with an input of its own nobody reads along
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
