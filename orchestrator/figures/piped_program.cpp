#include "orchestrator/figures/piped_program.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/wait.h>

#include <cerrno>
#include <chrono>
#include <cstring>
#include <thread>
#include <utility>

#include "imu_io/base/posix_file.h"
#include "orchestrator/figures/report_format.h"

extern char** environ;

namespace turncal {
namespace {

using SteadyClock = std::chrono::steady_clock;

Error failed(const std::string& what) { return {ErrorKind::internal, what}; }

bool make_pipe(Descriptor& read_end, Descriptor& write_end) {
  int fds[2];
  if (::pipe2(fds, O_CLOEXEC) != 0) return false;
  read_end = Descriptor(fds[0]);
  write_end = Descriptor(fds[1]);
  return true;
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
      if (ended < 0 && errno != EINTR) return false;
      if (SteadyClock::now() >= deadline) return false;
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
  }

 private:
  pid_t pid_ = -1;
};

// Reads what is there. False at the end.
bool drain(int fd, std::string& text) {
  char buffer[65536];
  const ssize_t count = ::read(fd, buffer, sizeof buffer);
  if (count < 0) return errno == EINTR || errno == EAGAIN;
  text.append(buffer, static_cast<std::size_t>(count));
  return count > 0;
}

std::string first_line(const std::string& text) {
  std::size_t begin = 0;
  while (begin < text.size()) {
    const std::size_t end = std::min(text.find('\n', begin), text.size());
    std::string line = text.substr(begin, end - begin);
    const std::size_t start = line.find_first_not_of(" \t^\r");
    if (start != std::string::npos) return line.substr(start, 160);
    begin = end + 1;
  }
  return {};
}

}  // namespace

Result<PipedOutput> pipe_through(const PipedProgram& program, std::string_view input) {
  const auto deadline = SteadyClock::now() + std::chrono::duration_cast<SteadyClock::duration>(
                                                 std::chrono::duration<double>(program.deadline_s));
  int sockets[2];
  if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, sockets) != 0)
    return failed(std::string("cannot make a socket: ") + std::strerror(errno));
  Descriptor to_child(sockets[0]);
  Descriptor child_in(sockets[1]);
  Descriptor from_child, child_out, errors, child_err;
  if (!make_pipe(from_child, child_out) || !make_pipe(errors, child_err))
    return failed(std::string("cannot make a pipe: ") + std::strerror(errno));
  Child child;
  if (const int error = child.spawn(program, child_in, child_out, child_err); error != 0)
    return failed(error == ENOENT ? program.name + " is not installed (Debian package " + program.package + ")"
                                  : "cannot start " + program.name + ": " + std::strerror(error));
  child_in = Descriptor();
  child_out = Descriptor();
  child_err = Descriptor();

  std::string output;
  std::string messages;
  while (from_child >= 0 || errors >= 0) {
    const double left_s = std::chrono::duration<double>(deadline - SteadyClock::now()).count();
    if (left_s <= 0.0) return failed(program.name + " took longer than " + significant(program.deadline_s, 3) + " s");
    pollfd fds[3] = {{from_child, POLLIN, 0}, {errors, POLLIN, 0}, {to_child, POLLOUT, 0}};
    const int ready = ::poll(fds, 3, static_cast<int>(1000.0 * left_s) + 1);
    if (ready < 0 && errno != EINTR) return failed(std::string("poll: ") + std::strerror(errno));
    if (ready <= 0) continue;
    if (fds[0].revents != 0 && !drain(from_child, output)) from_child = Descriptor();
    if (fds[1].revents != 0 && !drain(errors, messages)) errors = Descriptor();
    if (fds[2].revents == 0) continue;
    // A child that died does not take this process with it: MSG_NOSIGNAL.
    const ssize_t sent = ::send(to_child, input.data(), input.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
    if (sent > 0) input.remove_prefix(static_cast<std::size_t>(sent));
    if (input.empty() || (sent < 0 && errno != EAGAIN && errno != EINTR)) to_child = Descriptor();
  }
  int status = 0;
  if (!child.wait_until(deadline, status)) return failed(program.name + " did not end");
  if (!WIFEXITED(status) || WEXITSTATUS(status) != 0) {
    const std::string line = first_line(messages);
    return failed(program.name + " stopped with an error" + (line.empty() ? "" : ": " + line));
  }
  return PipedOutput{std::move(output), first_line(messages)};
}

}  // namespace turncal
