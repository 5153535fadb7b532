// North seeking and reference readings against the figures of Wang (2020), Tables 2 and 3, typed in from the paper.
#include "calib/model/parameters.h"
#include "calib/navigation/alignment.h"
#include "calib/navigation/north_seeking.h"
#include "tests/test.h"

namespace turncal {
namespace {

// Head, roll, pitch at table angles of 0, 90, 180 and 270 deg.
using Angles = std::array<double, 3>;
constexpr Angles table_2[4][4] = {{{0.010329, 0.002115, -0.001641},
                                   {-0.010653, 0.002893, -0.001273},
                                   {-0.005672, 0.003542, -0.002101},
                                   {0.002389, 0.003679, -0.001978}},
                                  {{90.009189, 0.002678, 0.000563},
                                   {90.007654, 0.002018, 0.000781},
                                   {89.999781, 0.002671, 0.000603},
                                   {90.0032167, 0.0030189, 0.000451}},
                                  {{180.000315, 0.001952, 0.002138},
                                   {180.000363, 0.001631, 0.003159},
                                   {180.000403, 0.002152, 0.001876},
                                   {180.000158, 0.0019871, 0.002819}},
                                  {{270.005671, 0.003548, 0.002896},
                                   {270.005751, 0.003179, 0.002765},
                                   {270.006012, 0.003019, 0.002514},
                                   {270.005138, 0.003998, 0.003065}}};
constexpr Angles printed_mean[4] = {{-0.000902, 0.003057, -0.00175},
                                    {90.00496, 0.002596, 0.0006},
                                    {180.0003, 0.001931, 0.002498},
                                    {270.0056, 0.003436, 0.00281}};
constexpr Angles half_a_digit[4] = {
    {5e-7, 5e-7, 5e-6}, {5e-6, 6e-7, 5e-5}, {5e-5, 6e-7, 5e-7}, {5e-5, 5e-7, 5e-6}};  // of the mean
constexpr Angles printed_deviation[4] = {{0.0092159, 0.000716, 0.000372},
                                         {0.004282, 0.000418, 0.000137},
                                         {0.000107, 0.000218, 0.000593},
                                         {0.000367, 0.000435, 0.000232}};

std::vector<NorthReading> printed_readings() {
  std::vector<NorthReading> readings;
  for (std::size_t p = 0; p < 4; ++p)
    for (const Angles& angles : table_2[p]) readings.push_back({.table_deg = 90.0 * double(p), .angle_deg = angles});
  return readings;
}

// All 24 figures of the paper's table follow from its readings: arithmetic means, deviations with n - 1.
TEST(NavigationNorth, TableTwoOfThePaper) {
  const NorthSeeking found = seek_north(std::vector<NorthReading>{{}, {}}, printed_readings());
  ASSERT_EQ(found.positions.size(), 4u);
  for (std::size_t p = 0; p < 4; ++p) {
    ASSERT_EQ(found.positions[p].readings.size(), 4u);
    for (std::size_t a = 0; a < 3; ++a) {
      EXPECT_NEAR(found.positions[p].mean_deg[a], printed_mean[p][a], half_a_digit[p][a]) << p << a;
      EXPECT_NEAR(found.positions[p].deviation_deg[a], printed_deviation[p][a], 6e-7) << p << a;
    }
  }
  EXPECT_NEAR(found.worst_heading_error_deg, -0.010653, 1e-12);
  EXPECT_NEAR(found.deviation[0].value_deg, 0.0092159, 6e-7);
  EXPECT_NEAR(found.deviation[1].value_deg, 0.000716, 6e-7);
  EXPECT_NEAR(found.deviation[2].value_deg, 0.000593, 6e-7);
  // Of the printed means: sqrt((0.000902^2 + 0.00496^2 + 0.0003^2 + 0.0056^2) / 4).
  EXPECT_NEAR(found.mean_heading.value_deg, 0.00377, 3e-5);
}

TEST(NavigationNorth, TheTablesZeroIsTheMeanOfTheSearches) {
  // The unit sits turned by 40 deg on the table, which points 0.02 deg west of it; two searches on either side of north.
  const auto at = [](double table, double heading) {
    return NorthReading{.table_deg = table, .angle_deg = {heading, 0.001, 0.002}};
  };
  const NorthSeeking across =
      seek_north(std::vector{at(0.0, 359.99), at(0.0, 0.03)}, std::vector{at(0.0, 359.995), at(0.0, 0.005)});
  EXPECT_NEAR(across.zero_deg, 0.01, 1e-12);
  EXPECT_NEAR(across.positions[0].mean_deg[0], -0.01, 1e-12);
  EXPECT_NEAR(across.mean_heading.value_deg, 0.01, 1e-12);
  const NorthSeeking turned =
      seek_north(std::vector{at(0.0, 40.01), at(0.0, 40.03)},
                 std::vector{at(0.0, 40.02), at(0.0, 40.024), at(270.0, 310.021), at(270.0, 310.021)});
  EXPECT_NEAR(turned.zero_deg, 40.02, 1e-12);
  ASSERT_EQ(turned.positions.size(), 2u);
  EXPECT_NEAR(turned.positions[0].mean_deg[0], 0.002, 1e-12);
  EXPECT_NEAR(turned.positions[1].mean_deg[0], 270.001, 1e-10);
  EXPECT_NEAR(turned.worst_heading_error_deg, 0.004, 1e-10);
}

// 20 000 north seekings of units in which there is nothing but noise: as often above the limits as is said beforehand, and sigma is that
// of the figures. The heading's sigma is 0.0054 deg (docs/verification.md), that of the level at the edge.
TEST(NavigationNorth, GoodUnitsFailAsOftenAsIsSaid) {
  constexpr double heading_sigma = 0.0054, level_sigma = 0.006, limit = 0.012;
  constexpr int runs = 20'000;
  std::mt19937_64 random(7);
  std::normal_distribution<double> normal;
  const auto reading = [&](double table) {
    NorthReading made;
    made.table_deg = table;
    made.noise_sigma_deg = made.total_sigma_deg = {heading_sigma, level_sigma, level_sigma};
    for (std::size_t a = 0; a < 3; ++a) made.angle_deg[a] = made.noise_sigma_deg[a] * normal(random);
    made.angle_deg[0] += table;
    return made;
  };
  int failed = 0, of_heading = 0;
  double squares = 0.0, said = 0.0, sigma = 0.0;
  for (int run = 0; run < runs; ++run) {
    const std::vector<NorthReading> searches = {reading(0.0), reading(0.0)};
    std::vector<NorthReading> readings;
    for (int k = 0; k < 16; ++k) readings.push_back(reading(90.0 * (k / 4)));
    const NorthSeeking found = seek_north(searches, readings);
    const bool heading = found.deviation[0].value_deg > limit || found.mean_heading.value_deg > limit;
    of_heading += heading ? 1 : 0;
    failed += heading || found.deviation[1].value_deg > limit || found.deviation[2].value_deg > limit ? 1 : 0;
    squares += found.mean_heading.value_deg * found.mean_heading.value_deg;
    said = false_fail_probability(found, limit, limit);
    sigma = found.mean_heading.sigma_deg;
  }
  const double share = double(failed) / runs;
  const double scatter = std::sqrt(share * (1.0 - share) / runs);
  EXPECT_NEAR(said, share,
              4.0 * scatter + 0.1 * share);  // the tenth: what the two means leave of independence and of Satterthwaite
  EXPECT_LT(double(of_heading) / runs, 0.03);
  EXPECT_NEAR(std::sqrt(squares / runs) / sigma, 1.0, 0.02);
}

TEST(NavigationNorth, TableThreeOfThePaper) {
  const std::vector<ReferenceRow> rows = {
      {{20.186751, 0.009256, -0.017475}, {20.186751, 0.009256, -0.017475}},
      {{74.261759, 0.017019, 0.052811}, {74.262023, 0.017211, 0.052833}},
      {{156.123621, 0.009978, 0.039101}, {156.124101, 0.009981, 0.039131}},
      {{254.556781, 0.019298, 0.029012}, {254.557014, 0.019301, 0.029112}},
      {{246.017871, 0.008066, -0.027013}, {246.018541, 0.008054, -0.027128}},
      {{20.017897, 0.012601, -0.013012}, {20.017913, 0.012871, -0.014151}},
  };
  constexpr std::array<std::array<double, 3>, 6> printed = {{{0.0, 0.0, 0.0},
                                                             {-0.000264, -0.000192, -0.000022},
                                                             {-0.000480, -0.000003, -0.000030},
                                                             {-0.000233, -0.000003, -0.000100},
                                                             {-0.000670, 0.000012, 0.000115},
                                                             {-0.000016, -0.000270, 0.001139}}};
  const ReferenceComparison found = compare_references(rows);
  for (std::size_t row = 0; row < 6; ++row)
    for (std::size_t a = 0; a < 3; ++a) EXPECT_NEAR(found.error_deg[row][a], printed[row][a], 1e-10) << row << a;
  EXPECT_NEAR(found.worst_deg[0], 0.00067, 1e-10);
  EXPECT_NEAR(found.worst_deg[1], 0.00027, 1e-10);
  EXPECT_NEAR(found.worst_deg[2], 0.001139, 1e-10);
  // A reference with an offset, and one on the other side of north, is bound by the first row.
  std::vector<ReferenceRow> offset = rows;
  for (ReferenceRow& row : offset) {
    row.reference_deg[0] -= 30.0;
    row.reference_deg[2] += 0.5;
  }
  EXPECT_NEAR(compare_references(offset).error_deg[5][0], -0.000016, 1e-10);
  EXPECT_NEAR(compare_references(offset).error_deg[5][2], 0.001139, 1e-10);
}

// Of what points straight up no heading is known, and near it less and less.
TEST(AngleSigmas, TheHeadingsSaturatesWhereXIsVertical) {
  const Eigen::Matrix3d of_phi = Eigen::Vector3d(1e-5, 7e-4, 1e-5).cwiseAbs2().asDiagonal();
  for (const double sign : {1.0, -1.0}) {
    double before = 0.0;
    for (const double pitch_deg : {0.0, 45.0, 89.0, 89.99, 89.9999, 89.9999999, 90.0}) {
      const Eigen::Quaterniond q(Eigen::AngleAxisd(sign * pitch_deg * rad_per_deg, Eigen::Vector3d::UnitZ()));
      const double sigma = angle_sigmas(of_phi, q)[0];
      EXPECT_GE(sigma, before) << pitch_deg;
      before = sigma;
    }
    EXPECT_DOUBLE_EQ(before, 2.0 * pi / std::sqrt(12.0));
  }
}

}  // namespace
}  // namespace turncal
