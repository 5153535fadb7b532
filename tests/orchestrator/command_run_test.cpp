// `turncal run --dry-run` as a black box: results, reproducibility, faults, refusals, signals.

#include <thread>

#include "tests/orchestrator/program.h"

namespace turncal {
namespace {

class Run : public Program {};

TEST_F(Run, SignalsAreExit75AndStopTheTable) {
  // Long enough that the signal comes in the middle.
  std::string text =
      "format = 1\nname = long\nrate_degps = 10\nacceleration_degps2 = 20\nstep 1\n  initial H 0 P 0 R 0\n  align "
      "1000\n";
  for (int i = 0; i < 40; ++i) text += "  dwell 2000000\n";  // 5 GB, were it to end
  const std::string sequence = write("long.seq", text);
  for (const int signal :
       {SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGUSR1, SIGUSR2, SIGALRM, SIGVTALRM, SIGPROF, SIGPWR, SIGIO, SIGXCPU}) {
    SCOPED_TRACE(strsignal(signal));
    const std::string out = "out" + std::to_string(signal);
    const pid_t pid =
        start({"run", "--dry-run", "--unit", "SN1", "--out", out, "--sequence", sequence, "--capture-only"});
    for (int i = 0; i < 500 && !std::filesystem::exists(folder_ / out / "recording.partial.tcr"); ++i) ::usleep(10'000);
    ::usleep(20'000);
    ::kill(pid, signal);
    const ProgramResult result = finish(pid);
    EXPECT_EQ(result.code, 75) << result.err;
    EXPECT_EQ(result.err_lines(), 1) << result.err;
    EXPECT_SAYS(result.err, signal == SIGINT
                                ? ": paused; the table rests, its drives are off; resume with: turncal resume "
                                : ": told to end");
    EXPECT_SAYS(file_text(folder_ / out / "run.log"), "stopped_verified");
    EXPECT_FALSE(std::filesystem::exists(folder_ / out / "parameters.conf"));
  }
}

// `turncal run ... | head -1` and a terminal that is closed: the first goes on, the second stops the table and ends.
TEST_F(Run, OutputThatNobodyReadsDoesNotKillIt) {
  const std::string command = "cd " + folder_.string() + " && { " + TURNCAL_BINARY +
                              " run --dry-run --unit SN1 --out out --verbose --pace 400 --sequence " + short_demo +
                              "; echo $? > code; } | head -1 > /dev/null";
  ASSERT_EQ(std::system(command.c_str()), 0);
  EXPECT_EQ(file_text(folder_ / "code"), "0\n");
  EXPECT_TRUE(std::filesystem::exists(folder_ / "out/parameters.conf"));
}

TEST_F(Run, IsRefusedWhereCheckSaysSo) {
  const std::string few = first_steps("2");
  write("full.station", station_head + "motion.settle_s = 0.5\nrecord.database = here/results.db\n");
  write("here", "a file");
  for (const auto& [more, code] : {std::pair("", 1),
                                   {"--partial", 0},
                                   {"--capture-only", 0},
                                   {"--partial --capture-only", 1},
                                   {"--capture-only --verify", 1},
                                   {"--capture-only --unit SN1", 1},
                                   {"--capture-only --station full.station", 1}}) {
    const Arguments both = "--sequence " + few + " --unit SN1 --out out " + more;
    ends("check" + both, code);
    ends("run --dry-run --no-diagnosis" + both, code);
    std::filesystem::remove_all(folder_ / "out");
  }
}

// A pager, or a terminal stopped with Ctrl-S: the run goes on to its end; only what it prints at last has to wait.
TEST_F(Run, OutputThatIsNotReadDoesNotHoldItUp) {
  const std::string fifo = folder_.string() + ".out";
  ASSERT_EQ(::mkfifo(fifo.c_str(), 0600), 0);
  const int reader = ::open(fifo.c_str(), O_RDONLY | O_NONBLOCK);
  ASSERT_GE(::fcntl(reader, F_SETPIPE_SZ, 4096), 0);
  const pid_t pid =
      start({"run", "--dry-run", "--unit", "SN1", "--out", "out", "--no-diagnosis", "--sequence", short_demo});
  bool recorded = false;
  for (int i = 0; i < 3000 && !recorded; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    recorded = file_text(folder_ / "out/run.log").find("sequence_complete") != std::string::npos;
  }
  EXPECT_TRUE(recorded) << "the run stands";
  std::string said;
  int status = 0;
  for (bool ended = false; !ended;) {
    ended = ::waitpid(pid, &status, WNOHANG) == pid;
    char piece[4096];
    for (ssize_t n = 0; (n = ::read(reader, piece, sizeof piece)) > 0;) said.append(piece, std::size_t(n));
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  ::close(reader);
  std::filesystem::remove(fifo);
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0);
  EXPECT_SAYS(said, "Dry run complete");
}

// `turncal run --continue`: a further recording of the same unit, calibrated and diagnosed with what it continues.
class ContinuedRun : public Program {};

TEST_F(ContinuedRun, IsTheSameAfterAKill) {
  ends(quick_run("first"), 0);
  expect_same_after_kills("run --continue first --sequence quick.seq", "first/continued", {0.33, 0.66, -12, -3});
}

// ---- the examples of the help ----

class CommandLine : public Program {};

// An example whose options are not those of its command would say so before it looks for its files.
TEST_F(CommandLine, ExamplesAreUnderstood) {
  int tried = 0;
  for (const std::string& line :
       lines_of(file_text(std::string(TURNCAL_SOURCE_DIR) + "/orchestrator/commands/examples.txt"))) {
    ASSERT_TRUE(line.starts_with("turncal ") && line.size() <= 98) << line;
    if (line.find("--dry-run") != std::string::npos || line.find(" design ") != std::string::npos) continue;
    const ProgramResult result = run(Arguments(line.substr(8)));
    EXPECT_SAYS_NOT(result.err, "--help)") << line;
    ++tried;
  }
  EXPECT_GT(tried, 50);
}

}  // namespace
}  // namespace turncal
