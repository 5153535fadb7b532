// `turncal run --continue`: a further recording of the same unit, calibrated and diagnosed with what it continues.
#include "tests/orchestrator/program.h"

namespace turncal {
namespace {

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
  ASSERT_EQ(run(go_on).code, 0);
  const std::string parameters = file_text(folder_ / "first/continued/parameters.conf");
  const std::string recording = file_text(folder_ / "first/continued/recording.tcr");
  std::filesystem::remove_all(folder_ / "first/continued");
  const long points = count_points(go_on);
  ASSERT_GT(points, 20);
  for (const long point : {points / 3, 2 * points / 3, points - 12, points - 3}) {
    std::filesystem::remove_all(folder_ / "first/continued");
    run_struck(go_on, point, "kill");
    std::filesystem::remove(folder_.string() + ".count");
    if (!std::filesystem::exists(folder_ / "first/continued/journal.tcj")) continue;
    ends({"resume", "first/continued"}, 0);
    EXPECT_EQ(file_text(folder_ / "first/continued/parameters.conf"), parameters) << point;
    EXPECT_EQ(file_text(folder_ / "first/continued/recording.tcr"), recording) << point;
  }
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
