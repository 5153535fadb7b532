// Several units on one table, as a black box: results, a unit that drops out, verdicts, interruption, refusals, batches.
#include "tests/orchestrator/program.h"
#include "tests/orchestrator/queue_outcomes.h"

#include "imu_io/recordings/parameter_file.h"
#include "orchestrator/devices/dry_run_devices.h"
#include "orchestrator/records/journal.h"
#include "orchestrator/records/unit_queue.h"

namespace turncal {
namespace {

namespace fs = std::filesystem;

class Group : public Program {
 protected:
  Arguments dry_run(const std::vector<std::string>& units, const std::string& out, const Arguments& more = {}) const {
    Arguments arguments = {"run", "--dry-run", "--out", out, "--sequence", short_demo};
    for (const std::string& unit : units) arguments.insert(arguments.end(), {"--unit", unit});
    return arguments + more;
  }
  std::string bytes(const std::string& file) const { return file_text(folder_ / file); }
  void expect_same_files(const std::string& one, const std::string& other) const {
    for (const char* name : {"recording.tcr", "parameters.conf", "truth.conf"}) {
      EXPECT_FALSE(bytes(one + "/" + name).empty()) << one << " " << name;
      EXPECT_TRUE(bytes(one + "/" + name) == bytes(other + "/" + name)) << one << " and " << other << ": " << name;
    }
  }
  bool there(const std::string& name) const { return fs::exists(folder_ / name); }
};

TEST_F(Group, EveryUnitGetsItsOwnParametersAndTheFirstThoseOfARunAlone) {
  ASSERT_EQ(run(dry_run({"SN1"}, "alone")).code, 0);
  ASSERT_EQ(run(dry_run({"SN1", "SN2"}, "two")).code, 0);
  ends(dry_run({"SN1", "SN2", "S/N 3"}, "three"), 0);
  std::set<std::string> files;
  for (const auto& entry : fs::recursive_directory_iterator(folder_ / "three"))
    files.insert(fs::relative(entry.path(), folder_ / "three").string());
  std::set<std::string> expected = {"journal.tcj", "run.log"};
  for (const std::string unit : {"SN1", "SN2", "S%2fN%203"}) {
    expected.insert(
        {unit, unit + "/recording.tcr", unit + "/parameters.conf", unit + "/statistics.tcs", unit + "/truth.conf"});
  }
  EXPECT_EQ(files, expected);
  expect_same_files("three/SN1", "alone");
  expect_same_files("two/SN1", "alone");
  expect_same_files("three/SN2", "two/SN2");
  std::set<double> scale_factors;
  for (const auto& [unit, serial] : {std::pair{"SN1", "SN1"}, {"SN2", "SN2"}, {"S%2fN%203", "S/N 3"}}) {
    const Result<ParameterFile> found = read_parameter_file(path(std::string("three/") + unit + "/parameters.conf"));
    const Result<ParameterVector> truth = read_truth(path(std::string("three/") + unit + "/truth.conf"));
    ASSERT_TRUE(found.ok()) << found.error().message;
    ASSERT_TRUE(truth.ok()) << truth.error().message;
    EXPECT_EQ(found->unit_serial, serial);
    scale_factors.insert((*truth)[15]);
    int judged = 0;
    for (std::size_t i = 0; i < parameter_count; ++i) {
      if (!found->sigma[i] || *found->sigma[i] == 0.0) continue;
      ++judged;
      EXPECT_LT(std::abs(found->parameters[i] - (*truth)[i]), 4.0 * *found->sigma[i]) << unit << " parameter " << i;
    }
    EXPECT_EQ(judged, 21) << unit;
  }
  EXPECT_EQ(scale_factors.size(), 3u) << "units that are the same unit";
}

// Whoever is read first, in the middle or last: the others do not notice.
TEST_F(Group, AUnitThatIsUnpluggedLeavesTheOthersAsTheyWere) {
  const std::vector<std::string> units = {"SN1", "SN2", "SN3"};
  ASSERT_EQ(run(dry_run(units, "good")).code, 0);
  for (const std::size_t gone : {0u, 1u, 2u}) {
    const std::string out = "out" + std::to_string(gone), number = std::to_string(gone + 1);
    const std::string rig =
        write(out + ".rig", "fault.1.kind = imu_unplugged\nfault.1.time_s = 100\nfault.1.unit = " + number + "\n");
    const ProgramResult result =
        ends(dry_run(units, out, {"--rig", rig}), 50, "unit SN" + number + " dropped out at step 2 (2/14)");
    EXPECT_SAYS(result.err, "the link was lost at 100");
    for (std::size_t i = 0; i < units.size(); ++i) {
      if (i != gone) {
        expect_same_files(out + "/" + units[i], "good/" + units[i]);
        continue;
      }
      EXPECT_TRUE(there(out + "/" + units[i] + "/recording.partial.tcr"));
      EXPECT_FALSE(there(out + "/" + units[i] + "/recording.tcr"));
      EXPECT_FALSE(there(out + "/" + units[i] + "/parameters.conf"));
      EXPECT_SAYS_NOT(result.err, "unit " + units[(i + 1) % 3]);
    }
    EXPECT_SAYS(bytes(out + "/run.log"), "unit SN" + number + " dropped out at step 2");
    // Nothing is left to be done; the one that dropped out is said again.
    ends({"resume", out}, 50, "unit SN" + number + " dropped out");
  }
}

TEST_F(Group, WhoDropsOutIsNamedAndWhoIsLeftGoesOn) {
  const auto unit_gone = [](int fault, int time_s) {
    const std::string key = "fault." + std::to_string(fault);
    return key + ".kind = imu_unplugged\n" + key + ".time_s = " + std::to_string(time_s) + "\n" + key +
           ".unit = " + std::to_string(fault) + "\n";
  };
  struct Case {
    const char* what;
    std::string rig;
    std::vector<const char*> errors;
    bool first, second;  // has parameters
  };
  for (const Case& c :
       {Case{"silent",
             "fault.1.kind = imu_silent\nfault.1.time_s = 100\nfault.1.duration_s = 60\nfault.1.unit = 2\n",
             {"unit SN2 dropped out at", "no sample from the IMU for "},
             true,
             false},
        // Bad from the second dwell on: three attempts, of which the other unit's third is good.
        Case{"never_good",
             "fault.1.kind = invalid_sample\nfault.1.sample = 1700\nfault.1.count = 100000\nfault.1.unit = 1\n",
             {"unit SN1 dropped out at step 1 (1/14) dwelling", "flagged its data as bad"},
             false,
             true},
        Case{"another",
             "unit_serial = SN9\n",
             {"unit SN1 dropped out at connecting: the unit on the table reports serial number 'SN9'"},
             false,
             true},
        Case{"all_gone",
             unit_gone(1, 100) + unit_gone(2, 120),
             {"unit SN2: simulated unit: the link was lost at 120", "unit SN1 dropped out at"},
             false,
             false},
        Case{"table",
             "fault.1.kind = axis_fault\nfault.1.axis = pitch\nfault.1.time_s = 60\n",
             {"fault of axis pitch"},
             false,
             false}}) {
    SCOPED_TRACE(c.what);
    const std::string out = c.what;
    const ProgramResult result = ends(dry_run({"SN1", "SN2"}, out, {"--rig", write(out + ".rig", c.rig)}), 50, "");
    for (const char* error : c.errors) EXPECT_SAYS(result.err, error);
    EXPECT_EQ(there(out + "/SN1/parameters.conf"), c.first);
    EXPECT_EQ(there(out + "/SN2/parameters.conf"), c.second);
    EXPECT_SAYS(bytes(out + "/run.log"), "stopped_verified");
    if (!c.first && !c.second) {
      EXPECT_SAYS(result.out, "resume with: turncal resume " + out);
    }
  }
  EXPECT_FALSE(there("another/SN1")) << "it leaves nothing";
  for (const char* unit : {"SN1", "SN2"}) EXPECT_TRUE(there(std::string("table/") + unit + "/recording.partial.tcr"));
}

TEST_F(Group, SamplesLostAtRestRepeatTheDwellForAll) {
  const std::string rig =
      write("lost.rig", "fault.1.kind = lost_sample\nfault.1.sample = 1700\nfault.1.count = 2\nfault.1.unit = 2\n");
  const ProgramResult result = ends(dry_run({"SN1", "SN2"}, "out", {"--rig", rig}), 0);
  EXPECT_SAYS(result.out, "dwells repeated: 1, samples lost: 0");
  EXPECT_SAYS(result.out, "dwells repeated: 1, samples lost: 2");
  EXPECT_SAYS(bytes("out/SN1/parameters.conf"), "record.repeated_dwells = 1");
  // As if it had been the only unit.
  ASSERT_EQ(run(dry_run({"SN2"}, "alone",
                        {"--rig",
                         write("lost1.rig", "fault.1.kind = lost_sample\nfault.1.sample = 1700\nfault.1.count = 2\n")}))
                .code,
            0);
  EXPECT_EQ(fs::file_size(folder_ / "alone/recording.tcr"), fs::file_size(folder_ / "out/SN2/recording.tcr"));
}

TEST_F(Group, AUnitThatDoesNotKeepItsLimitsFailsAlone) {
  // a11 of the three units: 1.052, 0.995, 1.036.
  const std::string told = "echo \"$TURNCAL_EVENT $TURNCAL_UNIT $TURNCAL_FOLDER\" >> " + path("told");
  const std::string station =
      write("limits.station", station_head +
                                  std::string("motion.settle_s = 0.5\nlimit.a11.min = 1.02\nrecord.database = "
                                              "r.db\nrecord.store = store\nhook.done = ") +
                                  told + "\nhook.fail = " + told + "\n");
  const ProgramResult result = ends(dry_run({"SN1", "SN2", "SN3"}, "out", {"--station", station}), 20,
                                    "unit SN2: fail: accelerometer x scale factor (a11)");
  EXPECT_SAYS_NOT(result.err, "SN1");
  EXPECT_EQ(bytes("told"), "done SN1 out/SN1\nfail SN2 out/SN2\ndone SN3 out/SN3\n");
  EXPECT_TRUE(there("store/simulated/SN1/parameters.conf"));
  EXPECT_FALSE(there("store/simulated/SN2"));
  const ProgramResult history = run({"history", "r.db"});
  for (const char* unit : {"SN1", "SN2", "SN3"}) EXPECT_SAYS(history.out, unit);
  // Not into its own source, nor over any other file but an earlier page.
  const std::string report = "history r.db --simulated --together --report ";
  expect_refused(report + "r.db", "is a file of another kind");
  for (int i = 0; i < 2; ++i) ASSERT_EQ(run(report + "page.html").code, 0);
  for (const std::string chart : {"--control", "--parameter N01", "--report mixed.html"}) {
    expect_refused("history r.db --simulated " + chart, "r.db: holds 3 units");
    EXPECT_FALSE(there("mixed.html"));
    EXPECT_EQ(run("history r.db --simulated --unit SN2 " + chart).code, 0);
  }
  // A unit that dropped out as well: the larger code, and both are named.
  const std::string rig = write("gone.rig", "fault.1.kind = imu_unplugged\nfault.1.time_s = 100\nfault.1.unit = 3\n");
  const ProgramResult both =
      ends(dry_run({"SN1", "SN2", "SN3"}, "both", {"--station", station, "--rig", rig}), 50, "unit SN2: fail: ");
  EXPECT_SAYS(both.err, "unit SN3 dropped out");
}

TEST_F(Group, Refusals) {
  expect_refused(dry_run({"SN1", "SN2", "SN1"}, "out"), "--unit 'SN1': given twice");
  expect_refused(dry_run({"SN1", "a#b"}, "out"), "--unit 'a#b'");
  std::vector<std::string> seventeen;
  for (int i = 1; i <= 17; ++i) seventeen.push_back("U" + std::to_string(i));
  expect_refused(dry_run(seventeen, "out"), "17 units: expected at most 16");
  write("full/SN2/recording.tcr", "precious");
  expect_refused(dry_run({"SN1", "SN2"}, "full"), "full/SN2 already contains recording.tcr");
  write("live.station", live_station("imu.2.device = none2\n"));
  expect_refused("run --station live.station --unit A --unit B --unit C --out r", "3 units: expected at most 2");
  expect_refused({"batch", write("queue", "A\n"), "--station", "live.station", "--out", "r", "--at-once", "3"},
                 "expected at most 2");
}

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
      for (const std::string unit : {"SN1", "SN2", "SN3"}) {
        for (const std::string name : {"recording.tcr", "truth.conf"})
          ASSERT_TRUE(bytes("out/" + unit + "/" + name) == bytes("good/" + unit + "/" + name)) << unit << " " << name;
      }
    }
    EXPECT_GT(taken_up, 20);
  }
  std::string sequence_;
};

