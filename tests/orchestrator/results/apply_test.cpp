// `turncal apply` with effects beyond the 24 parameters.

#include "imu_io/recordings/parameter_file.h"
#include "tests/imu_io/recording_samples.h"
#include "tests/orchestrator/program.h"
#include "tests/orchestrator/results/rig_unit.h"

namespace turncal {
namespace {

class Apply : public RigUnit {
 protected:
  // The head and the rows of a table.
  std::pair<std::string, std::vector<std::string>> csv(const std::string& name) const {
    std::vector<std::string> lines = lines_of(file_text(folder_ / (name + ".csv")));
    return {lines.at(0), {lines.begin() + 1, lines.end()}};
  }
  static std::vector<ImuSample> samples_of(const std::string& recording) {
    return test::read_all(*test::opened(recording));
  }
};

// With the effect in the file, what is left in the calibrated increments is the effect-free unit: the x accelerometer up and
// down reads g both ways. Without it the two differ by twice the square term.
TEST_F(Apply, TakesEffectsOff) {
  record("k2", std::string(without_noise) + "effect.accel_second_order.x = 200\n",
         "step 1\n  initial H 0 P 90 R 0\n  align 4000\n  rotate P -180\n  dwell 4000\n");
  ParameterFile file = truth_of("k2");
  // Mean of x over the last seconds of both dwells: (up + down) / 2 g, in ug.
  const auto asymmetry_ug = [&](const std::string& name) {
    keep(file, name + ".conf");
    ends({"apply", "k2", "--parameters", path(name + ".conf"), "--out", name + ".csv"}, 0);
    std::vector<double> x;
    for (const std::string& row : csv(name).second) x.push_back(std::stod(lines_of(row, ',')[4]));
    const auto mean = [&](std::size_t first) {
      return std::accumulate(x.begin() + std::ptrdiff_t(first), x.begin() + std::ptrdiff_t(first + 3000), 0.0) / 3000.0;
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

// Times and rates: an increment over the period, in each form; and of a recording whose clock is 100 ppm off the parameters'.
TEST_F(Apply, WritesTimeAndRates) {
  record("rec", std::string(without_noise), "step 1\n  initial H 30 P 0 R 0\n  align 5000\n  dwell 5000\n");
  ParameterFile file = truth_of("rec");
  file.sample_period_s *= 1.0001;
  keep(file, "true.conf");
  const auto rows = [&](const std::string& as) {
    ends({"apply", "rec", "--parameters", path("true.conf"), "--out", as + ".csv", "--as", as}, 0);
    const auto [head, lines] = csv(as);
    std::vector<double> cells;
    for (const std::string& row : lines)
      for (const std::string& cell : lines_of(row, ',')) cells.push_back(std::stod(cell));
    return std::pair(head, cells);
  };
  const auto [head, rates] = rows("rates");
  const auto [other_head, increments] = rows("increments");
  EXPECT_TRUE(head.starts_with("time_s,rate_x_radps,rate_y_radps,rate_z_radps,force_x_mps2")) << head;
  EXPECT_TRUE(other_head.starts_with("time_s,dtheta_x_rad,dtheta_y_rad,dtheta_z_rad,dv_x_mps")) << other_head;
  const auto width = std::size_t(std::ranges::count(head, ',') + 1);
  ASSERT_EQ(rates.size(), 10000 * width);
  for (std::size_t row = 0; row < 10000; row += 999)
    for (std::size_t k = 0; k < 7; ++k)
      EXPECT_DOUBLE_EQ(rates[row * width + k], k == 0 ? 0.005 * double(row) : increments[row * width + k] / 0.005);
  for (const char* out : {"r.npy", "r.mat"})
    ends({"apply", "rec", "--parameters", path("true.conf"), "--out", out, "--as", "rates"}, 0);
}

// As messages of ROS: imported again they are the same samples, and so is the clock.
TEST_F(Apply, WritesMessagesThatImportReads) {
  record("rec", std::string(without_noise), "step 1\n  initial H 30 P 0 R 0\n  align 5000\n  dwell 5000\n");
  keep(truth_of("rec"), "true.conf");
  ends("apply rec --parameters true.conf --out r.mcap --as rates", 0);
  ends("apply rec --parameters true.conf --out r.tcr", 0);
  EXPECT_SAYS(ends("import r.mcap --out back", 0).out, "10000 samples of 10000 rows, mean period 5 ms");
  const std::vector<ImuSample> written = samples_of(path("r.tcr")), read = samples_of(path("back"));
  ASSERT_EQ(read.size(), written.size());
  for (std::size_t row = 0; row < read.size(); row += 7) {
    EXPECT_EQ(read[row].counter - read[0].counter, written[row].counter - written[0].counter);
    EXPECT_EQ(read[row].temperature_c, written[row].temperature_c);
    for (std::size_t k = 0; k < 3; ++k) {
      EXPECT_NEAR(read[row].gyro[k], written[row].gyro[k], 1e-12 * std::abs(written[row].gyro[k]));
      EXPECT_NEAR(read[row].accel[k], written[row].accel[k], 1e-12 * std::abs(written[row].accel[k]));
    }
  }
}

// The same increments, whatever the form; as a recording they are one that can be navigated.
TEST_F(Apply, WritesARecordingOrAMatrix) {
  record("rec", std::string(without_noise), "step 1\n  initial H 30 P 0 R 0\n  align 10000\n  dwell 10000\n");
  keep(truth_of("rec"), "true.conf");
  for (const char* out : {"a.csv", "a.tcr", "a.npy", "a.mat"})
    ends({"apply", "rec", "--parameters", path("true.conf"), "--out", out}, 0);
  const std::vector<std::string> table = csv("a").second;
  const auto source = good(RecordingSource::open(path("a.tcr")));
  EXPECT_EQ((*source)->info().gyro_increment, IncrementKind::physical);
  EXPECT_EQ((*source)->info().accel_increment, IncrementKind::physical);
  EXPECT_TRUE((*source)->info().simulated);
  EXPECT_EQ((*source)->segments().size(), segments_of("rec").size());
  std::size_t rows = 0;
  ASSERT_TRUE((*source)
                  ->read([&](std::span<const ImuSample> block) {
                    for (const ImuSample& sample : block) {
                      const std::vector<std::string> cells = lines_of(table.at(rows++), ',');
                      EXPECT_EQ(std::stoll(cells.at(0)), sample.counter);
                      for (std::size_t k = 0; k < 3; ++k) {
                        EXPECT_EQ(std::stod(cells.at(1 + k)), sample.gyro[k]);
                        EXPECT_EQ(std::stod(cells.at(4 + k)), sample.accel[k]);
                      }
                    }
                    return Status{};
                  })
                  .ok());
  EXPECT_GE(rows, 20000u);
  EXPECT_EQ(rows, table.size());
}

// Samples that are marked as bad stay marked, in each form; to ROS a bad one is not measured.
TEST_F(Apply, KeepsFlags) {
  record("rec", std::string(without_noise), "step 1\n  initial H 30 P 0 R 0\n  align 1000\n  dwell 1000\n");
  keep(truth_of("rec"), "true.conf");
  const auto source = good(RecordingSource::open(path("rec")));
  std::vector<ImuSample> samples = samples_of(path("rec"));
  samples[100].flags = samples[101].flags = sample_flag_invalid;
  auto writer = good(RecordingWriter::create(path("marked.tcr"), (*source)->info()));
  ASSERT_OK(writer->add(samples));
  ASSERT_OK(writer->finish());
  for (const std::string as : {"rates", "increments"}) {
    ends({"apply", "marked.tcr", "--parameters", path("true.conf"), "--out", as + ".csv", "--as", as}, 0);
    const auto [head, rows] = csv(as);
    EXPECT_TRUE(head.ends_with(",flags")) << head;
    for (const std::size_t row : {99, 100, 101, 102})
      EXPECT_EQ(rows[row].ends_with(",1"), row == 100 || row == 101) << rows[row];
  }
  ends("apply marked.tcr --parameters true.conf --out m.mcap --as rates", 0);
  expect_refused("import m.mcap --out back", "is not measured, says its covariance");
  EXPECT_SAYS(ends("import m.mcap --out back --skip-bad-rows", 0).out, "2 bad rows skipped");
}

TEST_F(Apply, ExportWritesAMatrix) {
  record("rec", std::string(without_noise), "step 1\n  initial H 30 P 0 R 0\n  align 1000\n  dwell 1000\n");
  ASSERT_EQ(run("export rec --out e.npy").code, 0);
  ASSERT_TRUE(std::filesystem::is_regular_file(folder_ / "e.npy"));
  ASSERT_EQ(run("export rec --out e.mat").code, 0);
  if (std::system("python3 -c 'import numpy' 2> /dev/null") != 0) GTEST_SKIP() << "numpy is not here";
  ASSERT_EQ(run("export rec --out text").code, 0);
  write("compare.py",
        "import numpy\na = numpy.load('e.npy')\nb = numpy.loadtxt('text/imu.csv', delimiter=',', skiprows=1)\n"
        "assert a.dtype == numpy.float64 and a.shape == (b.shape[0], b.shape[1] + 1)\n"
        "assert (a[:, 0] == b[:, 0]).all() and (a[:, 2:8] == b[:, 1:7]).all()\n"
        "assert numpy.allclose(a[:, 8], b[:, 7], atol=1e-3)\n"
        "assert set(a[:, 1]) == set(range(1, int(a[:, 1].max()) + 1))\n");
  EXPECT_EQ(std::system(("cd " + folder_.string() + " && python3 compare.py").c_str()), 0);
}

}  // namespace
}  // namespace turncal
