// A batch goes on past a bad unit, stops at a fault, survives a kill, and its queue may change while it runs. Hooks.
#include "tests/orchestrator/program.h"
#include "tests/orchestrator/queue_outcomes.h"

#include "imu_io/lines/unit_end.h"
#include "orchestrator/records/unit_queue.h"
#include "orchestrator/station/child_program.h"

namespace turncal {
namespace {

namespace fs = std::filesystem;

class Batch : public BatchProgram {
 protected:
  static std::string station(const std::string& more = "") { return station_head + "motion.settle_s = 0.5\n" + more; }
};

TEST_F(Batch, DoesTheWholeQueue) {
  write("queue", "SN1\n# a remark\n  SN2   # with another\n\nS/N 3\n");
  const ProgramResult result = ends(batch(), 0);
  EXPECT_EQ(outcomes(), "SN1=not_judged SN2=not_judged S/N 3=not_judged ");
  const std::string batch_tag = "[dry run] [batch] ";  // a line a unit; the rest is asked for
  EXPECT_EQ(result.out, batch_tag + "unit SN1: not judged; units/SN1\n" + batch_tag +
                            "unit SN2: not judged; units/SN2\n" + batch_tag +
                            "unit S/N 3: not judged; units/S%2fN%203\n" + batch_tag +
                            "queue done: 0 passed, 3 without a verdict, 0 not passed\n");
  for (const char* name : {"SN1", "SN2", "S%2fN%203"})
    EXPECT_TRUE(fs::exists(folder_ / "units" / name / "parameters.conf")) << name;
  // Nothing left to do: the count is the whole queue of before.
  EXPECT_SAYS(run(batch()).out, "queue done: 0 passed, 3 without a verdict, 0 not passed")
      << "of the queue, not of this command";
  // Once more on demand, in a folder of its own.
  ASSERT_EQ(run({"queue", "queue", "--again", "SN2"}).code, 0);
  const ProgramResult verbose = ends(batch({"--verbose"}), 0);
  EXPECT_SAYS(verbose.out, "dwelling -> selecting");
  EXPECT_SAYS(verbose.out, "arcsec/pulse");
  EXPECT_TRUE(fs::exists(folder_ / "units/SN2.2/parameters.conf"));
  EXPECT_FALSE(fs::exists(folder_ / "units/SN1.2"));
  EXPECT_EQ(outcomes(), "SN1=not_judged S/N 3=not_judged SN2=not_judged ");
}

TEST_F(Batch, ABadUnitDoesNotStopTheNext) {
  write("queue", "SN1\nSN2\nSN3\n");
  // The unit on the table tells that it is SN2: the others are not there.
  const ProgramResult wrong = ends(batch({"--rig", write("unit.rig", "unit_serial = SN2\n")}), 20);
  EXPECT_EQ(outcomes(), "SN1=refused SN2=not_judged SN3=refused ");
  EXPECT_SAYS(wrong.err, "2 of 3 units did not pass");
  // Units that do not keep their limits.
  write("queue", "SN4\nSN5\n");
  ends(batch({"--station", write("strict.station", station("limit.residual_max = 0.1\n"))}), 20);
  EXPECT_EQ(outcomes(), "SN1=refused SN2=not_judged SN3=refused SN4=fail SN5=fail ");
}

TEST_F(Batch, AUnitThatFailsOnTheWayDoesNotStopTheNext) {
  write("queue", "SN1\nSN2\n");
  const std::string flagged =
      write("flagged.rig", "fault.1.kind = invalid_sample\nfault.1.sample = 1000\nfault.1.count = 100000000\n");
  ends(batch({"--rig", flagged}), 20);
  EXPECT_EQ(outcomes(), "SN1=fail SN2=fail ");
  // One of which nothing can be estimated, though all of it is recorded: samples are lost that its counter does not show.
  std::string lost;
  for (int k = 1; k <= 40; ++k) {
    const std::string fault = "fault." + std::to_string(k);
    lost += fault + ".kind = lost_sample\n" + fault + ".sample = " + std::to_string(3000 + 2500 * k) + "\n" + fault +
            ".count = 300\n" + fault + ".hidden = true\n";
  }
  write("queue", "SN3\nSN4\n");
  EXPECT_EQ(run(batch({"--rig", write("lost.rig", lost)})).code, 20);
  EXPECT_EQ(outcomes(), "SN1=fail SN2=fail SN3=fail SN4=fail ");
  const ProgramResult again = ends({"resume", "units/SN3"}, 20);
  EXPECT_SAYS(again.out, "The run of unit SN3 is complete, verdict fail: nothing to resume.");
}

TEST_F(Batch, ADeviceFaultStopsItAndItGoesOn) {
  write("queue", "SN1\nSN2\n");
  const std::string rig = write("fault.rig", "fault.1.kind = axis_fault\nfault.1.axis = pitch\nfault.1.time_s = 60\n");
  ends(batch({"--rig", rig}), 50, "unit SN1: ");
  EXPECT_EQ(outcomes(), "");
  EXPECT_FALSE(fs::exists(folder_ / "units/SN2"));
  // A wrong configuration says so before the first unit.
  expect_refused(batch({"--station", "missing.station"}), "missing.station");
  expect_refused({"batch", "nowhere", "--dry-run", "--out", "units"}, "nowhere");
  write("marked", "SN1 # a comment\n# another\nSN#3\n");
  expect_refused({"batch", "marked", "--dry-run", "--out", "units"}, "marked:3: 'SN#3': expected a serial number");
}

TEST_F(Batch, AUnitThatGoesOnWithAnotherSequenceIsNamed) {
  write("queue", "SN1\nSN2\n");
  ASSERT_EQ(run_struck(batch(), 700, "kill").code, -1000 - SIGKILL);
  const std::string other = write("other.seq", file_text(short_demo) + "# another\n");
  Arguments with_other = batch();
  with_other.back() = other;
  const ProgramResult result = ends(with_other, 0);
  const std::string said =
      "unit SN1: goes on with the sequence that it began with, " + short_demo + ", not with " + other;
  EXPECT_SAYS(result.out, said);
  EXPECT_SAYS_NOT(result.out, "unit SN2: goes on");
}

TEST_F(Batch, UnitsAreAddedAndRemovedWhileItRuns) {
  write("queue", "SN1\nSN2\nSN3\n");
  const pid_t pid = start(batch());
  // At once: SN1 is under way.
  const Status changed = change_queue(path("queue"), {{"SN9"}, {"SN3"}, {}});
  EXPECT_TRUE(changed.ok());
  ASSERT_EQ(finish(pid).code, 0);
  EXPECT_EQ(outcomes(), "SN1=not_judged SN2=not_judged SN9=not_judged ");
  EXPECT_EQ(file_text(folder_ / "queue"), "SN1\nSN2\nSN9\n");
}

TEST_F(Batch, QueueCommand) {
  const ProgramResult made = ends({"queue", "queue", "--add", "SN1", "SN2"}, 0);
  EXPECT_EQ(made.out, "SN1  waits\nSN2  waits\n");
  EXPECT_EQ(run({"queue", "queue", "--add", "SN1"}).code, 1);
  EXPECT_EQ(run({"queue", "queue", "--remove", "SN7"}).code, 1);
  EXPECT_EQ(run({"queue", "queue", "--again", "SN1"}).code, 1);
  EXPECT_EQ(file_text(folder_ / "queue"), "SN1\nSN2\n");
  write("queue", "SN1\nSN1\n");
  EXPECT_EQ(run({"queue", "queue"}).code, 1);
}

TEST_F(Batch, AUnitThatNobodyJudgedIsNotCalledPassed) {
  write("queue", "SN1\n");
  const std::string hooks = "hook.done = echo done >> told\nhook.needs_operator = echo \"$TURNCAL_MESSAGE\" >> told\n";
  const ProgramResult unjudged = ends(batch({"--station", write("no_limits.station", station(hooks))}), 0);
  EXPECT_SAYS(unjudged.out, "queue done: 0 passed, 1 without a verdict, 0 not passed");
  EXPECT_EQ(file_text(folder_ / "told"), "unit SN1: not judged: the station has no limits\n");
  write("queue", "SN1\nSN2\n");
  const std::string judged = write("limits.station", station(hooks + "limit.residual_max = 10\n"));
  EXPECT_SAYS(run(batch({"--station", judged})).out, "queue done: 1 passed, 1 without a verdict, 0 not passed");
}

// In the night a disk is full, or a calibration runs out, before the next unit begins: there is no run yet that could tell anybody, and
// the units that wait are not to blame.
TEST_F(Batch, WhatStopsItBeforeARunBeginsIsToldAndNoUnitIsRefused) {
  const std::string hook = "hook.needs_operator = echo \"$TURNCAL_UNIT: $TURNCAL_MESSAGE\" >> told\n";
  for (const auto& [keys, why] :
       {std::pair("record.database = /proc/nowhere/r.db\n", "SN1: /proc: no folder"),
        std::pair("table.id = T7\ntable.calibration_due = 2020-01-31\n", "SN1: the calibration of table 'T7'")}) {
    SCOPED_TRACE(keys);
    write("queue", "SN1\nSN2\n");
    fs::remove(folder_ / "told");
    const ProgramResult result = run(batch({"--station", write("night.station", station(keys + hook))}));
    EXPECT_TRUE(result.code == 1 || result.code == 50) << result.code;
    EXPECT_EQ(result.err_lines(), 1) << result.err;
    EXPECT_EQ(file_text(folder_ / "told").find(why), 0u) << file_text(folder_ / "told");
    EXPECT_EQ(outcomes(), "");
  }
}

TEST_F(Batch, HooksAreCalledWithWhatHappened) {
  const std::string tell = "echo \"$TURNCAL_EVENT $TURNCAL_UNIT $TURNCAL_DRY_RUN $TURNCAL_MESSAGE\" >> told; exit 3";
  const std::string hooks = "hook.done = " + tell + "\nhook.fail = " + tell + "\nhook.needs_operator = " + tell + "\n";
  write("queue", "SN1\n");
  EXPECT_EQ(run(batch({"--station", write("good.station", station(hooks + "limit.residual_max = 10\n"))})).code, 0)
      << "a hook's code is not the run's";
  write("queue", "SN2\n");
  EXPECT_EQ(run(batch({"--station", write("strict.station", station(hooks + "limit.residual_max = 0.1\n"))})).code, 20);
  write("queue", "SN3\n");
  EXPECT_EQ(run(batch({"--station", path("good.station"), "--rig",
                       write("estop.rig", "fault.1.kind = emergency_stop\nfault.1.time_s = 30\n")}))
                .code,
            50);
  const std::string told = file_text(folder_ / "told");
  EXPECT_EQ(told.find("done SN1 true \nfail SN2 true unit SN2: fail: "), 0u) << told;
  EXPECT_SAYS(told, "needs_operator SN3 true step 1");
  EXPECT_SAYS(told, "emergency stop");
  EXPECT_SAYS(file_text(folder_ / "units/SN1/run.log"), "hook.done: ended with code 3");
}

// A live batch up to the mounting; the table that comes next does not answer.
class Mounting : public Batch {
 protected:
  void SetUp() override {
    Batch::SetUp();
    write("queue", "SN1\nSN2\n");
  }
  ProgramResult live(const std::string& hooks, const std::string& input = "/dev/null") const {
    write("live.station", live_station("table.address = 127.0.0.1:1\n" + hooks));
    const int keep = ::dup(0), given = ::open(input.c_str(), O_RDONLY | O_NOCTTY);
    ::dup2(given, 0);
    ProgramResult result = run({"batch", "queue", "--out", "units", "--station", "live.station"});
    ::dup2(keep, 0);
    ::close(keep);
    ::close(given);
    return result;
  }
  // What was typed ahead on a terminal.
  ProgramResult typed(const std::string& text) const {
    Result<Pty> terminal = Pty::create(path("terminal"));
    EXPECT_TRUE(terminal.ok());
    const int other_end = ::open(path("terminal").c_str(), O_RDWR | O_NOCTTY);  // so that it is not lost
    EXPECT_TRUE(terminal->write_all(text, 1.0).ok());
    const ProgramResult result = live("", path("terminal"));
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
