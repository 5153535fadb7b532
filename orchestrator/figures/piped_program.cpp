#include "orchestrator/figures/piped_program.h"

#include <fmt/format.h>
#include <signal.h>
#include <spawn.h>
#include <sys/mman.h>
#include <sys/wait.h>

#include <cerrno>
#include <chrono>
#include <cstring>
#include <thread>
#include <utility>

#include "imu_io/base/posix_file.h"
#include "imu_io/base/text_pieces.h"
#include "orchestrator/figures/report_format.h"

extern char** environ;

namespace turncal {
namespace {

using SteadyClock = std::chrono::steady_clock;

Error failed(const std::string& what) { return {ErrorKind::internal, what}; }

// In memory, at its beginning.
Result<Descriptor> file_with(std::string_view text) {
  Descriptor file(::memfd_create("piped", MFD_CLOEXEC));
  while (file >= 0 && !text.empty()) {
    const ssize_t written = ::write(file, text.data(), text.size());
    if (written > 0)
      text.remove_prefix(static_cast<std::size_t>(written));
    else if (written == 0 || errno != EINTR)
      break;
  }
  if (file < 0 || !text.empty() || ::lseek(file, 0, SEEK_SET) != 0)
    return failed(std::string("cannot make a file in memory: ") + std::strerror(errno));
  return file;
}
// From its beginning, wherever the child has come to.
Result<std::string> text_in(const Descriptor& file) {
  return read_whole_file("/proc/self/fd/" + std::to_string(file), std::size_t{1} << 30);
}

// The environment with the C locale: decimal points, whatever the user's language.
std::vector<char*> plain_environment() {
  static char locale[] = "LC_ALL=C.UTF-8";
  std::vector<char*> result;
  for (char** entry = environ; *entry != nullptr; ++entry)
    if (std::strncmp(*entry, "LC_", 3) != 0) result.push_back(*entry);
  result.push_back(locale);
  result.push_back(nullptr);
  return result;
}

// A child that is killed and reaped when nobody waited for it.
class Child {
 public:
  ~Child() {
    if (pid_ <= 0) return;
    ::kill(pid_, SIGKILL);
    while (::waitpid(pid_, nullptr, 0) < 0 && errno == EINTR) {
    }
  }
  int spawn(const PipedProgram& program, int in, int out, int err) {
    posix_spawn_file_actions_t actions;
    if (const int error = posix_spawn_file_actions_init(&actions); error != 0) return error;
    posix_spawn_file_actions_adddup2(&actions, in, STDIN_FILENO);
    posix_spawn_file_actions_adddup2(&actions, out, STDOUT_FILENO);
    posix_spawn_file_actions_adddup2(&actions, err, STDERR_FILENO);
    std::vector<std::string> words = program.arguments;
    words.insert(words.begin(), program.name);
    std::vector<char*> arguments;
    for (std::string& word : words) arguments.push_back(word.data());
    arguments.push_back(nullptr);
    std::vector<char*> environment = plain_environment();
    pid_t pid = -1;
    const int error = posix_spawnp(&pid, program.name.c_str(), &actions, nullptr, arguments.data(), environment.data());
    posix_spawn_file_actions_destroy(&actions);
    if (error == 0) pid_ = pid;
    return error;
  }
  // The wait status once the child has ended by itself before `deadline`.
  bool wait_until(SteadyClock::time_point deadline, int& status) {
    for (;;) {
      const pid_t ended = ::waitpid(pid_, &status, WNOHANG);
      if (ended == pid_) {
        pid_ = -1;
        return true;
      }
      if ((ended < 0 && errno != EINTR) || SteadyClock::now() >= deadline) return false;
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
  }

 private:
  pid_t pid_ = -1;
};

std::string first_line(std::string_view text) {
  while (!text.empty()) {
    const std::string_view line = next_line(text);
    const std::size_t start = line.find_first_not_of(" \t^\r");
    if (start != std::string_view::npos) return std::string(line.substr(start, 160));
  }
  return {};
}

}  // namespace

Result<PipedOutput> pipe_through(const PipedProgram& program, std::string_view input) {
  const auto deadline = SteadyClock::now() + std::chrono::duration_cast<SteadyClock::duration>(
                                                 std::chrono::duration<double>(program.deadline_s));
  const Descriptor in = TRY(file_with(input)), out = TRY(file_with("")), err = TRY(file_with(""));
  Child child;
  if (const int error = child.spawn(program, in, out, err); error != 0)
    return failed(error == ENOENT
                      ? fmt::format("{} is not installed (Debian package {})", program.name, program.package)
                      : fmt::format("cannot start {}: {}", program.name, std::strerror(error)));
  int status = 0;
  if (!child.wait_until(deadline, status))
    return failed(fmt::format("{} took longer than {} s", program.name, significant(program.deadline_s, 3)));
  const std::string message = first_line(TRY(text_in(err)));
  if (!WIFEXITED(status) || WEXITSTATUS(status) != 0)
    return failed(program.name + " stopped with an error" + (message.empty() ? "" : ": " + message));
  return PipedOutput{TRY(text_in(out)), message};
}

}  // namespace turncal