TEST_F(GroupResume, TheSameBytesWhereverItIsInterrupted) { strike_everywhere(write("r.rig", "seed = 3\n"), 0); }

TEST_F(GroupResume, AUnitThatHadDroppedOutStaysOut) {
  strike_everywhere(write("r.rig", "fault.1.kind = imu_unplugged\nfault.1.time_s = 60\nfault.1.unit = 2\n"), 50);
}

TEST_F(GroupResume, ChecksWhoseRunItIs) {
  const std::string rig = write("r.rig", "seed = 3\n");
  ASSERT_EQ(run_struck(begin("out", rig), 120, "kill").code, -1000 - SIGKILL);
  expect_refused({"resume", "out", "--unit", "SN1"}, "expected 'SN1', 'SN2', 'SN3', whose run this is");
  expect_refused({"resume", "out", "--unit", "SN2", "--unit", "SN1", "--unit", "SN3"}, "expected 'SN1', 'SN2', 'SN3'");
  EXPECT_EQ(run({"resume", "out", "--unit", "SN1", "--unit", "SN2", "--unit", "SN3"}).code, 0);
}

// --- Batch ---

class GroupBatch : public BatchProgram {
 protected:
  Arguments batch(const Arguments& more = {}) const { return BatchProgram::batch(more + "--at-once 2"); }
  bool there(const std::string& name) const { return fs::exists(folder_ / name); }
};

