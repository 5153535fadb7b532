// Several units on one table, as a black box: results, interruption, batches. Who drops out or fails: tests/golden/groups.sh.
#include "tests/orchestrator/program.h"
#include "tests/orchestrator/queue_outcomes.h"

#include "orchestrator/records/unit_queue.h"

namespace turncal {
namespace {

namespace fs = std::filesystem;

class Group : public Program {
 protected:
  Arguments dry_run(const std::vector<std::string>& units, const std::string& out, const Arguments& more = {}) const {
    Arguments arguments = {"run", "--dry-run", "--out", out, "--sequence", first_steps("5")};
    for (const std::string& unit : units) arguments.insert(arguments.end(), {"--unit", unit});
    return arguments + more;
  }
  std::string bytes(const std::string& file) const { return file_text(folder_ / file); }
  bool there(const std::string& name) const { return fs::exists(folder_ / name); }
};

// --- Interruption ---

class GroupResume : public Group {
 protected:
  void SetUp() override {
    Group::SetUp();
    sequence_ = first_steps("4");
  }
  std::vector<std::string> begin(const std::string& out, const std::string& rig) const {
    return {"run",   "--dry-run", "--capture-only", "--unit", "SN1",        "--unit", "SN2", "--unit", "SN3",
            "--out", out,         "--rig",          rig,      "--sequence", sequence_};
  }
  // Killed, cut off from power, or out of disk at every thirteenth call, and taken up again: the recordings of an uninterrupted run.
  void strike_everywhere(const std::string& rig, int code) const {
    const long points = count_points(begin("good", rig), code);
    ASSERT_GT(points, 150);
    const auto how = [](long point) { return "fpk"[point / 13 % 3]; };  // full, power, kill
    std::map<long, char> copies;
    for (long point = 1; point <= points; point += 13)
      if (how(point) != 'f') copies[point] = how(point);
    ASSERT_EQ(run_copied(begin("out", rig), "out", copies).code, code);
    int taken_up = 0;
    for (long point = 1; point <= points && !HasFatalFailure(); point += 13) {
      SCOPED_TRACE(how(point) + std::string(" at call ") + std::to_string(point));
      fs::remove_all(folder_ / "out");
      if (how(point) == 'f')
        run_struck(begin("out", rig), point, "full");
      else
        take_copy("out", point);
      const bool begun = there("out/journal.tcj");
      taken_up += begun ? 1 : 0;
      ends(begun ? std::vector<std::string>{"resume", "out"} : begin("out", rig), code);
      for (const std::string unit : {"SN1", "SN2", "SN3"})
        for (const std::string name : {"recording.tcr", "truth.conf"})
          ASSERT_TRUE(bytes("out/" + unit + "/" + name) == bytes("good/" + unit + "/" + name)) << unit << " " << name;
    }
    EXPECT_GT(taken_up, 20);
  }
  std::string sequence_;
};

TEST_F(GroupResume, TheSameBytesWhereverItIsInterrupted) { strike_everywhere(write("r.rig", "seed = 3\n"), 0); }

TEST_F(GroupResume, AUnitThatHadDroppedOutStaysOut) {
  strike_everywhere(write("r.rig", "fault.1.kind = imu_unplugged\nfault.1.time_s = 60\nfault.1.unit = 2\n"), 50);
}

// --- Batch ---

class GroupBatch : public BatchProgram {
 protected:
  Arguments batch(const Arguments& more = {}) const { return BatchProgram::batch(more + "--at-once 2"); }
  bool there(const std::string& name) const { return fs::exists(folder_ / name); }
};

TEST_F(GroupBatch, SurvivesKills) {
  write("queue", "SN1\nSN2\nSN3\nSN4\nSN5\n");
  kill_until_done(batch(), 50'000, 61'000);
  EXPECT_EQ(outcomes(), "SN1=not_judged SN2=not_judged SN3=not_judged SN4=not_judged SN5=not_judged ");
  EXPECT_EQ(good(read_outcomes(path("queue")))->at(2).time_utc, good(read_outcomes(path("queue")))->at(3).time_utc);
  EXPECT_FALSE(there("units/group.3")) << "an interrupted group was not gone on with";
  for (const char* name : {"group.1/SN1", "group.1/SN2", "group.2/SN3", "group.2/SN4", "SN5"})
    EXPECT_TRUE(there(std::string("units/") + name + "/parameters.conf")) << name;
}

}  // namespace
}  // namespace turncal
