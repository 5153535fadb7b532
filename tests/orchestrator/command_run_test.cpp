// `turncal run --dry-run` as a black box: results, reproducibility, faults, refusals, signals.

#include <thread>

#include "tests/orchestrator/program.h"

namespace turncal {
namespace {

class Run : public Program {};

TEST_F(Run, TruthOfAnEffectIsWritten) {
  const ProgramResult result = run(dry_run("out", {"--rig", write("k2.rig", "effect.accel_second_order.x = 40\n")}));
  EXPECT_SAYS(file_text(folder_ / "out/truth.conf"), "effect.accel_second_order.x = 40");
  // Too short for a diagnosis, and yet not passed: the fit itself is tested.
  EXPECT_EQ(result.code, 20) << result.out;
  EXPECT_SAYS(result.err, "hold: not trusted: the model does not fit");
  EXPECT_SAYS(file_text(folder_ / "out/parameters.conf"), "quality.trusted = false");
}

TEST_F(Run, DeviceFaultIsExit50WithReasonAndPlace) {
  const std::string rig = write("stuck.rig", "fault.1.kind = stuck_axis\nfault.1.axis = pitch\nfault.1.time_s = 14\n");
  const ProgramResult result = ends(dry_run("out", {"--rig", rig}), 50, "step 1 (1/14) moving, pitch at");
  EXPECT_SAYS(result.err, "stall");
  // What was captured stays, under a name that nothing takes for a recording; no result.
  EXPECT_EQ(everything(),
            (std::set<std::string>{"out", "out/journal.tcj", "out/recording.partial.tcr", "out/run.log", "stuck.rig"}));
  // And the folder is not used again.
  expect_refused(dry_run("out"), "already contains recording.partial.tcr");
}

TEST_F(Run, FaultBeforeTheFirstSampleLeavesNothingUnlessTheTableMoved) {
  const std::string gone = write("gone.rig", "fault.1.kind = link_lost\nfault.1.time_s = 0\n");
  expect_refused(dry_run("out", {"--rig", gone}), "link lost", 50);
  const std::string rig = write("estop.rig", "fault.1.kind = emergency_stop\nfault.1.time_s = 1\n");
  EXPECT_EQ(run(dry_run("out", {"--rig", rig})).code, 50);
  EXPECT_SAYS(file_text(folder_ / "out/run.log"), "emergency stop");
  std::filesystem::remove_all(folder_ / "out");
  expect_refused(dry_run("out", {"--rig", write("unit.rig", "unit_serial = SN2\n")}), "'SN2'");
}

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

// A limit on the size of a file is a write that fails, not the end of the program.
TEST_F(Run, FileSizeLimitIsADeviceErrorAndStopsTheTable) {
  const std::string command = "cd " + folder_.string() + " && ulimit -f 200 && " + TURNCAL_BINARY +
                              " run --dry-run --unit SN1 --out out --capture-only > /dev/null 2> err; echo $? > code";
  ASSERT_EQ(std::system(command.c_str()), 0);
  EXPECT_EQ(file_text(folder_ / "code"), "50\n");
  const std::string said = file_text(folder_ / "err");
  EXPECT_EQ(std::ranges::count(said, '\n'), 1) << said;
  EXPECT_SAYS(said, "File too large");
  EXPECT_SAYS(file_text(folder_ / "out/run.log"), "stopped_verified");
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

TEST_F(Run, Refusals) {
  const std::string start =
      "format = 1\nname = x\nrate_degps = 10\nacceleration_degps2 = 20\nstep 1\n  initial H 0 P 0 R 0\n";
  const auto with_sequence = [&](const std::string& name, const std::string& steps) {
    return Arguments{"run", "--dry-run", "--unit", "SN1", "--out", "out", "--sequence", write(name, start + steps)};
  };
  const std::string file = write("file", "x");
  for (const auto& [arguments, said] :
       {std::pair<Arguments, const char*>{{"run", "--dry-run", "--out", "out"}, "--unit"},
        {{"run", "--dry-run", "--unit", "SN1"}, "--out"},
        {{"run", "--dry-run", "--unit", "a#b", "--out", "out"}, "--unit"},
        {dry_run("out", {"--rig", "missing.rig"}), "missing.rig"},
        {dry_run("out", {"--station", "missing.station"}), "missing.station"},
        {with_sequence("nodwell.seq", "  rotate P +90\n"), "nodwell.seq"},
        {with_sequence("far.seq", "  align 1000\n  rotate P +3000\n  dwell 1000\n"), "far.seq:8"},
        {dry_run(file), "expected a folder"},
        {dry_run(file + "/sub"), "file"}})
    expect_refused(arguments, said);
}

TEST_F(Run, ARunIsNeverOverwritten) {
  for (const char* name : {"recording.tcr", "parameters.conf", "run.log", "truth.conf", "recording.partial.tcr"}) {
    const std::string folder = "old_" + std::string(name);
    write(folder + "/" + name, "precious");
    expect_refused(dry_run(folder), name);
    EXPECT_EQ(file_text(folder_ / folder / name), "precious");
  }
  // A folder that holds something else is fine.
  write("notes/readme.txt", "x");
  EXPECT_EQ(run(dry_run("notes", {"--capture-only"})).code, 0);
}

// `turncal run --continue`: a further recording of the same unit, calibrated and diagnosed with what it continues.
const char* const legs =
    "format = 1\nname = extra\nrate_degps = 10\nacceleration_degps2 = 20\nstep 1 \"off the axes\"\n  initial H 0 P 0 R "
    "0\n  align 4000\n  rotate R +45\n  dwell 4000\n"
    "  rotate P +45\n  dwell 4000\n  rotate R -90\n  dwell 4000\n";

class ContinuedRun : public Program {
 protected:
  void begin(const std::string& out) const { ends(dry_run(out), 0); }
};

TEST_F(ContinuedRun, IsOfTheSameUnitAndCountsWithTheFirst) {
  begin("first");
  write("extra.seq", legs);
  const ProgramResult second = ends({"run", "--continue", "first", "--sequence", "extra.seq"}, 0);
  EXPECT_SAYS(second.out, "2 recordings of one unit");
  EXPECT_EQ(file_text(folder_ / "first/truth.conf").substr(0, 200),
            file_text(folder_ / "first/continued/truth.conf").substr(0, 200))
      << "the unit is the one that it was";
  const std::string parameters = file_text(folder_ / "first/continued/parameters.conf");
  EXPECT_SAYS(parameters, "quality.recordings_agree = true");
  EXPECT_TRUE(std::filesystem::exists(folder_ / "first/continued/statistics.tcs"));
  // Its own journal says what it continues; the first run is as it was.
  EXPECT_SAYS(run({"journal", "first/continued"}).out, "continues");
  EXPECT_EQ(run({"resume", "first"}).code, 0);
  // And it can be continued in its turn.
  const ProgramResult third = ends({"run", "--continue", "first/continued", "--sequence", "extra.seq"}, 0);
  EXPECT_SAYS(third.out, "3 recordings of one unit");
}

TEST_F(ContinuedRun, IsTheSameAfterAKill) {
  begin("first");
  write("extra.seq", legs);
  const std::vector<std::string> go_on = {"run", "--continue", "first", "--sequence", "extra.seq"};
  const long points = count_points(go_on);
  ASSERT_GT(points, 20);
  std::filesystem::rename(folder_ / "first/continued", folder_ / "whole");
  expect_same_after_kills(go_on, "first/continued", {points / 3, 2 * points / 3, points - 12, points - 3}, "whole");
}

TEST_F(ContinuedRun, RefusesWhatIsNoRunToContinue) {
  begin("first");
  write("extra.seq", legs);
  std::filesystem::create_directories(folder_ / "empty");
  expect_refused({"run", "--continue", "empty", "--sequence", "extra.seq"}, "empty: holds no journal.tcj");
  expect_refused({"run", "--continue", "first"}, "expected --sequence");
  expect_refused("run --continue first --sequence extra.seq --unit SN2", "--unit: expected no such");
  expect_refused({"design", "--separate", "accel_delay", "--out", "x.seq"}, "--separate, --from: expected both");
  expect_refused("design --separate accel_delay --from first --sigma y --out x.seq",
                 "--separate: expected neither --sigma nor --effects");
  std::filesystem::rename(folder_ / "first/recording.tcr", folder_ / "elsewhere.tcr");
  expect_refused({"run", "--continue", "first", "--sequence", "extra.seq"}, "first: holds no recording.tcr");
}

// Damaged, or swapped for another recording of the same unit: nothing moves, and nothing is made of it.
TEST_F(ContinuedRun, ARecordingThatWasChangedIsNotContinued) {
  begin("first");
  write("extra.seq", legs);
  write("other.rig", "noise.seed = 4711\n");
  ASSERT_EQ(run(dry_run("other", {"--rig", "other.rig"})).code, 0);
  const std::string whole = file_text(folder_ / "first/recording.tcr");
  std::string flipped = whole;
  flipped[whole.size() / 2] ^= 1;
  const std::vector<std::string> go_on = {"run", "--continue", "first", "--sequence", "extra.seq"};
  for (const auto& [bytes, said] :
       {std::pair{flipped, "the recording is damaged"},
        std::pair{file_text(folder_ / "other/recording.tcr"), "is not the recording that this run sealed"}}) {
    write("first/recording.tcr", bytes);
    expect_refused(go_on, said, 50);
    EXPECT_FALSE(std::filesystem::exists(folder_ / "first/continued"));
  }
  write("first/recording.tcr", whole);
  EXPECT_EQ(run(go_on).code, 0);
}

}  // namespace
}  // namespace turncal
