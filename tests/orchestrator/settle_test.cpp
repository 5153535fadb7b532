// A run that adds legs to tell apart what its diagnosis cannot: what it says, what it keeps, and the same after a kill.
#include "calib/evidence/diagnosis.h"
#include "tests/orchestrator/program.h"

namespace turncal {
namespace {

TEST(Doubt, IsAClassOfNamesOrABranchThatIsSaidWithoutOne) {
  Diagnosis d;
  d.verdict = Verdict::extended;
  d.effect_names = {"gyro_warm_up", "accel_third_order"};
  d.aliases = {{"gyro_warm_up", {}}, {"accel_third_order", {"accel_odd_quadratic"}}};
  ASSERT_TRUE(doubt_of(d));
  EXPECT_EQ(words_of(*doubt_of(d)), "accel_third_order or accel_odd_quadratic");
  d.aliases["accel_third_order"].clear();
  EXPECT_FALSE(doubt_of(d));
  d.verdict = Verdict::unexplained;
  d.statements.nodes = {{"accelerometer y", "bias", "force", "", 0.99},
                        {"accelerometer y", "bias", "force", "accel_scale_asymmetry", 0.4},
                        {"accelerometer y", "bias", "force", "accel_second_order", 0.6},
                        {"gyro x", "bias", "time", "gyro_bias_drift", 0.3}};
  ASSERT_TRUE(doubt_of(d));
  EXPECT_EQ(words_of(*doubt_of(d)), "accel_second_order or accel_scale_asymmetry");
  d.statements.nodes.front().probability = 0.9;  // not said
  EXPECT_FALSE(doubt_of(d));
  d.statements.nodes.front().probability = 0.99;
  d.verdict = Verdict::noise_model;
  EXPECT_FALSE(doubt_of(d));
}

class Settle : public Program {
 protected:
  Arguments begin(const std::string& out) const {
    return {"run", "--dry-run", "--unit", "SN1", "--out", out, "--rig", "doubt.rig", "--settle", "10"};
  }
  void SetUp() override {
    Program::SetUp();
    write("doubt.rig", "seed = 4\nnoise.seed = 104\neffect.accel_third_order.y = -90\n");
  }
};

TEST_F(Settle, AddsTheLegsOnceSaysWhatIsKnownAndIsTheSameAfterAKill) {
  const ProgramResult whole = run(begin("whole"));
  EXPECT_SAYS(whole.out, "in doubt: ");
  EXPECT_SAYS(whole.out, "In doubt was ");
  EXPECT_SAYS(whole.out, " of legs were added; it is ");
  const std::string parameters = file_text(folder_ / "whole/parameters.conf");
  EXPECT_SAYS(parameters, "record.settle.1 = ");
  const auto lines_with = [&](const std::string& word) {
    long count = 0;
    for (const std::string& line : lines_of(run({"journal", "whole"}).out))
      count += line.find(word) != std::string::npos;
    return count;
  };
  EXPECT_EQ(lines_with(" settle "), 1);
  const long points = count_points(begin("count"), whole.code);
  // While the legs are walked, and when everything is recorded.
  for (const long point : {points - 60, points - 4}) {
    SCOPED_TRACE(point);
    ASSERT_EQ(run_struck(begin("killed"), point, "kill").code, -1000 - SIGKILL);
    EXPECT_EQ(run({"resume", "killed"}).code, whole.code);
    EXPECT_EQ(file_text(folder_ / "killed/parameters.conf"), parameters);
    EXPECT_EQ(file_text(folder_ / "killed/recording.tcr"), file_text(folder_ / "whole/recording.tcr"));
    std::filesystem::remove_all(folder_ / "killed");
  }
}

TEST_F(Settle, IsRefusedWhereNoDiagnosisIsMade) {
  for (const char* option : {"--capture-only", "--partial", "--no-diagnosis"})
    expect_refused(begin("out") + option, "--settle: expected a table that turns by itself");
}

}  // namespace
}  // namespace turncal
