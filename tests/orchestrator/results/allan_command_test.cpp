// `turncal allan` as a program.

#include <random>

#include "tests/orchestrator/results/rig_unit.h"

namespace turncal {
namespace {

class AllanCommand : public RigUnit {};

// A unit of the rig that counts pulses: N within its sigma's reach, in words, JSON and files; beside it another recording, or parameters.
TEST_F(AllanCommand, SaysWhatTheRigLaid) {
  record("rest", "noise.gyro_random_walk_deg_per_rt_h = 0.05\nnoise.accel_random_walk_ug_per_rt_hz = 50\n",
         "step 1\n  initial H 30 P 0 R 0\n  align 10000\n  dwell 110000\n");
  const ProgramResult said = ends("allan rest --out noise --against rest", 0);
  EXPECT_SAYS(said.out, "N random walk");
  EXPECT_SAYS(said.out, "gyroscope_noise_density");
  for (const char* file : {"allan.html", "allan.svg", "allan.csv", "imu.yaml"})
    EXPECT_TRUE(std::filesystem::exists(folder_ / "noise" / file)) << file;
  const std::string yaml = file_text(folder_ / "noise/imu.yaml");
  const auto value_of = [&](const std::string& key) { return std::stod(yaml.substr(yaml.find(key) + key.size() + 1)); };
  EXPECT_NEAR(value_of("gyroscope_noise_density"), 0.05 / 60.0 * 3.14159265 / 180.0, 1e-6);
  EXPECT_NEAR(value_of("accelerometer_noise_density"), 50.0 * 9.80665e-6, 1e-5);
  EXPECT_EQ(value_of("update_rate"), 200.0);
  const ProgramResult json = ends("allan rest --format json", 0);
  EXPECT_SAYS(json.out, "\"limit 95 %\"");
  ParameterFile file = truth_of("rest");
  keep(file, "silent.conf");
  expect_refused("allan rest --against silent.conf", "has no noise. keys");
  file.add_further("noise.angle_random_walk.x_deg_per_rt_h", 0.25);
  keep(file, "noisy.conf");
  const ProgramResult beside = run("allan rest --against noisy.conf");
  EXPECT_SAYS(beside.out, "x, file");
  EXPECT_SAYS(beside.out, "0.25");
  ends("export rest --out text", 0);
  write("text/recording.conf", replaced(file_text(folder_ / "text/recording.conf"), "mps = 0.0", "mps = 0.1"));
  EXPECT_SAYS(run("allan text").out, "units: gravity reads");
}

// Whatever its size, down to 28 sigma of a sample. A limit is no number to read as one.
TEST_F(AllanCommand, OneWildSampleIsLeftOut) {
  write("map.conf",
        "gyro.columns = 1, 2, 3\ngyro.unit = rad/s\naccel.columns = 4, 5, 6\naccel.unit = m/s^2\nrate_hz = 50\n"
        "csv.header_lines = 0\ngravity_mps2 = 9.8\nunit_serial = A\n");
  for (const double wild_radps : {0.02, 1.0, 50.0}) {
    SCOPED_TRACE(wild_radps);
    std::mt19937 random(4);
    std::normal_distribution<double> gyro(0.0, 7e-4), accel(0.0, 7e-3);
    std::string csv;
    for (int k = 0; k < 3000; ++k)
      csv += fmt::format("{},{},{},{},{},{}\n", gyro(random) + (k == 1500 ? wild_radps : 0.0), gyro(random),
                         gyro(random), accel(random), accel(random), 9.8 + accel(random));
    write("wild.csv", csv);
    const ProgramResult json = ends("allan wild.csv --map map.conf --format json", 0);
    EXPECT_SAYS(json.out, "1 samples left out");
    EXPECT_SAYS(json.out, "\"gyroscope_random_walk\",\"value\":\"\\u003c ");
  }
}

}  // namespace
}  // namespace turncal
