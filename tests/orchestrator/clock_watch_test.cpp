// The civil clock against the monotonic one.
#include "orchestrator/watch/service_watch.h"

#include <gtest/gtest.h>

#include <vector>

namespace turncal {
namespace {

std::vector<double> steps_of(const std::vector<std::pair<double, double>>& times, double speed_up) {
  std::vector<double> steps;
  ClockWatch watch(speed_up, [&steps](double by_s, const RunSnapshot&) { steps.push_back(by_s); });
  for (const auto& [time_s, utc_s] : times) {
    RunSnapshot at;
    at.time_s = time_s;
    at.utc_s = utc_s;
    watch.on_progress(at);
  }
  return steps;
}

TEST(ClockWatch, AStepIsToldOnceAndWithItsSign) {
  EXPECT_TRUE(steps_of({{0.0, 1000.0}, {0.1, 1000.1}, {7200.0, 8200.0}}, 1.0).empty());
  const std::vector<double> forth = steps_of({{0.0, 1000.0}, {0.1, 4600.1}, {0.2, 4600.2}}, 1.0);
  ASSERT_EQ(forth.size(), 1U);
  EXPECT_NEAR(forth[0], 3600.0, 1e-6);
  const std::vector<double> back = steps_of({{0.0, 1000.0}, {10.0, 1008.0}, {11.0, 1009.0}, {12.0, 1009.0}}, 1.0);
  ASSERT_EQ(back.size(), 2U);
  EXPECT_NEAR(back[0], -2.0, 1e-6);
  EXPECT_NEAR(back[1], -1.0, 1e-6);
}

TEST(ClockWatch, ASlowCorrectionIsNone) {
  std::vector<std::pair<double, double>> slewed;  // 500 ppm for two hours: 3.6 s in all
  for (int i = 0; i < 72000; ++i) slewed.emplace_back(0.1 * i, 1000.0 + 0.1 * i * 1.0005);
  EXPECT_TRUE(steps_of(slewed, 1.0).empty());
}

TEST(ClockWatch, StationTimeMayRunFaster) {
  EXPECT_TRUE(steps_of({{0.0, 1000.0}, {50.0, 1001.0}, {5000.0, 1100.0}}, 50.0).empty());
  EXPECT_EQ(steps_of({{0.0, 1000.0}, {50.0, 1011.0}}, 50.0).size(), 1U);
}

}  // namespace
}  // namespace turncal
