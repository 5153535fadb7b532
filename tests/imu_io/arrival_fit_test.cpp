#include "imu_io/units/arrival_fit.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace turncal {
namespace {

// Delays that are exponential with 2 ms on top of 0.3 ms, as a USB adapter's are; now and then the host is away for 50 ms.
double delay(std::mt19937_64& random) {
  std::exponential_distribution<double> usual(1.0 / 0.002);
  return 0.0003 + usual(random) + (random() % 1000 == 0 ? 0.05 : 0.0);
}

TEST(ArrivalFit, FindsOffsetAndSkewBelowTheDelays) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    for (const double skew : {0.0, 37e-6, -150e-6}) {
      std::mt19937_64 random(seed);
      ArrivalFit fit;
      for (int i = 0; i < 200 * 600; ++i) {
        const double t = 0.005 * i;
        fit.add(t, 1000.0 + (1.0 + skew) * t + delay(random));
      }
      const auto got = fit.estimate();
      ASSERT_TRUE(got.has_value());
      // The smallest of 200 delays is 0.01 ms above the least; 0.1 ms over 600 s is 0.17 ppm.
      EXPECT_NEAR(got->skew, skew, 0.2e-6);
      EXPECT_NEAR(got->offset_s, 1000.0003, 0.0001);
      EXPECT_GT(got->span_s, 595.0);
      EXPECT_LT(std::abs(got->skew - skew), 3.0 * got->skew_uncertainty);
      EXPECT_LT(got->skew_uncertainty, 0.2e-6);
      EXPECT_GT(got->largest_delay_s, 0.05);
      EXPECT_LT(got->largest_delay_s, 0.1);
      EXPECT_LT(std::abs(fit.persistent_delay_s()), 0.001);
    }
  }
}

TEST(ArrivalFit, BatchesOf16MillisecondsDoNotPullIt) {
  ArrivalFit fit;
  for (int i = 0; i < 200 * 300; ++i) {
    const double t = 0.005 * i;
    const double arrives = (1.0 + 20e-6) * t;
    fit.add(t, 0.016 * std::ceil(arrives / 0.016));
  }
  const auto got = fit.estimate();
  ASSERT_TRUE(got.has_value());
  EXPECT_NEAR(got->skew, 20e-6, 1e-6);
  EXPECT_LT(std::abs(got->skew - 20e-6), 3.0 * got->skew_uncertainty);
  EXPECT_NEAR(got->largest_delay_s, 0.016, 0.001);
}

TEST(ArrivalFit, ShowsTimeThatWasLostForGood) {
  std::mt19937_64 random(3);
  ArrivalFit fit;
  for (int i = 0; i < 200 * 30; ++i) fit.add(0.005 * i, 0.005 * i + delay(random));
  EXPECT_LT(fit.persistent_delay_s(), 0.001);
  for (int i = 200 * 30; i < 200 * 35; ++i) fit.add(0.005 * i, 0.128 + 0.005 * i + delay(random));
  EXPECT_NEAR(fit.persistent_delay_s(), 0.128, 0.002);
}

TEST(ArrivalFit, SaysNothingFromTooLittle) {
  ArrivalFit fit;
  EXPECT_FALSE(fit.estimate().has_value());
  for (int i = 0; i < 200; ++i) fit.add(0.005 * i, 0.005 * i);
  EXPECT_FALSE(fit.estimate().has_value());
}

}  // namespace
}  // namespace turncal
