// The rig's own elementary functions and random numbers.
#include "turntable_drivers/rig/rig_math.h"

#include <cmath>

#include <gtest/gtest.h>

namespace turncal::rig_model {
namespace {

TEST(RigMath, SineAndCosineAgreeWithTheLibrary) {
  for (int i = -200000; i <= 200000; i += 7) {
    const double x = 1e-3 * i;
    EXPECT_NEAR(sin_cos(x).sin, std::sin(x), 3e-16) << x;
    EXPECT_NEAR(sin_cos(x).cos, std::cos(x), 3e-16) << x;
  }
}

TEST(RigMath, DegreesAreExactAtQuarterTurns) {
  const double sine[] = {0.0, 1.0, 0.0, -1.0};
  for (int quarter = -40; quarter <= 40; ++quarter) {
    const SinCos value = sin_cos_deg(90.0 * quarter);
    EXPECT_EQ(value.sin, sine[quarter & 3]) << quarter;
    EXPECT_EQ(value.cos, sine[(quarter + 1) & 3]) << quarter;
  }
  EXPECT_NEAR(sin_cos_deg(30.0).sin, 0.5, 1e-16);
  EXPECT_NEAR(sin_cos_deg(-1080.0 + 60.0).cos, 0.5, 2e-16);
}

TEST(RigMath, ExponentialAndLogarithmAgreeWithTheLibrary) {
  for (int i = -7000; i <= 7000; ++i) {
    const double x = 0.0993 * i;
    EXPECT_NEAR(exp_of(x) / std::exp(x), 1.0, 4e-16) << x;
    EXPECT_NEAR(log_of(std::exp(x)), std::log(std::exp(x)), 4e-16 * (1.0 + std::abs(x))) << x;
  }
  EXPECT_EQ(exp_of(0.0), 1.0);
  EXPECT_EQ(exp_of(-1000.0), 0.0);
  EXPECT_EQ(log_of(1.0), 0.0);
}

TEST(RigMath, FloorIsTheLibrarysFloor) {
  for (double x : {0.0, 0.5, 0.999, 1.0, -0.001, -1.0, -1.5, 97.9157, -2.0}) EXPECT_EQ(floor_of(x), std::floor(x)) << x;
}

// Outputs of the authors' reference program for the state 1, 2, 3, 4.
TEST(RigRandom, GeneratorGivesThePublishedNumbers) {
  RandomStream random(std::array<std::uint64_t, 4>{1, 2, 3, 4});
  EXPECT_EQ(random.next(), 41943041u);
  EXPECT_EQ(random.next(), 58720359u);
  EXPECT_EQ(random.next(), 3588806011781223u);
  EXPECT_EQ(random.next(), 3591011842654386u);
  EXPECT_EQ(random.next(), 9228616714210784205u);
}

// 4 million numbers: mean within 4 sigma = 0.002, variance 4 sqrt(2/n) = 0.0028, kurtosis 4 sqrt(24/n) = 0.0098, and
// the counts of 24 classes and both tails by chi-square (25 degrees of freedom: 99.99 % below 60).
TEST(RigRandom, NormalNumbersAreNormal) {
  constexpr int count = 4000000;
  RandomStream random(7, 1);
  double sum = 0.0, squares = 0.0, fourths = 0.0;
  std::array<double, 26> classes{};  // below -3, 24 classes of 0.25, above 3
  for (int i = 0; i < count; ++i) {
    const double z = random.normal();
    sum += z;
    squares += z * z;
    fourths += z * z * z * z;
    const double place = std::floor((z + 3.0) / 0.25);
    classes[static_cast<std::size_t>(std::fmin(25.0, std::fmax(0.0, place + 1.0)))] += 1.0;
  }
  EXPECT_NEAR(sum / count, 0.0, 0.002);
  EXPECT_NEAR(squares / count, 1.0, 0.0028);
  EXPECT_NEAR(fourths / count, 3.0, 0.0098);
  const auto cdf = [](double z) { return 0.5 * std::erfc(-z / std::sqrt(2.0)); };
  double chi_square = 0.0;
  for (std::size_t i = 0; i < classes.size(); ++i) {
    const double low = i == 0 ? 0.0 : cdf(-3.0 + 0.25 * (static_cast<double>(i) - 1.0));
    const double high = i == 25 ? 1.0 : cdf(-3.0 + 0.25 * static_cast<double>(i));
    const double expected = count * (high - low);
    chi_square += (classes[i] - expected) * (classes[i] - expected) / expected;
  }
  EXPECT_LT(chi_square, 60.0);
}

// Beyond 3.6542 the numbers come from the tail branch: P(abs(z) > 3.8) = 1.447e-4, of 8 million 1158 +- 4 * 34.
TEST(RigRandom, TailHasTheRightWeight) {
  RandomStream random(11, 2);
  int beyond = 0, far_beyond = 0;
  for (int i = 0; i < 8000000; ++i) {
    const double size = std::abs(random.normal());
    if (size > 3.8) ++beyond;
    if (size > 4.5) ++far_beyond;  // P = 6.795e-6: 54 +- 4 * 7.4
  }
  EXPECT_NEAR(beyond, 1158, 136);
  EXPECT_NEAR(far_beyond, 54, 30);
}

TEST(RigRandom, StreamsOfOneSeedDiffer) {
  RandomStream a(5, 1), b(5, 2), same(5, 1);
  double product = 0.0;
  for (int i = 0; i < 100000; ++i) {
    const double x = a.normal();
    product += x * b.normal();
    EXPECT_EQ(x, same.normal());
  }
  EXPECT_NEAR(product / 100000.0, 0.0, 4.0 / std::sqrt(100000.0));
}

}  // namespace
}  // namespace turncal::rig_model
