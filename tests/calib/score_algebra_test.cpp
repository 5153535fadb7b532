// The dense algebra of scores against textbook numbers and against plain least squares.
#include "calib/joint/score_algebra.h"
#include "calib/statistics/distributions.h"

#include "tests/test.h"

#include <Eigen/Dense>

namespace turncal {
namespace {

// Chi-square tables (Abramowitz and Stegun, table 26.8).
// Whatever the processor's are: with them Eigen's products would round elsewhere on another machine.
TEST(Products, AreCutByCachesOfFixedSizes) {
  EXPECT_EQ(Eigen::l1CacheSize(), 32 * 1024);
  EXPECT_EQ(Eigen::l2CacheSize(), 256 * 1024);
  EXPECT_EQ(Eigen::l3CacheSize(), 2 * 1024 * 1024);
}

TEST(ChiSquare, TailMatchesPublishedTable) {
  EXPECT_NEAR(chi_square_tail(3.841459, 1), 0.05, 1e-7);
  EXPECT_NEAR(chi_square_tail(6.634897, 1), 0.01, 1e-8);
  EXPECT_NEAR(chi_square_tail(16.918978, 9), 0.05, 1e-7);
  EXPECT_NEAR(chi_square_tail(2.167349, 7), 0.95, 1e-6);
  EXPECT_NEAR(chi_square_tail(32.670573, 21), 0.05, 1e-7);
  EXPECT_NEAR(chi_square_1_limit(0.05), 3.841459, 1e-5);
  EXPECT_NEAR(chi_square_1_limit(1e-6), 23.928127, 1e-5);
}

struct Regression {
  Eigen::MatrixXd X;  // rows: observations with unit variance; columns: 3 base, 4 candidates
  Eigen::VectorXd y;
  Eigen::MatrixXd information() const { return X.transpose() * X; }
  // residual of a model at zero is y, and the derivative of the residual is -X
  Eigen::VectorXd gradient() const { return -X.transpose() * y; }
};

Regression regression_of(unsigned seed) {
  std::mt19937 generator(seed);
  std::normal_distribution<double> normal;
  Regression r;
  r.X = Eigen::MatrixXd::NullaryExpr(200, 7, [&] { return normal(generator); });
  r.X.col(4) += 2.0 * r.X.col(0);               // a candidate partly in the base
  r.X.col(6) = r.X.col(5) + 0.01 * r.X.col(6);  // two candidates nearly alike
  Eigen::VectorXd truth(7);
  truth << 1.0, -2.0, 0.5, 0.0, 0.7, 0.0, 0.0;
  r.y = r.X * truth + Eigen::VectorXd::NullaryExpr(200, [&] { return normal(generator); });
  return r;
}

TEST(Scores, OneCandidateAloneIsItsLeastSquaresValue) {
  const Regression r = regression_of(1);
  const Scores s = eliminate(r.information(), r.gradient(), {0, 1, 2}, {3, 4, 5, 6});
  for (int k = 0; k < 4; ++k) {
    Eigen::MatrixXd X(200, 4);
    X << r.X.leftCols(3), r.X.col(3 + k);
    const Eigen::VectorXd fit = X.colPivHouseholderQr().solve(r.y);
    const double sigma = std::sqrt((X.transpose() * X).inverse()(3, 3));
    EXPECT_NEAR(s.s[k] / s.Q(k, k), fit[3], 1e-9);
    EXPECT_NEAR(1.0 / std::sqrt(s.Q(k, k)), sigma, 1e-9);
  }
}

TEST(Scores, TwinsImitateEachOther) {
  Regression r = regression_of(3);
  r.X.col(6) = r.X.col(5);
  const Scores s = eliminate(r.information(), r.gradient(), {0, 1, 2}, {3, 4, 5, 6});
  EXPECT_NEAR(multiple_correlation(s, 2, {3}), 1.0, 1e-9);
  EXPECT_LT(multiple_correlation(s, 0, {2, 3}), 0.3);
}

TEST(Scores, CandidateInsideTheBaseKeepsNothing) {
  Regression r = regression_of(4);
  r.X.col(3) = r.X.col(0) - 3.0 * r.X.col(2);
  const Scores s = eliminate(r.information(), r.gradient(), {0, 1, 2}, {3, 4});
  EXPECT_LT(s.kept[0], 1e-9);
  EXPECT_GT(s.kept[1], 0.1);
}

}  // namespace
}  // namespace turncal
