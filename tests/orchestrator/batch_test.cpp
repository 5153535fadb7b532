// A batch goes on past a bad unit, stops at a fault, survives a kill, and its queue may change while it runs. Hooks.
#include "tests/orchestrator/program.h"

#include <chrono>

#include "orchestrator/hooks.h"
#include "orchestrator/unit_queue.h"

namespace turncal {
namespace {

namespace fs = std::filesystem;

class Batch : public Program {
 protected:
  static std::string station(const std::string& more = "") {
    return "format = 1\nsite.latitude_deg = 29.53\nsite.gravity_mps2 = 9.7914\ntable.driver = mock\nimu.driver = rig\n"
           "motion.settle_s = 0.5\n" + more;
  }
  std::vector<std::string> batch(std::vector<std::string> more = {}) const {
    std::vector<std::string> arguments = {"batch", "queue", "--dry-run", "--out", "units", "--sequence",
                                          std::string(TURNCAL_SOURCE_DIR) + "/sequences/short_demo.seq"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
  }
  std::string outcomes() const {
    const Result<std::vector<UnitOutcome>> all = read_outcomes(path("queue"));
    std::string text;
    if (all) {
      for (const UnitOutcome& o : *all) text += o.unit + "=" + o.outcome + " ";
    }
    return text;
  }
};

TEST_F(Batch, DoesTheWholeQueue) {
  write("queue", "SN1\n# a remark\n  SN2   # with another\n\nS/N 3\n");
  const ProgramResult result = run(batch());
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_EQ(outcomes(), "SN1=pass SN2=pass S/N 3=pass ");
  for (const char* name : {"SN1", "SN2", "S%2fN%203"}) {
    EXPECT_TRUE(fs::exists(folder_ / "units" / name / "parameters.conf")) << name;
  }
  // Nothing left to do.
  EXPECT_NE(run(batch()).out.find("0 passed, 0 not"), std::string::npos);
  // Once more on demand, in a folder of its own.
  ASSERT_EQ(run({"queue", "queue", "--again", "SN2"}).code, 0);
  ASSERT_EQ(run(batch()).code, 0);
  EXPECT_TRUE(fs::exists(folder_ / "units/SN2.2/parameters.conf"));
  EXPECT_FALSE(fs::exists(folder_ / "units/SN1.2"));
  EXPECT_EQ(outcomes(), "SN1=pass S/N 3=pass SN2=pass ");
}

TEST_F(Batch, ABadUnitDoesNotStopTheNext) {
  write("queue", "SN1\nSN2\nSN3\n");
  // The unit on the table tells that it is SN2: the others are not there.
  const ProgramResult wrong = run(batch({"--rig", write("unit.rig", "unit_serial = SN2\n")}));
  EXPECT_EQ(wrong.code, 20) << wrong.err;
  EXPECT_EQ(outcomes(), "SN1=refused SN2=pass SN3=refused ");
  EXPECT_NE(wrong.err.find("2 of 3 units did not pass"), std::string::npos) << wrong.err;
  // Units that do not keep their limits.
  write("queue", "SN4\nSN5\n");
  const ProgramResult bad = run(batch({"--station", write("strict.station", station("limit.residual_max = 0.1\n"))}));
  EXPECT_EQ(bad.code, 20);
  EXPECT_EQ(outcomes(), "SN1=refused SN2=pass SN3=refused SN4=fail SN5=fail ");
}

TEST_F(Batch, ADeviceFaultStopsItAndItGoesOn) {
  write("queue", "SN1\nSN2\n");
  const std::string rig = write("fault.rig", "fault.1.kind = axis_fault\nfault.1.axis = pitch\nfault.1.time_s = 60\n");
  const ProgramResult result = run(batch({"--rig", rig}));
  EXPECT_EQ(result.code, 50);
  EXPECT_EQ(result.err_lines(), 1) << result.err;
  EXPECT_NE(result.err.find("unit SN1: "), std::string::npos) << result.err;
  EXPECT_EQ(outcomes(), "");
  EXPECT_FALSE(fs::exists(folder_ / "units/SN2"));
  // A wrong configuration says so before the first unit.
  expect_refused(batch({"--station", "missing.station"}), "missing.station");
  expect_refused({"batch", "nowhere", "--dry-run", "--out", "units"}, "nowhere");
}

TEST_F(Batch, SurvivesKillsAtRandomMoments) {
  write("queue", "SN1\nSN2\nSN3\n");
  int kills = 0;
  for (int i = 0; i < 60; ++i) {
    const pid_t pid = start(batch());
    ::usleep(static_cast<useconds_t>(20'000 + 37'000 * (i % 9)));
    ::kill(pid, SIGKILL);
    const ProgramResult result = finish(pid);
    if (result.code == 0) break;
    ASSERT_EQ(result.code, -1000 - SIGKILL) << result.err;
    ++kills;
  }
  ASSERT_EQ(run(batch()).code, 0);
  EXPECT_GT(kills, 0);
  EXPECT_EQ(outcomes(), "SN1=pass SN2=pass SN3=pass ");
  for (const char* name : {"SN1", "SN2", "SN3"}) EXPECT_TRUE(fs::exists(folder_ / "units" / name / "parameters.conf"));
}

TEST_F(Batch, UnitsAreAddedAndRemovedWhileItRuns) {
  write("queue", "SN1\nSN2\nSN3\n");
  const pid_t pid = start(batch());
  // At once: SN1 is under way.
  const Status changed = change_queue(path("queue"), {{"SN9"}, {"SN3"}, {}});
  EXPECT_TRUE(changed.ok());
  ASSERT_EQ(finish(pid).code, 0);
  EXPECT_EQ(outcomes(), "SN1=pass SN2=pass SN9=pass ");
  EXPECT_EQ(file_text(folder_ / "queue"), "SN1\nSN2\nSN9\n");
}

TEST_F(Batch, QueueCommand) {
  const ProgramResult made = run({"queue", "queue", "--add", "SN1", "SN2"});
  ASSERT_EQ(made.code, 0) << made.err;
  EXPECT_EQ(made.out, "SN1  waits\nSN2  waits\n");
  EXPECT_EQ(run({"queue", "queue", "--add", "SN1"}).code, 1);
  EXPECT_EQ(run({"queue", "queue", "--remove", "SN7"}).code, 1);
  EXPECT_EQ(run({"queue", "queue", "--again", "SN1"}).code, 1);
  EXPECT_EQ(file_text(folder_ / "queue"), "SN1\nSN2\n");
  write("queue", "SN1\nSN1\n");
  EXPECT_EQ(run({"queue", "queue"}).code, 1);
}

TEST_F(Batch, HooksAreCalledWithWhatHappened) {
  const std::string tell = "echo \"$TURNCAL_EVENT $TURNCAL_UNIT $TURNCAL_DRY_RUN $TURNCAL_MESSAGE\" >> told; exit 3";
  const std::string hooks = "hook.done = " + tell + "\nhook.fail = " + tell + "\nhook.needs_operator = " + tell + "\n";
  write("queue", "SN1\n");
  EXPECT_EQ(run(batch({"--station", write("good.station", station(hooks))})).code, 0) << "a hook's code is not the run's";
  write("queue", "SN2\n");
  EXPECT_EQ(run(batch({"--station", write("strict.station", station(hooks + "limit.residual_max = 0.1\n"))})).code, 20);
  write("queue", "SN3\n");
  EXPECT_EQ(run(batch({"--station", path("good.station"), "--rig",
                       write("estop.rig", "fault.1.kind = emergency_stop\nfault.1.time_s = 30\n")})).code, 50);
  const std::string told = file_text(folder_ / "told");
  EXPECT_EQ(told.find("done SN1 true \nfail SN2 true unit SN2 does not keep its limits"), 0u) << told;
  EXPECT_NE(told.find("needs_operator SN3 true step 1"), std::string::npos) << told;
  EXPECT_NE(told.find("emergency stop"), std::string::npos) << told;
  EXPECT_NE(file_text(folder_ / "units/SN1/run.log").find("hook.done: ended with code 3"), std::string::npos);
}

TEST(Hooks, AHookThatHangsIsKilledWithItsChildren) {
  const auto began = std::chrono::steady_clock::now();
  const Status status = run_hook({"sleep 50 & sleep 50", "", ""}, {"done", "", "", "", false}, 0.2);
  EXPECT_FALSE(status.ok());
  EXPECT_LT(std::chrono::steady_clock::now() - began, std::chrono::seconds(10));
  EXPECT_TRUE(run_hook({}, {"done", "", "", "", false}).ok()) << "none is given";
  EXPECT_FALSE(run_hook({"/no/such/program", "", ""}, {"done", "", "", "", false}).ok());
}

}  // namespace
}  // namespace turncal
