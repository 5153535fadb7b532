// Campaigns in a chamber. What they leave, and what is made of it: tests/golden/campaigns.sh.
#include "tests/orchestrator/program.h"

namespace turncal {
namespace {

class CampaignProgram : public Program {
 protected:
  void SetUp() override {
    Program::SetUp();
    for (const std::string name : {"own", "slow"})
      write(name + ".chamber", "format = 1\nname = " + name +
                                   "\nlink.kind = rig\nlimits.low_c = -40\nlimits.high_c = 85\n"
                                   "limits.ramp_c_per_min = " +
                                   (name == "own" ? "3\n" : "1.6\n"));
    write("own.station",
          station_head + "chamber.file = own.chamber\nchamber.limit_unit_c = 60\nchamber.settle_s = 60\n");
  }
};

// Legs with a station of their own, that measure while the chamber goes its slow way: they find the rate term, and bound that of the others.
TEST_F(CampaignProgram, LegsOnARampFindWhatGoesWithTheRate) {
  write("own.rig",
        "temperature.rise_c = 0\neffect.gyro_bias_temperature.x = 0.01\n"
        "effect.gyro_bias_temperature_rate.x = 0.02\n");
  write("ramp.station", station_head +
                            "chamber.file = slow.chamber\nchamber.limit_unit_c = 60\nchamber.settle_s = 1\n" +
                            "chamber.band_c = 20\n");
  std::string legs = "temperatures_c = 10, 18, 26, 34, 26, 18, 43, 5, 42, 6\nrig = own.rig\n";
  for (const char* const leg : {"7", "8", "9", "10"}) legs += std::string("leg.") + leg + ".station = ramp.station\n";
  write("own.campaign", "format = 1\nunit = SN1\nstation = own.station\nsequence = " + first_steps("8") + "\n" + legs);
  const ProgramResult made = run("campaign own.campaign --out all --dry-run --no-diagnosis");
  ASSERT_EQ(made.code, 0) << made.err << made.out;
  const auto conf = entries(file_text(path("all/thermal.conf")));
  const auto number = [&](const std::string& key) { return std::stod(conf.at(key)); };
  EXPECT_GT(number("leg.7.rate_c_per_h"), 30.0);
  EXPECT_LT(number("leg.8.rate_c_per_h"), -30.0);
  EXPECT_GT(number("probability.N01.rate"), 0.95);
  EXPECT_LT(number("probability.N02.rate"), 0.95);
  EXPECT_LT(number("sigma.N01.rate"), 0.004);
  EXPECT_NEAR(number("coefficient.N01.rate"), 0.02, 4.0 * number("sigma.N01.rate"));
  EXPECT_NEAR(number("coefficient.N01.1"), 0.01, 5.0 * number("sigma.N01.1"));
}

}  // namespace
}  // namespace turncal