TEST_F(GroupBatch, TakesSeveralAtOnce) {
  write("queue", "SN1\nSN2\nSN3\n");
  ends(batch(), 0);
  EXPECT_EQ(outcomes(), "SN1=not_judged SN2=not_judged SN3=not_judged ");
  for (const char* name : {"group.1/SN1", "group.1/SN2", "SN3"})
    EXPECT_TRUE(there(std::string("units/") + name + "/parameters.conf")) << name;
  // Again: a group of its own.
  ASSERT_EQ(run({"queue", "queue", "--again", "SN1", "SN3"}).code, 0);
  ASSERT_EQ(run(batch()).code, 0);
  EXPECT_TRUE(there("units/group.2/SN3/parameters.conf"));
}

TEST_F(GroupBatch, AUnitThatDropsOutDoesNotStopTheNext) {
  write("queue", "SN1\nSN2\nSN3\nSN4\n");
  const std::string rig = write("gone.rig", "fault.1.kind = imu_unplugged\nfault.1.time_s = 100\nfault.1.unit = 2\n");
  ends(batch({"--rig", rig}), 20);
  EXPECT_EQ(outcomes(), "SN1=not_judged SN2=dropped SN3=not_judged SN4=dropped ");
  // It is not tried for ever, the code is that of the whole queue; and the table's fault stops the batch.
  ends(batch(), 20, "2 of 4 units did not pass");
  write("queue", "SN5\nSN6\nSN7\n");
  ends(batch({"--rig", write("t.rig", "fault.1.kind = axis_fault\nfault.1.axis = pitch\nfault.1.time_s = 60\n")}), 50,
       "units SN5, SN6: ");
  EXPECT_EQ(outcomes(), "SN1=not_judged SN2=dropped SN3=not_judged SN4=dropped ");
}

TEST_F(GroupBatch, SurvivesKills) {
  write("queue", "SN1\nSN2\nSN3\nSN4\nSN5\n");
  Arguments command = batch();
  std::ranges::replace(command, short_demo, first_steps("5"));
  kill_until_done(command, 50'000, 61'000);
  EXPECT_EQ(outcomes(), "SN1=not_judged SN2=not_judged SN3=not_judged SN4=not_judged SN5=not_judged ");
  EXPECT_FALSE(there("units/group.3")) << "an interrupted group was not gone on with";
  for (const char* name : {"group.1/SN1", "group.1/SN2", "group.2/SN3", "group.2/SN4", "SN5"})
    EXPECT_TRUE(there(std::string("units/") + name + "/parameters.conf")) << name;
}

}  // namespace
}  // namespace turncal
