// `turncal apply` with effects beyond the 24 parameters.
#include <gtest/gtest.h>

#include <numeric>
#include <sstream>
#include <vector>

#include "imu_io/base/key_value.h"
#include "imu_io/recordings/parameter_file.h"
#include "imu_io/recordings/recording_source.h"
#include "tests/orchestrator/program.h"

namespace turncal {
namespace {

class Apply : public Program {};

// With the effect in the file, what is left in the calibrated increments is the effect-free unit: the x accelerometer up and
// down reads g both ways. Without it the two differ by twice the square term.
TEST_F(Apply, TakesEffectsOff) {
  write("k2.rig",
        "effect.accel_second_order.x = 200\nnoise.gyro_random_walk_deg_per_rt_h = 0\n"
        "noise.accel_random_walk_ug_per_rt_hz = 0\nnoise.gyro_bias_instability_degph = 0\n"
        "noise.accel_bias_instability_ug = 0\ntable_error.random_arcmin = 0\n");
  write("up.seq",
        "format = 1\nname = up\nrate_degps = 10\nacceleration_degps2 = 20\nstep 1\n  initial H 0 P 90 R 0\n"
        "  align 4000\n  rotate P -180\n  dwell 4000\n");
  ASSERT_EQ(run({"run", "--dry-run", "--unit", "SN7", "--out", "k2", "--capture-only", "--rig", path("k2.rig"),
                 "--sequence", path("up.seq")})
                .code,
            0);
  KeyValueFile truth = *KeyValueFile::parse(file_text(folder_ / "k2/truth.conf"), "truth.conf");
  ParameterFile file;
  ASSERT_TRUE(RecordingSource::open(path("k2")).ok());
  describe_recording((*RecordingSource::open(path("k2")))->info(), file);
  for (std::size_t k = 0; k < parameter_keys.size(); ++k)
    file.parameters[static_cast<Eigen::Index>(k)] = truth.number(parameter_keys[k]);
  file.model = "base";
  file.method = "joint";
  file.simulated = true;
  file.recording_hash = std::string(32, '0');
  file.software_version = "test";
  file.time_utc = "2026-01-31T12:00:00Z";
  // Mean of x over the last seconds of both dwells: (up + down) / 2 g, in ug.
  const auto asymmetry_ug = [&](const std::string& name) {
    const Status written = write_parameter_file(file, path(name + ".conf"));
    EXPECT_TRUE(written.ok()) << written.error().message;
    const ProgramResult applied = run({"apply", "k2", "--parameters", path(name + ".conf"), "--out", name + ".csv"});
    EXPECT_EQ(applied.code, 0) << applied.err;
    std::istringstream csv(file_text(folder_ / (name + ".csv")));
    std::string line;
    std::getline(csv, line);
    std::vector<double> x;
    while (std::getline(csv, line)) {
      std::istringstream cells(line);
      std::string cell;
      for (int k = 0; k < 5; ++k) std::getline(cells, cell, ',');
      x.push_back(std::stod(cell));
    }
    const auto mean = [&](std::size_t first) {
      return std::accumulate(x.begin() + static_cast<std::ptrdiff_t>(first),
                             x.begin() + static_cast<std::ptrdiff_t>(first + 3000), 0.0) /
             3000.0;
    };
    return 0.5 * (mean(500) + mean(x.size() - 3500)) / 0.005 / 9.80665e-6;
  };
  const double without = asymmetry_ug("without");
  file.effects.push_back({"accel_second_order", "x", 200.0, 1.0});
  file.model = "extended";
  const double with = asymmetry_ug("with");
  EXPECT_NEAR(without, 200.0, 5.0);  // (9.7914 / 9.80665)^2 of 200, and half a pulse in 15 s
  EXPECT_NEAR(with, 0.0, 4.0);
}

}  // namespace
}  // namespace turncal
