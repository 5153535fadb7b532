// `turncal diagnose` as a black box: the effect that the rig was given, with and without plots.

#include "imu_io/base/key_value.h"
#include "imu_io/recordings/parameter_file.h"
#include "tests/orchestrator/program.h"

namespace turncal {
namespace {

class Diagnose : public Program {};

TEST_F(Diagnose, FindsTheDelayThatTheRigWasGivenAndSaysWhatItDid) {
  write("delay.rig", "seed = 7\neffect.accel_delay.tau = 0.3\n");
  ends("run --dry-run --capture-only --unit SN1 --out rec --rig delay.rig", 0);
  const ProgramResult result = ends({"diagnose", "rec", "--out", "out", "--verbose"}, 20);
  EXPECT_EQ(result.err, "");
  const auto conf = entries(file_text(path("out/diagnosis.conf")));
  ASSERT_EQ(conf.at("verdict"), "extended");
  EXPECT_EQ(conf.at("effects"), "accel_delay");
  const double value = std::stod(conf.at("effect.accel_delay.tau"));
  const double sigma = std::stod(conf.at("sigma.effect.accel_delay.tau"));
  EXPECT_NEAR(value, 0.3, 3.5 * sigma);
  EXPECT_LT(sigma, 0.01);
  EXPECT_EQ(conf.at("holdout.source"), "cross-validation over dwells");
  EXPECT_LT(std::stod(conf.at("holdout.after")), std::stod(conf.at("holdout.before")));
  EXPECT_LT(std::stod(conf.at("error.after")), std::stod(conf.at("error.before")));
  // In miles: with one effect, leaving it out is the base model.
  EXPECT_EQ(conf.at("navigation.source"), "fitted recording");
  const double worth = std::stod(conf.at("navigation.accel_delay_nm_per_h"));
  EXPECT_GT(worth, 0.01);
  EXPECT_LT(worth, std::stod(conf.at("navigation.before_nm_per_h")) + std::stod(conf.at("navigation.after_nm_per_h")));
  // The effect is in the parameter file, to the digit, which is marked as simulated.
  const auto parameters = good(read_parameter_file(path("out/parameters.conf")));
  ASSERT_EQ(parameters->effects.size(), 1u);
  EXPECT_EQ(parameters->effects[0].name + "." + parameters->effects[0].component, "accel_delay.tau");
  EXPECT_EQ(parameters->effects[0].value, value);
  EXPECT_EQ(parameters->model, "extended");
  EXPECT_TRUE(parameters->simulated);
  EXPECT_TRUE(parameters->reference_temperature_c);
  // The terminal gets the same, short; its last lines are those of a terminal that did not ask for more.
  const std::string last = "verdict         Extended; parameters trusted\nreason          added: accel_delay, tau 0.3";
  EXPECT_SAYS(result.out, last);
  EXPECT_TRUE(result.out.ends_with(" sigma), probability more than 0.99\nopen out/report.html\n")) << result.out;

  // Again, without gnuplot: another report, the same answer, the same exit code.
  const std::string kept = std::getenv("PATH");
  ::setenv("PATH", path("nowhere").c_str(), 1);
  const ProgramResult without = ends({"diagnose", "rec", "--out", "out"}, 20);
  ::setenv("PATH", kept.c_str(), 1);
  EXPECT_EQ(without.err, "");
  EXPECT_SAYS(without.out, last);
  EXPECT_LE(std::ranges::count(without.out, '\n'), 8) << without.out;
  EXPECT_SAYS(without.out, "report without plots: no plots: gnuplot is not installed");
  EXPECT_EQ(entries(file_text(path("out/diagnosis.conf"))), conf);
  EXPECT_SAYS_NOT(file_text(path("out/report.html")), "<svg");
}

}  // namespace
}  // namespace turncal
