// A queue that changes while a batch works on it, mounting, hooks. What becomes of units: tests/golden/batches.sh.
#include "tests/orchestrator/program.h"
#include "tests/orchestrator/queue_outcomes.h"

#include "imu_io/lines/unit_end.h"
#include "orchestrator/records/journal.h"
#include "orchestrator/records/unit_queue.h"
#include "orchestrator/station/child_program.h"

namespace turncal {
namespace {

namespace fs = std::filesystem;

class Batch : public BatchProgram {
 protected:
  static std::string station(const std::string& more = "") { return station_head + "motion.settle_s = 0.5\n" + more; }
};

TEST_F(Batch, UnitsAreAddedAndRemovedWhileItRuns) {
  write("queue", "SN1\nSN2\nSN3\n");
  const pid_t pid = start(batch());
  // At once: SN1 is under way.
  EXPECT_OK(change_queue(path("queue"), {{"SN9"}, {"SN3"}, {}}));
  ASSERT_EQ(finish(pid).code, 0);
  EXPECT_EQ(outcomes(), "SN1=not_judged SN2=not_judged SN9=not_judged ");
  EXPECT_EQ(file_text(folder_ / "queue"), "SN1\nSN2\nSN9\n");
}

// A live batch up to the mounting; the table that comes next does not answer.
class Mounting : public Batch {
 protected:
  void SetUp() override {
    Batch::SetUp();
    write("queue", "SN1\nSN2\n");
  }
  ProgramResult live(const std::string& hooks, const std::string& input = "/dev/null",
                     const Arguments& more = {}) const {
    write("live.station", live_station("table.address = 127.0.0.1:1\n" + hooks));
    const int keep = ::dup(0), given = ::open(input.c_str(), O_RDONLY | O_NOCTTY);
    ::dup2(given, 0);
    ProgramResult result = run(Arguments{"batch", "queue", "--out", "units", "--station", "live.station"} + more);
    ::dup2(keep, 0);
    ::close(keep);
    ::close(given);
    return result;
  }
  // What was typed ahead on a terminal.
  ProgramResult typed(const std::string& text, const Arguments& more = {}) const {
    Result<Pty> terminal = Pty::create(path("terminal"));
    EXPECT_TRUE(terminal.ok());
    const int other_end = ::open(path("terminal").c_str(), O_RDWR | O_NOCTTY);  // so that it is not lost
    EXPECT_TRUE(terminal->write_all(text, 1.0).ok());
    const ProgramResult result = live("", path("terminal"), more);
    ::close(other_end);
    return result;
  }
};
const std::string told_hook = "hook.needs_operator = echo \"$TURNCAL_UNIT $TURNCAL_MESSAGE\" >> told\n";

TEST_F(Mounting, NobodyToAskEndsTheBatchBeforeTheFirstUnit) {
  const ProgramResult result = live(told_hook);
  EXPECT_EQ(result.code, 75) << result.err;
  EXPECT_SAYS(result.err, "unit SN1 is not mounted: nobody to ask: expected a terminal, or hook.mount");
  EXPECT_EQ(file_text(folder_ / "told").find("SN1 unit SN1 is not mounted"), 0u);
  EXPECT_EQ(outcomes(), "");
  EXPECT_FALSE(fs::exists(folder_ / "units"));
  const ProgramResult twin = live("table.simulated = true\n");
  EXPECT_TRUE(twin.err.starts_with("[simulated] turncal: unit SN1 is not mounted")) << twin.err;
}

TEST_F(Mounting, HookMountsOrStopsTheBatch) {
  const ProgramResult mounted =
      live("table.simulated = true\nhook.mount = echo \"$TURNCAL_EVENT $TURNCAL_UNIT\" >> mounts\n");
  EXPECT_EQ(mounted.code, 50) << "mounted: on to the table, which does not answer: " << mounted.err;
  EXPECT_TRUE(mounted.err.starts_with("[simulated] turncal: ")) << mounted.err;
  EXPECT_TRUE(mounted.out.starts_with("[simulated] [batch] ")) << mounted.out;
  EXPECT_EQ(file_text(folder_ / "mounts"), "mount SN1\n");
  const ProgramResult failed = live("hook.mount = exit 4\n" + told_hook);
  EXPECT_EQ(failed.code, 75);
  EXPECT_SAYS(failed.err, "hook.mount: ended with code 4");
  EXPECT_SAYS(file_text(folder_ / "told"), "hook.mount: ended with code 4");
  const ProgramResult late = live("hook.mount = sleep 100\nhook.mount_time_s = 1\n");
  EXPECT_EQ(late.code, 75);
  EXPECT_SAYS(late.err, "did not end within its time");
  EXPECT_EQ(outcomes(), "");
  // A dry run mounts nothing.
  EXPECT_EQ(run(batch({"--station", write("mock.station", station("hook.mount = touch moved; exit 1\n"))})).code, 0);
  EXPECT_FALSE(fs::exists(folder_ / "moved"));
}

TEST_F(Mounting, OperatorMountsSkipsOrQuits) {
  const ProgramResult mounted = typed("\n");
  EXPECT_EQ(mounted.code, 50) << mounted.err;
  EXPECT_SAYS(mounted.out, "Mount unit SN1, then press Enter (or skip REASON, quit)");
  const ProgramResult quit = typed("skip\nyes\nskip a bent pin\nquit\n");
  EXPECT_EQ(quit.code, 75) << quit.err;
  EXPECT_SAYS(quit.err, "unit SN2 is not mounted: the operator quit");
  EXPECT_SAYS(quit.out, "Why?");
  EXPECT_EQ(outcomes(), "SN1=skipped ");
  EXPECT_SAYS(file_text(folder_ / "queue.state"), " SN1 # a bent pin\n");
  EXPECT_SAYS(run({"queue", "queue"}).out, ": a bent pin\nSN2  waits");
  // Skipped is not forgotten: the next is asked for, and the queue did not pass.
  const ProgramResult rest = typed("skip none left\n");
  EXPECT_EQ(rest.code, 20) << rest.err;
  EXPECT_EQ(outcomes(), "SN1=skipped SN2=skipped ");
  ASSERT_EQ(run({"queue", "queue", "--again", "SN1"}).code, 0);
  EXPECT_SAYS(typed("quit\n").err, "unit SN1 is not mounted");
}

// Its run left it on the table: asked for after a fault, on demand, and where it is to be done again.
TEST_F(Mounting, AUnitThatStaysOnTheTableIsNotAskedFor) {
  const auto ends_as = [this](const char* to, const std::string& unit = "SN1", const char* event = "stopped_verified") {
    const std::string file = path("units/" + unit + "/journal.tcj");
    fs::create_directories(folder_ / "units" / unit);
    fs::remove(file);
    Result<JournalFile> journal = JournalFile::create(file, {{"unit", unit}});
    EXPECT_TRUE(journal && journal->append(JournalType::transition,
                                           {{"utc_s", "1"}, {"from", "stopping"}, {"event", event}, {"to", to}}));
  };
  ends_as("interrupted");
  const std::string stays = "it is still on the table: its run was interrupted";
  EXPECT_SAYS(typed("quit\n").out, "unit SN1: " + stays);
  EXPECT_EQ(typed("quit\n", {"--mount-again"}).code, 75);
  EXPECT_EQ(live("hook.mount = echo \"$TURNCAL_MESSAGE\" > told; exit 1\n").code, 75);
  EXPECT_EQ(file_text(folder_ / "told"), stays + "\n");
  write("queue.state", "again 2026-01-31T12:00:00Z SN1\n");
  EXPECT_EQ(typed("quit\n").code, 75) << "to be done again";
  fs::remove(folder_ / "queue.state");
  ends_as("interrupted", "SN2");
  EXPECT_SAYS(typed("quit\n").out, "unit SN2: " + stays);  // the newest goes on first
  ends_as("failed");
  EXPECT_EQ(typed("quit\n").code, 75) << "after a fault";
  ends_as("moving", "SN2", "move_next");
  EXPECT_SAYS(typed("quit\n").out, "unit SN2: go to the table before anything else") << "after a crash";
}

Status command(const char* words, double time_s, const char* input) {
  const HookCall call{.event = "unit", .unit = "", .folder = "", .message = "", .input = input};
  return run_command("alert.command", words, call, time_s, {});
}

TEST(Hooks, AHookThatHangsIsKilledWithItsChildren) {
  const auto began = std::chrono::steady_clock::now();
  EXPECT_FALSE(command("sleep 50 & sleep 50", 0.2, ""));
  EXPECT_LT(std::chrono::steady_clock::now() - began, std::chrono::seconds(10));
  EXPECT_TRUE(run_hook({}, {"done", "", "", ""}).ok()) << "none is given";
  EXPECT_FALSE(command("/no/such/program", 1.0, ""));
}

TEST(Hooks, ACommandThatPrintsWithoutEndIsKilled) {
  EXPECT_ERROR(command("echo no line >&2; yes", 20.0, "{}"),
               "alert.command: printed more than 1024 KiB and was killed: no line");
  EXPECT_ERROR(command("echo; echo no server >&2; exit 7", 20.0, "{}"), "alert.command: ended with code 7: no server");
}

}  // namespace
}  // namespace turncal
