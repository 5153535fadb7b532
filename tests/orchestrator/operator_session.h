// For tests: the program with an operator before it, who reads every line of its output and may answer it.
#pragma once

#include <poll.h>

#include "imu_io/base/clock.h"
#include "tests/orchestrator/program.h"

namespace turncal {

class OperatedProgram : public Program {
 protected:
  using Session = ProgramResult;
  // What to type after a line was read; `hang_up` closes the input.
  using Operator = std::function<std::optional<std::string>(const std::string& line)>;
  mutable pid_t pid_ = -1;  // of the program that is operated
  static inline const std::string hang_up = "\x04";

  Session operate(const Arguments& arguments, const Operator& answer, double seconds = 120.0) const {
    int in[2], out[2];
    EXPECT_EQ(::pipe2(in, O_CLOEXEC), 0);
    EXPECT_EQ(::pipe2(out, O_CLOEXEC), 0);
    const std::string err = folder_.string() + ".err";
    const pid_t pid = ::fork();
    if (pid == 0) {
      ::dup2(in[0], 0);
      ::dup2(out[1], 1);
      ::dup2(::open(err.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644), 2);
      become_program(arguments);
    }
    pid_ = pid;
    ::close(in[0]);
    ::close(out[1]);
    Session session;
    const Deadline deadline(seconds);
    std::size_t taken = 0;
    for (;;) {
      pollfd which{out[0], POLLIN, 0};
      if (::poll(&which, 1, deadline.left_ms()) <= 0 && deadline.passed()) {
        ADD_FAILURE() << "not over within " << seconds << " s:\n" << session.out;
        ::kill(pid, SIGKILL);
        break;
      }
      char chunk[4096];
      const ssize_t got = ::read(out[0], chunk, sizeof chunk);
      if (got <= 0) break;
      session.out.append(chunk, std::size_t(got));
      for (std::size_t end; (end = session.out.find('\n', taken)) != std::string::npos; taken = end + 1) {
        const std::optional<std::string> reply = answer(session.out.substr(taken, end - taken));
        if (!reply || in[1] < 0) continue;
        if (*reply != hang_up) {
          const std::string text = *reply + "\n";
          EXPECT_EQ(::write(in[1], text.data(), text.size()), static_cast<ssize_t>(text.size()));
        } else {
          ::close(in[1]);
          in[1] = -1;
        }
      }
    }
    if (in[1] >= 0) ::close(in[1]);
    ::close(out[0]);
    int status = 0;
    ::waitpid(pid, &status, 0);
    session.code = WIFEXITED(status) ? WEXITSTATUS(status) : -1000 - WTERMSIG(status);
    session.err = file_text(err);
    std::filesystem::remove(err);
    return session;
  }

  struct Question {
    std::string axis;
    double target_deg = 0.0;
    bool homing = false;
  };
  // The line that asks for an angle.
  static std::optional<Question> question(const std::string& line) {
    std::istringstream words(line);
    std::string word;
    Question asked;
    for (bool of_question = false; words >> word;) {
      if (word == "Where" && words >> word >> word >> asked.axis) return Question{asked.axis, 0.0, true};
      if (word == "Turn" && line.find("; then type the angle") != std::string::npos)
        of_question = static_cast<bool>(words >> asked.axis);
      if (of_question && word == "to" && words >> asked.target_deg) return asked;
    }
    return {};
  }
};

}  // namespace turncal
