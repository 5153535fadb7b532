// The rig against a recording of a simulator that shares nothing with it: the same unit through the same motion must
// give the same pulses, but for the noise and the few arc minutes of that simulator's table errors. A wrong sign of an
// axis, of a bias or of an installation error would show many times over.
#include <charconv>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "tests/turntable_drivers/rig/perfect_rig.h"
#include "turntable_drivers/rig/rig.h"

namespace turncal {
namespace {

namespace fs = std::filesystem;

struct Row {
  std::string kind;
  std::int64_t start, end;
  std::array<double, 3> angles_deg;
};

std::vector<Row> read_segments(const fs::path& path) {
  std::ifstream file(path);
  std::string line;
  std::getline(file, line);
  std::vector<Row> rows;
  while (std::getline(file, line)) {
    std::istringstream fields(line);
    std::array<std::string, 7> text;
    for (std::string& field : text) std::getline(fields, field, ',');
    rows.push_back({text[1],
                    std::stoll(text[2]),
                    std::stoll(text[3]),
                    {std::stod(text[4]), std::stod(text[5]), std::stod(text[6])}});
  }
  return rows;
}

// Sums of the six pulse columns, one more than rows.
std::vector<std::array<double, 6>> read_sums(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  const std::string text((std::istreambuf_iterator<char>(file)), {});
  std::vector<std::array<double, 6>> sums(1);
  for (std::size_t at = text.find('\n') + 1; at < text.size(); at = text.find('\n', at) + 1) {
    std::array<double, 6> next = sums.back();
    std::size_t field = text.find(',', at) + 1;
    for (double& sum : next) {
      double value = 0.0;
      std::from_chars(text.data() + field, text.data() + text.size(), value);
      sum += value;
      field = text.find_first_of(",\n", field) + 1;
    }
    sums.push_back(next);
  }
  return sums;
}

TEST(RigAgainstAnotherSimulator, SameUnitSameMotionSamePulses) {
  const fs::path folder = fs::path(TURNCAL_SOURCE_DIR) / "../shared/data/recordings/clean";
  if (!fs::exists(folder / "imu.csv")) GTEST_SKIP() << "no recordings beside the repository";
  RigConfig config = perfect_rig_config();
  std::ifstream truth(folder / "truth.conf");
  for (std::string line; std::getline(truth, line);) {
    for (std::size_t i = 0; i < 24; ++i) {
      const std::string start = std::string(rig_truth_keys[i]) + " = ";
      if (line.rfind(start, 0) == 0) config.truth[i] = std::stod(line.substr(start.size()));
    }
  }
  const auto segments = read_segments(folder / "segments.csv");
  const auto theirs = read_sums(folder / "imu.csv");
  ASSERT_EQ(segments.size(), 106u);
  ASSERT_EQ(theirs.size(), static_cast<std::size_t>(segments.back().end) + 1);

  Rig rig(config);
  std::array<double, 3> angles_deg{};
  std::vector<ImuSample> samples;
  for (const Row& segment : segments) {
    for (Axis axis : all_axes) {
      const std::size_t i = index(axis);
      if (segment.angles_deg[i] != angles_deg[i]) rig.command_move(axis, segment.angles_deg[i], 10.0, 10.0);
    }
    angles_deg = segment.angles_deg;
    samples.resize(static_cast<std::size_t>(segment.end - segment.start));
    rig.advance(samples);
    for (Axis axis : all_axes) EXPECT_FALSE(rig.axis(axis).moving);
    std::array<double, 6> ours{};
    for (const ImuSample& sample : samples) {
      for (std::size_t k = 0; k < 3; ++k) {
        ours[k] += sample.gyro[k];
        ours[3 + k] += sample.accel[k];
      }
    }
    const double seconds = 0.005 * static_cast<double>(samples.size());
    for (std::size_t k = 0; k < 6; ++k) {
      const double difference = theirs[static_cast<std::size_t>(segment.end)][k] -
                                theirs[static_cast<std::size_t>(segment.start)][k] - ours[k];
      const std::string where = "samples " + std::to_string(segment.start) + " on, column " + std::to_string(k);
      if (k >= 3) {
        EXPECT_NEAR(difference * 0.0005 / seconds, 0.0, 0.03) << where;  // m/s^2: 10 arc minutes of g
      } else if (segment.kind == "rotate") {
        EXPECT_NEAR(difference * 0.932920 / 3600.0, 0.0, 0.45) << where;  // deg in up to 360
      } else {
        EXPECT_NEAR(difference * 0.932920 / seconds, 0.0, 0.09) << where;  // deg/h: tilt 0.04, noise 0.012
      }
    }
  }
}

}  // namespace
}  // namespace turncal
