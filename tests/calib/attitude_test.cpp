#include "calib/model/attitude.h"

#include <Eigen/Dense>
#include "calib/joint/score_algebra.h"
#include "calib/statistics/numerics.h"
#include "tests/test.h"

namespace turncal {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

const Vector3d front = Vector3d::UnitX(), up_b = Vector3d::UnitY(), right = Vector3d::UnitZ();
const Vector3d north = Vector3d::UnitX(), up = Vector3d::UnitY(), east = Vector3d::UnitZ();

Matrix3d attitude_deg(double h, double p, double r) {
  return attitude_from_angles(h * rad_per_deg, p * rad_per_deg, r * rad_per_deg);
}

// The rotation vector of a small turn.
Vector3d small_turn(const Matrix3d& m) {
  return 0.5 * Vector3d(m(2, 1) - m(1, 2), m(0, 2) - m(2, 0), m(1, 0) - m(0, 1));
}

void expect_near(const Vector3d& value, const Vector3d& expected, double tolerance = 1e-15) {
  EXPECT_LT((value - expected).norm(), tolerance) << value.transpose() << " expected " << expected.transpose();
}

// The words of the definition, one by one: heading is clockwise seen from above, pitch nose up, roll right side down.
TEST(Attitude, IsAsDefined) {
  expect_near(attitude_deg(90, 0, 0) * front, east);
  // "At H = -90 the x axis points west and z points north."
  expect_near(attitude_deg(-90, 0, 0) * front, -east);
  expect_near(attitude_deg(-90, 0, 0) * right, north);
  expect_near(attitude_deg(0, 90, 0) * front, up);
  expect_near(attitude_deg(0, 0, 90) * right, -up);
  expect_near(attitude_deg(0, 0, 90) * up_b, east);  // y towards z
  // Heading is outer, roll inner: x does not move in it.
  const Matrix3d expected = attitude_deg(-90, 0, 0) * attitude_deg(0, 40, 0) * attitude_deg(0, 0, -70);
  EXPECT_LT((attitude_deg(-90, 40, -70) - expected).norm(), 1e-15);
  expect_near(attitude_deg(-90, 40, -70) * front, attitude_deg(-90, 40, 0) * front);
  EXPECT_EQ(attitude_at({{-90.0, 40.0, -70.0}}), attitude_deg(-90, 40, -70));
}

// Also where the series takes over.
TEST(RotationExp, TurnsAboutTheAxisByTheLength) {
  const Vector3d axis = Vector3d(1, -2, 0.5).normalized();
  EXPECT_TRUE(rotation_exp(Vector3d::Zero()).isIdentity(0.0));
  for (const double angle : {1e-9, 1e-5, 1e-4, 1e-3, 0.0999999, 0.1000001, 0.3, 0.5 * pi, 3.0}) {
    const Matrix3d m = rotation_exp(angle * axis);
    EXPECT_LT((m * m.transpose() - Matrix3d::Identity()).norm(), 3e-15) << angle;
    EXPECT_LT((m - Eigen::AngleAxisd(angle, axis).toRotationMatrix()).norm(), 3e-15) << angle;
  }
  expect_near(rotation_exp(Vector3d(0, 0, pi / 2)) * Vector3d::UnitX(), Vector3d::UnitY());
}

// Exp(s + ds) Exp(s)^-1 is a turn by Jl(s) ds: against central differences.
TEST(LeftJacobian, AgreesWithNumericDerivative) {
  for (const double size : {0.0, 0.01, 0.1, 0.2}) {
    const Vector3d s = size * Vector3d(0.6, -0.64, 0.48);
    const Matrix3d jacobian = left_jacobian(s);
    const double h = 1e-5;
    for (int k = 0; k < 3; ++k) {
      const Vector3d ds = h * Vector3d::Unit(k);
      const Matrix3d turn = rotation_exp(s + ds) * rotation_exp(s - ds).transpose();
      const Vector3d numeric = small_turn(turn) / (2.0 * h);
      // numeric: rounding 1e-16 / 1e-5; the series: size^4 / 700
      expect_near(jacobian.col(k), numeric, 1e-10 + std::pow(size, 4) / 500.0);
    }
  }
}

// The force comes to be vertical, by a turn about a horizontal axis only: no heading is made up.
TEST(Level, KeepsTheHeadingOfTheReference) {
  const Vector3d felt = attitude_deg(-90, 0.05, 360.03).transpose() * Vector3d(0, 9.79, 0);
  expect_near(level(attitude_deg(-90, 0, 360), felt) * felt, Vector3d(0, 9.79, 0), 1e-14);
  const Matrix3d reference = attitude_deg(30, 0, 0);
  const Vector3d f_b = reference.transpose() * rotation_exp(Vector3d(1e-3, 0, -2e-3)).transpose() * up;
  const Matrix3d turn = level(reference, f_b) * reference.transpose();
  EXPECT_NEAR(turn(0, 2), turn(2, 0), 1e-15);  // no turn about up
  EXPECT_NEAR(turn(1, 0), -2e-3, 1e-6);        // about east
  EXPECT_NEAR(turn(2, 1), 1e-3, 1e-6);         // about north
}

// ---- score algebra ----

// The dense algebra of scores against textbook numbers and against plain least squares.

// Whatever the processor's are: with them Eigen's products would round elsewhere on another machine.
TEST(Products, AreCutByCachesOfFixedSizes) {
  EXPECT_EQ(Eigen::l1CacheSize(), 32 * 1024);
  EXPECT_EQ(Eigen::l2CacheSize(), 256 * 1024);
  EXPECT_EQ(Eigen::l3CacheSize(), 2 * 1024 * 1024);
}

// Chi-square: Abramowitz and Stegun, table 26.8. F(1, 10) at 0.05 is 4.9646, F(3, 20) at 0.01 is 4.9382.
TEST(Tails, MatchPublishedTables) {
  EXPECT_NEAR(chi_square_tail(3.841459, 1), 0.05, 1e-7);
  EXPECT_NEAR(chi_square_tail(6.634897, 1), 0.01, 1e-8);
  EXPECT_NEAR(chi_square_tail(16.918978, 9), 0.05, 1e-7);
  EXPECT_NEAR(chi_square_tail(2.167349, 7), 0.95, 1e-6);
  EXPECT_NEAR(chi_square_tail(32.670573, 21), 0.05, 1e-7);
  EXPECT_NEAR(f_tail(4.9646, 1.0, 10.0), 0.05, 1e-5);
  EXPECT_NEAR(f_tail(4.9382, 3.0, 20.0), 0.01, 1e-5);
  EXPECT_EQ(f_tail(0.0, 3.0, 20.0), 1.0);
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

TEST(Scores, WhatTheBaseAndATwinImitate) {
  Regression r = regression_of(3);
  r.X.col(3) = r.X.col(0) - 3.0 * r.X.col(2);
  r.X.col(6) = r.X.col(5);
  const Scores s = eliminate(r.information(), r.gradient(), {0, 1, 2}, {3, 4, 5, 6});
  EXPECT_LT(s.kept[0], 1e-9);
  EXPECT_GT(s.kept[1], 0.1);
  EXPECT_NEAR(multiple_correlation(s, 2, {3}), 1.0, 1e-9);
  EXPECT_LT(multiple_correlation(s, 1, {2, 3}), 0.3);
}

}  // namespace
}  // namespace turncal
