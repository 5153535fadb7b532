// Allan deviation against published values, its degrees of freedom against published formulas, and the coefficients against what the rig laid.
#include "calib/statistics/allan.h"

#include "tests/test.h"
#include "turntable_drivers/rig/rig_sensors.h"

namespace turncal {
namespace {

// NIST Special Publication 1065 (Riley, 2008), 12.4: the set NBS14, and the 1000 numbers of n <- 16807 n mod 2147483647, n0 = 1234567890.
// https://tf.nist.gov/general/pdf/2220.pdf; AllanTools tests the same values.
TEST(Allan, PublishedSets) {
  const auto deviation = [](const std::vector<double>& cells, std::size_t point) {
    RestCells rest;
    rest.ends = {cells.size()};
    rest.mean.fill(cells);
    return allan_deviation(rest).axes[0].points.at(point).deviation;
  };
  const std::vector<double> nbs14 = {892, 809, 823, 798, 671, 644, 883, 903, 677};
  EXPECT_NEAR(deviation(nbs14, 0), 91.22945, 5e-6);
  EXPECT_NEAR(deviation(nbs14, 1), 85.95287, 5e-6);
  std::vector<double> thousand;
  for (std::int64_t n = 1234567890; thousand.size() < 1000; n = 16807 * n % 2147483647)
    thousand.push_back(double(n) / 2147483647.0);
  EXPECT_NEAR(deviation(thousand, 0), 2.922319e-1, 5e-8);
  // oadev of AllanTools 2024.06 (599dc9e) on the same numbers, tau = 1 2 3 4 6 8 ... 256.
  const std::vector<double> of_allantools = {
      0.29223187810675916,  0.20101604217093852, 0.16444561335420452, 0.14479130721843778,
      0.12252027573907326,  0.10570385007869997, 0.07931447673439188, 0.06191477841874486,
      0.051583608901444304, 0.04808214262128163, 0.04043447882665714, 0.03623721298570471,
      0.033078847704691716, 0.02767385582069447, 0.01740922858955826, 0.010282217639032731};
  for (std::size_t k = 0; k < of_allantools.size(); ++k)
    EXPECT_NEAR(deviation(thousand, k) / of_allantools[k], 1.0, 1e-10) << k;
}

// Of one power law: edf_greenhall of AllanTools 2024.06 (599dc9e; Greenhall and Riley, 2003), Allan variance, overlapping, 1025 phases.
// From 16 cells on: of one cell of white noise it has 801, and the sum over d_k is 682, as Howe's formula above.
TEST(Allan, DegreesOfFreedomOfAllanTools) {
  const struct {
    double m, q, n, b, k;
  } rows[] = {
      {16, 514.953, 88.492, 73.059, 57.8}, {64, 478.886, 21.801, 16.984, 13.313}, {256, 354.914, 4.003, 3.003, 2.239}};
  for (const auto& [m, q, n, b, k] : rows) {
    const double expected[] = {q, n, b, k};
    for (std::size_t term = 0; term < 4; ++term) {
      AllanFit fit;
      fit.terms[term].value = 2.0;
      EXPECT_NEAR(equivalent_degrees(fit, m, 1.0, {1025.0 - 2.0 * m}) / expected[term], 1.0, 0.06)
          << allan_letters[term] << " m = " << m;
    }
  }
}

// Of one power law: the approximations of SP 1065, table 5 (Howe, Allan and Barnes, 1981), which are good to some per cent; n phases.
TEST(Allan, DegreesOfFreedomOfOnePowerLaw) {
  constexpr double n = 1025.0;
  for (const double m : {1.0, 4.0, 16.0, 64.0, 256.0}) {
    const double formula[4] = {
        (n + 1.0) * (n - 2.0 * m) / (2.0 * (n - m)),
        (3.0 * (n - 1.0) / (2.0 * m) - 2.0 * (n - 2.0) / n) * 4.0 * m * m / (4.0 * m * m + 5.0),
        m > 1.0 ? 5.0 * n * n / (4.0 * m * (n + 3.0 * m)) : 2.0 * (n - 2.0) * (n - 2.0) / (2.3 * n - 4.9),
        (n - 2.0) / m * ((n - 1.0) * (n - 1.0) - 3.0 * m * (n - 1.0) + 4.0 * m * m) / ((n - 3.0) * (n - 3.0))};
    for (std::size_t k = 0; k < 4; ++k) {
      AllanFit fit;
      fit.terms[k].value = 2.0;
      const double degrees = equivalent_degrees(fit, m, 1.0, {n - 2.0 * m});
      EXPECT_NEAR(degrees / formula[k], 1.0, m > 64.0 ? 0.25 : 0.12) << allan_letters[k] << " m = " << m;
    }
  }
}

// What the rig lays on three axes, twice; samples that `is_lost` are left out.
RestCells cells_of(
    const rig_model::NoiseSize& size, double period_s, std::uint64_t seed, std::int64_t samples,
    bool (*is_lost)(std::int64_t) = [](std::int64_t) { return false; }) {
  rig_model::TriadNoise noise(size, period_s, seed, 0);
  RestCellMaker maker(period_s);
  for (std::int64_t k = 0; k < samples; ++k) {
    std::array<double, 3> triad{};
    noise.add(triad);
    Channels increments;
    increments << Eigen::Vector3d::Map(triad.data()), Eigen::Vector3d::Map(triad.data());
    if (!is_lost(k)) maker.add(k, increments + Channels::Constant(9.81 * period_s));
  }
  return maker.take(Channels::Ones());
}

// 60 channels of an hour at 20 Hz: every mean within a tenth, and 68 % of values within a sigma (5 sigma of the binomial below, 4 above).
TEST(Allan, CoefficientsOverSeeds) {
  rig_model::NoiseSize size;
  size.white = 0.3;
  size.flicker = 0.05;
  size.flicker_longest_s = 65536.0;
  const double truth[2] = {size.white, size.flicker};
  double sum[2] = {}, inside[2] = {}, seen[2] = {}, points = 0.0, held = 0.0;
  AllanFit laid;
  laid.terms[1].value = size.white;
  laid.terms[2].value = size.flicker;
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const AllanResult result = allan_deviation(cells_of(size, 0.05, seed, 72000));
    for (std::size_t axis = 0; axis < 3; ++axis) {
      for (std::size_t k = 0; k < 2; ++k) {
        const AllanCoefficient& c = result.axes[axis].fit.terms[k + 1];
        if (c.value == 0.0) continue;
        seen[k] += 1.0;
        sum[k] += c.value;
        inside[k] += std::abs(c.value - truth[k]) < c.sigma ? 1.0 : 0.0;
      }
      for (const AllanPoint& p : result.axes[axis].points) {
        const double deviation = std::sqrt(allan_variance(laid, p.tau_s));
        points += 1.0;
        held += deviation > p.low && deviation < p.high ? 1.0 : 0.0;
      }
    }
  }
  for (std::size_t k = 0; k < 2; ++k) {
    EXPECT_GE(seen[k], 51.0) << k;
    EXPECT_NEAR(sum[k] / seen[k] / truth[k], 1.0, 0.1) << k;
    EXPECT_NEAR(inside[k] / seen[k], 0.68, 0.2) << k;
  }
  EXPECT_NEAR(held / points, 0.68, 0.08);
}

// White noise in records of a length that does not fit into the cells, with lost samples: N as without, in memory that does not grow.
TEST(Allan, LongRecordWithGaps) {
  rig_model::NoiseSize size;
  size.white = 2.0;
  const RestCells cells = cells_of(size, 0.005, 5, 2'500'000,
                                   [](std::int64_t k) { return k % 1000 == 500 || (k > 1'200'000 && k < 1'204'000); });
  ASSERT_EQ(cells.ends.size(), 1U);
  EXPECT_LT(cells.mean[0].size(), 1'100'000U);
  const AllanResult result = allan_deviation(cells);
  for (const AllanAxis& axis : result.axes) {
    const AllanCoefficient& white = axis.fit.random_walk();
    EXPECT_NEAR(white.value, size.white, 4.0 * white.sigma);
    EXPECT_LT(white.sigma, 0.005 * size.white);
    for (const std::size_t k : {0U, 2U, 3U, 4U}) EXPECT_EQ(axis.fit.terms[k].value, 0.0) << allan_letters[k];
    for (const AllanPoint& p : axis.points)
      EXPECT_TRUE(p.degrees < 1000.0 || std::abs(p.deviation * std::sqrt(p.tau_s) / size.white - 1.0) < 0.1) << p.tau_s;
  }
}

}  // namespace
}  // namespace turncal
