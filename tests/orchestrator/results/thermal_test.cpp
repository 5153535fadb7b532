// `turncal thermal` on parameter files as calibrations leave them, and `apply` with what it writes.
#include <fmt/format.h>

#include "calib/model/parameters.h"
#include "tests/orchestrator/program.h"
#include "tests/orchestrator/results/rig_unit.h"

namespace turncal {
namespace {

class ThermalCommand : public RigUnit {
 protected:
  // A folder with the parameter file of a calibration at this temperature: N01 falls by 0.004 deg/h a C, a22 has a square.
  ParameterFile leg(const std::string& name, double temperature_c, int number, bool thermometer = true) {
    std::mt19937_64 random(static_cast<std::uint64_t>(number));
    std::normal_distribution<double> normal;
    ParameterFile file = truth_of("rec");
    const double x = temperature_c - 20.0;
    file.parameters[0] -= 0.004 * x;
    file.parameters[19] += 1e-6 * x + 4e-8 * x * x;
    for (int k = 0; k < parameter_count; ++k) {
      if (!parameter_is_free[std::size_t(k)]) continue;
      const double sigma = k < 3 ? 2e-3 : 3e-7;
      file.parameters[k] += sigma * normal(random);
      file.sigma[std::size_t(k)] = sigma;
    }
    for (std::size_t i = 0; i < free_parameters().size(); ++i) {
      std::string row;
      for (std::size_t j = 0; j <= i; ++j)
        row += fmt::format("{}{}", j == 0 ? "" : " ",
                           i == j ? std::pow(*file.sigma[std::size_t(free_parameters()[i])], 2) : 0.0);
      file.add_further("quality.covariance." + parameter_key(free_parameters()[i]), row);
    }
    file.add_further("quality.trusted", std::string("true"));
    file.recording_hash = fmt::format("{:032}", number);
    if (thermometer) file.reference_temperature_c = temperature_c;
    std::filesystem::create_directories(folder_ / name);
    keep(file, name + "/parameters.conf");
    return file;
  }
};

TEST_F(ThermalCommand, FromLegsToAFileThatFollowsTheTemperature) {
  record("rec", std::string(without_noise) + "temperature.start_c = 40\ntemperature.rise_c = 0\n",
         "step 1\n  initial H 0 P 0 R 0\n  align 4000\n  dwell 16000\n");
  std::string legs;
  const double temperatures[] = {-20.0, 0.0, 20.0, 40.0, 60.0, 50.0, 30.0, 10.0, -10.0};
  for (int k = 0; k < 9; ++k)
    leg("leg" + std::to_string(k), temperatures[k], k + 1, k != 4), legs += " leg" + std::to_string(k);
  const ParameterFile truth = truth_of("rec");
  expect_refused("thermal" + Arguments(legs) + "--out warm",
                 "leg4: has no thermometer: expected --temperature leg4=VALUE");
  ParameterFile other = leg("other", 5.0, 20);
  other.effects = {{"accel_second_order", "x", 20.0, 1.0}};
  keep(other, "other/parameters.conf");
  expect_refused("thermal leg0 other --out warm", "has effects beside its parameters");
  write("leg4/leg.conf", "temperature_c = 60\ndirection = sideways\n");
  expect_refused("thermal" + Arguments(legs) + "--out warm", "leg.conf:2: key 'direction' = 'sideways'");
  write("leg4/leg.conf", "temperature_c = 60\ndirection = up\nrate_c_per_h = 0\n");

  const ProgramResult made = ends("thermal" + Arguments(legs) + "--out warm --reference 20", 0);
  EXPECT_SAYS(made.out, "Legs: 9, at 9 temperatures, -20.0 to 60.0 C, parameters at 20.0 C");
  const auto conf = entries(file_text(folder_ / "warm/thermal.conf"));
  const ParameterFile warm = *read_parameter_file(path("warm/parameters.conf"));
  ASSERT_TRUE(warm.temperature);
  EXPECT_EQ(warm.temperature->reference_c, 20.0);
  EXPECT_NEAR(warm.temperature->coefficient(0, 0), -0.004, 4.0 * warm.temperature->sigma(0, 0));
  EXPECT_NEAR(warm.temperature->coefficient(19, 1), 4e-8, 4.0 * warm.temperature->sigma(19, 1));
  EXPECT_EQ(conf.at("leg.2.direction"), "up");
  EXPECT_EQ(conf.at("leg.7.direction"), "down");
  EXPECT_GT(std::stod(conf.at("left_out.a22.constant")), 10.0 * std::stod(conf.at("left_out.a22.with_temperature")));
  EXPECT_GT(std::stod(conf.at("navigation.constant_nm_per_h")),
            3.0 * std::stod(conf.at("navigation.with_temperature_nm_per_h")));
  EXPECT_SAYS(file_text(folder_ / "warm/thermal.html"), "<svg");

  // At 40 C the accelerometers and gyros are those of the polynomials there.
  ends("convert warm/parameters.conf --header warm.h", 0);
  EXPECT_SAYS(file_text(folder_ / "warm.h"), "turncal_temperature_N0_degph[3][3]");
  ParameterFile there = warm;
  there.temperature.reset();
  there.parameters = warm.temperature->at(warm.parameters, 40.0);
  keep(there, "there.conf");
  const ProgramResult applied = ends("apply rec --parameters warm/parameters.conf --out warm.csv", 0);
  EXPECT_SAYS(applied.out, "at the temperature of each sample, 40.00 to 40.00 C");
  EXPECT_SAYS_NOT(applied.out, "OUTSIDE");
  ends("apply rec --parameters there.conf --out there.csv", 0);
  EXPECT_EQ(file_text(folder_ / "warm.csv"), file_text(folder_ / "there.csv"));
  ParameterFile narrow = warm;
  narrow.temperature->high_c = 30.0;
  keep(narrow, "narrow.conf");
  EXPECT_SAYS(ends("apply rec --parameters narrow.conf --out narrow.csv", 0).out,
              "OUTSIDE THE RANGE of -20.00 to 30.00 C");
  // A thermometer that falls silent for more than a minute is no thermometer.
  ends("export rec --out text", 0);
  std::vector<std::string> rows = lines_of(file_text(folder_ / "text/imu.csv"));
  std::string silent;
  for (std::size_t k = 0; k < rows.size(); ++k)
    silent += (k > 100 && k < 100 + 14000 ? rows[k].substr(0, rows[k].rfind(',') + 1) : rows[k]) + "\n";
  write("text/imu.csv", silent);
  EXPECT_SAYS(run("apply text --parameters warm/parameters.conf --out silent.csv").err, "has none for ");
}

// ---- campaigns: the legs are made first ----

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
