#include "calib/model/attitude.h"

#include <gtest/gtest.h>

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

// The words of the definition, one by one.
TEST(Attitude, HeadingIsClockwiseSeenFromAbove) {
  expect_near(attitude_deg(90, 0, 0) * front, east);
  // "At H = -90 the x axis points west and z points north."
  expect_near(attitude_deg(-90, 0, 0) * front, -east);
  expect_near(attitude_deg(-90, 0, 0) * right, north);
}

TEST(Attitude, PitchIsNoseUp) { expect_near(attitude_deg(0, 90, 0) * front, up); }

TEST(Attitude, RollIsRightSideDown) {
  expect_near(attitude_deg(0, 0, 90) * right, -up);
  expect_near(attitude_deg(0, 0, 90) * up_b, east);  // y towards z
}

TEST(Attitude, HeadingIsOuterAndRollInner) {
  const Matrix3d expected = attitude_deg(-90, 0, 0) * attitude_deg(0, 40, 0) * attitude_deg(0, 0, -70);
  EXPECT_LT((attitude_deg(-90, 40, -70) - expected).norm(), 1e-15);
  // Roll turns about the x axis wherever it points: x does not move.
  expect_near(attitude_deg(-90, 40, -70) * front, attitude_deg(-90, 40, 0) * front);
}

TEST(Skew, IsTheCrossProduct) {
  const Vector3d a(0.3, -2.0, 1.1), b(-0.7, 0.2, 5.0);
  expect_near(skew(a) * b, a.cross(b));
}

TEST(CrossOfOuter, IsTheSumOfCrossProducts) {
  const Vector3d x1(0.3, -2.0, 1.1), y1(-0.7, 0.2, 5.0), x2(4.0, 0.1, -0.3), y2(0.5, 0.6, -0.2);
  expect_near(cross_of_outer(x1 * y1.transpose() + x2 * y2.transpose()), x1.cross(y1) + x2.cross(y2), 1e-14);
}

TEST(RotationExp, TurnsAboutTheAxisByTheLength) {
  expect_near(rotation_exp(Vector3d(0, 0, pi / 2)) * Vector3d::UnitX(), Vector3d::UnitY());
  EXPECT_TRUE(rotation_exp(Vector3d::Zero()).isIdentity(0.0));
}

TEST(RotationExp, HasNoStepWhereTheSeriesTakesOver) {
  const Vector3d axis = Vector3d(1, -2, 0.5).normalized();
  const Matrix3d series = rotation_exp(0.99999e-4 * axis), exact = rotation_exp(1.00001e-4 * axis);
  const Matrix3d between = series.transpose() * exact;  // a turn by 2e-9 about the axis
  expect_near(small_turn(between), 2e-9 * axis, 1e-15);
  for (const double angle : {1e-9, 1e-5, 1e-4, 1e-3, 0.3, 3.0}) {
    const Matrix3d m = rotation_exp(angle * axis);
    EXPECT_LT((m * m.transpose() - Matrix3d::Identity()).norm(), 3e-15) << angle;
    EXPECT_LT((m - Eigen::AngleAxisd(angle, axis).toRotationMatrix()).norm(), 3e-15) << angle;
  }
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

TEST(Level, MakesTheForceVertical) {
  const Matrix3d truth = attitude_deg(-90, 0.05, 360.03);
  const Vector3d f_b = truth.transpose() * Vector3d(0, 9.79, 0);
  const Matrix3d levelled = level(attitude_deg(-90, 0, 360), f_b);
  expect_near(levelled * f_b, Vector3d(0, 9.79, 0), 1e-14);
}

// Levelling turns about a horizontal axis only: no heading is made up.
TEST(Level, KeepsTheHeadingOfTheReference) {
  const Matrix3d reference = attitude_deg(30, 0, 0);
  const Vector3d f_b = reference.transpose() * rotation_exp(Vector3d(1e-3, 0, -2e-3)).transpose() * up;
  const Matrix3d turn = level(reference, f_b) * reference.transpose();
  EXPECT_NEAR(turn(0, 2), turn(2, 0), 1e-15);  // no turn about up
  EXPECT_NEAR(turn(1, 0), -2e-3, 1e-6);        // about east
  EXPECT_NEAR(turn(2, 1), 1e-3, 1e-6);         // about north
}

TEST(EarthRate, PointsNorthAndUp) {
  expect_near(earth_rate_n(0.0), 7.292115e-5 * north);
  expect_near(earth_rate_n(90.0), 7.292115e-5 * up, 1e-19);
  EXPECT_NEAR(earth_rate_n(29.53).x() / radps_per_degph, 13.0870, 1e-3);  // 15.0411 deg/h cos 29.53
  EXPECT_LT(earth_rate_n(-30.0).y(), 0.0);
}

}  // namespace
}  // namespace turncal
