// `turncal verify` as a program: north seeking on the rig, judged; readings of references; and what is refused.

#include "imu_io/base/files.h"
#include "orchestrator/station/number_text.h"
#include "tests/orchestrator/operator_session.h"
#include "tests/orchestrator/results/rig_unit.h"

namespace turncal {
namespace {

constexpr const char* good_rig =
    "noise.gyro_random_walk_deg_per_rt_h = 0.0001\nnoise.gyro_bias_instability_degph = 0\n"
    "noise.accel_random_walk_ug_per_rt_hz = 1\nnoise.accel_bias_instability_ug = 0\n";
constexpr const char* short_seeking =
    "step 1\n  initial H 0 P 0 R 0\n  align 6000\n  align 6000\nstep 2\n  initial H 90 P 0 R 0\n  dwell 6000\n"
    "  dwell 6000\n";

class Verify : public RigUnit {
 protected:
  void SetUp() override {
    RigUnit::SetUp();
    write("good.rig", good_rig);
    write_sequence("short.seq", short_seeking);
    record("one", good_rig, "step 1\n  initial H 0 P 0 R 0\n  align 200\n  dwell 200\n");
  }
  // The unit's true parameters, but for `change` of one of them, with the noise as it is.
  void write_parameters(const std::string& name, int parameter = 0, double change = 0.0) {
    ParameterFile file = truth_of("one");
    for (const char* axis : {"x", "y", "z"}) {
      file.add_further(std::string("noise.angle_random_walk.") + axis + "_deg_per_rt_h", 0.0001);
      file.add_further(std::string("noise.velocity_random_walk.") + axis + "_ug_per_rt_hz", 1.0);
    }
    file.parameters[parameter] += change;
    keep(file, name);
  }
  static Arguments seeking(const std::string& parameters, const std::string& out) {
    return "verify --dry-run --unit SN7 --rig good.rig --sequence short.seq --parameters " + parameters + " --out " +
           out;
  }
};

TEST_F(Verify, SeeksNorthInFourHeadings) {
  write_parameters("true.conf");
  write("paper.station", station_head);
  const ProgramResult verified =
      ends("verify --dry-run --unit SN7 --parameters true.conf --rig good.rig --station paper.station --out v", 0);
  KeyValueFile conf = result("v/verification.conf");
  for (int p = 1; p <= 4; ++p) {
    const std::string prefix = "position." + std::to_string(p) + ".";
    EXPECT_EQ(conf.number(prefix + "table_deg"), 90.0 * (p - 1));
    EXPECT_TRUE(conf.has(prefix + "4.pitch_deg"));
    EXPECT_FALSE(conf.has(prefix + "5.pitch_deg"));
    EXPECT_NEAR(conf.number(prefix + "mean.heading_deg"), 90.0 * (p - 1), 0.012);
    EXPECT_LT(conf.number(prefix + "deviation.heading_deg"), 0.012);
    EXPECT_GT(conf.number(prefix + "sigma.heading_deg"), 0.0005);
  }
  EXPECT_LT(conf.number("mean.heading_deg"), 0.012);
  EXPECT_NEAR(conf.number("felt_latitude_deg"), 29.53, 0.05);
  EXPECT_LT(conf.number("false_fail"), 0.05);
  EXPECT_NEAR(conf.number("align_s"), 300.0, 0.2);
  EXPECT_EQ(conf.number("limit.heading_deg"), 0.012);
  const std::string verdict = conf.text("verdict.result");
  EXPECT_TRUE(verdict == "pass" || verdict == "conditional_pass") << verdict;
  EXPECT_SAYS(verified.out, "[dry run] verdict         " + in_words(verdict));
  EXPECT_SAYS(file_text(folder_ / "v/verification.html"), "Simulated data: this is no verification of a real unit.");
  // Judged again from its recording: the same bytes.
  ASSERT_EQ(run("verify --recording v --parameters " + path("true.conf") + " --out again --station paper.station").code,
            0);
  EXPECT_EQ(file_text(folder_ / "again/verification.conf"), file_text(folder_ / "v/verification.conf"));
  // A gyro bias of 0.02 deg/h is a heading error of 0.09 deg, the other way round at 180.
  write_parameters("wrong.conf", 0, 0.02);
  ends("verify --recording v --parameters wrong.conf --out w --station paper.station", 20, "");
  EXPECT_EQ(result("w/verification.conf").text("verdict.heading"), "fail");
  // The station's own limit, wide enough.
  write("wide.station", "format = 1\n" + std::string("site.latitude_deg = 29.53\nsite.gravity_mps2 = 9.7914\n"
                                                     "table.driver = mock\nimu.driver = rig\nlimit.heading_deg = 1\n"));
  EXPECT_EQ(run("verify --recording v --parameters wrong.conf --out wide --station wide.station").code, 0);
}

TEST_F(Verify, WaitsForNobodyInItsFolder) {
  write_parameters("true.conf");
  std::filesystem::create_directory(folder_ / "busy");
  const Result<LockFile> lock = good(LockFile::acquire(path("busy/.lock")));
  expect_refused("verify --recording one --parameters true.conf --out busy", "in use by", 50);
  expect_refused("navigate one --parameters true.conf --out busy", "in use by", 50);
}

// An alignment that lost samples says nothing of the unit.
TEST_F(Verify, LeavesOutWhatLostSamples) {
  write_parameters("true.conf");
  record("v", good_rig,
         "step 1\n  initial H 0 P 0 R 0\n  align 6000\n  align 6000\n  dwell 6000\n  dwell 6000\n"
         "  dwell 6000\n");
  std::vector<std::int64_t> middle;
  for (const Segment& segment : segments_of("v"))
    if (segment.kind != SegmentKind::rotate) middle.push_back((segment.start_sample + segment.end_sample) / 2);
  ASSERT_EQ(middle.size(), 5U);
  const auto judge = [&](const std::string& recording) {
    std::filesystem::remove_all(folder_ / "judged");
    return run("verify --recording " + recording + " --parameters true.conf --out judged");
  };
  lose("v", middle[3], 1000, "lost");
  const ProgramResult left = judge("lost");
  const std::string said = "step 1: alignment at heading 0: 1000 samples lost from sample " + std::to_string(middle[3]);
  EXPECT_SAYS(left.out, "left out: " + said);
  KeyValueFile conf = result("judged/verification.conf");
  EXPECT_EQ(conf.text("left_out.1"), said + " on");
  EXPECT_TRUE(conf.has("position.1.2.heading_deg"));
  EXPECT_FALSE(conf.has("position.1.3.heading_deg"));
  // One sample is filled in, and said.
  lose("v", middle[3], 1, "one");
  EXPECT_SAYS(judge("one").out, "1 sample lost or bad");
  EXPECT_EQ(result("judged/verification.conf").integer("filled_samples"), 1);
  EXPECT_TRUE(result("judged/verification.conf").has("position.1.3.heading_deg"));
  // So is one that cannot be, and what it gave is said.
  change("v", "hit", middle[3], 2, "200000");  // 52 deg
  const ProgramResult hit = judge("hit");
  EXPECT_SAYS(hit.out, "glitch: gyro y gave 200000 in sample " + std::to_string(middle[3]));
  EXPECT_LT(result("judged/verification.conf").number("deviation.heading_deg"), 0.1);
  // Of two alignments one is left: nobody can say.
  lose("lost", middle[4], 1000, "few");
  const ProgramResult few = judge("few");
  EXPECT_EQ(few.code, 20) << few.err;
  EXPECT_EQ(few.err_lines(), 1) << few.err;
  EXPECT_SAYS(few.err, "not judged: 1 alignment at heading 0, expected at least two");
  lose("v", middle[0], middle[1] - middle[0] + 1, "zero");
  const ProgramResult zero = judge("zero");
  EXPECT_EQ(zero.code, 20) << zero.err;
  EXPECT_SAYS(zero.err, "no search for the zero");
}

// The first record with samples is destroyed: what is left is judged, and it is said what is missing.
TEST_F(Verify, SaysThatTheRecordingIsDamaged) {
  write_parameters("true.conf");
  record("v", good_rig, "step 1\n  initial H 0 P 0 R 0\n  align 6000\n  align 6000\n  dwell 6000\n  dwell 6000\n");
  std::string bytes = file_text(folder_ / "v/recording.tcr");
  bytes[5000] = char(~bytes[5000]);
  std::filesystem::create_directory(folder_ / "damaged");
  write("damaged/recording.tcr", bytes);
  const ProgramResult judged = run("verify --recording damaged --parameters true.conf --out judged");
  EXPECT_SAYS(judged.out, "1 damaged record");
  EXPECT_SAYS(result("judged/verification.conf").text("damage"), "1 damaged record");
  const auto navigated = run("navigate damaged --parameters true.conf --out nav --align 20s --for 20s --branches 1");
  EXPECT_SAYS(navigated.out, "1 damaged record");
}

// Killed anywhere and taken up again: the same outcome, exit code and file.
TEST_F(Verify, GoesOnWithItsOutcome) {
  write_parameters("wrong.conf", 0, 0.1);
  const long points = count_points(seeking("wrong.conf", "whole"), 20);
  for (const long point : {points / 3, 2 * points / 3, points - 12, points - 4, points - 1}) {
    const std::string out = "killed" + std::to_string(point);
    run_struck(seeking("wrong.conf", out), point, "kill");
    const ProgramResult resumed = ends({"resume", out}, 20);
    EXPECT_SAYS(resumed.err, "verification");
    EXPECT_EQ(file_text(folder_ / out / "verification.conf"), file_text(folder_ / "whole/verification.conf")) << point;
    EXPECT_EQ(run({"resume", out}).code, 20) << point;
  }
  // The file that is verified has to be the one that was begun with.
  write_parameters("wrong.conf", 0, 0.2);
  run_struck(seeking("wrong.conf", "changed"), points / 2, "kill");
  write_parameters("wrong.conf", 0, 0.3);
  ends("resume changed", 1, "wrong.conf: is not the parameter file that");
}

// The table is turned by hand: the operator types the angles that he is asked for.
class VerifyByHand : public OperatedProgram {};
TEST_F(VerifyByHand, AsOnATable) {
  write("good.rig", good_rig);
  ASSERT_EQ(run("run --dry-run --unit SN7 --rig good.rig --no-diagnosis --out c").code, 0);
  write("short.seq",
        std::string("format = 1\nname = short\nrate_degps = 10\nacceleration_degps2 = 20\n") + short_seeking);
  const Session session = operate(
      "verify --dry-run --manual --unit SN7 --rig good.rig --parameters c/parameters.conf --sequence short.seq --out v",
      [](const std::string& line) -> std::optional<std::string> {
        const std::optional<Question> asked = question(line);
        if (!asked) return {};
        return std::to_string(asked->target_deg);
      });
  EXPECT_TRUE(session.code == 0 || session.code == 20) << session.err << session.out;
  EXPECT_SAYS(session.out, "heading         largest deviation");
  EXPECT_TRUE(std::filesystem::exists(folder_ / "v/verification.conf"));
}

}  // namespace
}  // namespace turncal
