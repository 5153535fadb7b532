// The trapezoid of one axis, and geometry against numeric derivatives.
#include "turntable_drivers/rig/rig_axes.h"

#include <cmath>

#include <gtest/gtest.h>

#include "turntable_drivers/rig/rig_geometry.h"
#include "turntable_drivers/rig/rig_math.h"

namespace turncal::rig_model {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// 90 deg at 10 deg/s and 10 deg/s^2: 1 s up (5 deg), 8 s cruise, 1 s down.
TEST(RigMotion, Trapezoid) {
  const AxisProfile profile = AxisProfile::move(0.0, 0.0, 90.0, 10.0, 10.0);
  EXPECT_DOUBLE_EQ(profile.duration_s(), 10.0);
  EXPECT_DOUBLE_EQ(profile.at(0.5).position_deg, 1.25);
  EXPECT_DOUBLE_EQ(profile.at(0.5).rate_degps, 5.0);
  EXPECT_DOUBLE_EQ(profile.at(1.0).position_deg, 5.0);
  EXPECT_DOUBLE_EQ(profile.at(5.0).position_deg, 45.0);
  EXPECT_DOUBLE_EQ(profile.at(5.0).rate_degps, 10.0);
  EXPECT_DOUBLE_EQ(profile.at(9.5).position_deg, 88.75);
  EXPECT_DOUBLE_EQ(profile.at(9.5).acceleration_degps2, -10.0);
  EXPECT_EQ(profile.at(10.0).position_deg, 90.0);
  EXPECT_EQ(profile.at(1e6).rate_degps, 0.0);
}

// 2.5 deg at 10 deg/s^2 never reaches 10 deg/s: peak sqrt(2.5 * 10) = 5 deg/s after 0.5 s.
TEST(RigMotion, TriangleWhenTheWayIsShort) {
  const AxisProfile profile = AxisProfile::move(1.0, 0.0, -1.5, 10.0, 10.0);
  EXPECT_DOUBLE_EQ(profile.duration_s(), 1.0);
  EXPECT_DOUBLE_EQ(profile.at(0.5).rate_degps, -5.0);
  EXPECT_DOUBLE_EQ(profile.at(0.5).position_deg, -0.25);
  EXPECT_EQ(profile.at(1.0).position_deg, -1.5);
  EXPECT_EQ(profile.last_direction(), -1.0);
}

// From 10 deg/s: brakes in 1 s (5 deg past the start), then goes back 15 deg.
TEST(RigMotion, MoveFromMotionBrakesFirst) {
  const AxisProfile profile = AxisProfile::move(0.0, 10.0, -10.0, 10.0, 10.0);
  EXPECT_DOUBLE_EQ(profile.at(0.0).rate_degps, 10.0);
  EXPECT_DOUBLE_EQ(profile.at(1.0).position_deg, 5.0);
  EXPECT_NEAR(profile.at(1.0).rate_degps, 0.0, 1e-12);
  EXPECT_DOUBLE_EQ(profile.duration_s(), 1.0 + 1.0 + 0.5 + 1.0);
  EXPECT_EQ(profile.at(4.0).position_deg, -10.0);
}

TEST(RigMotion, BrakeEndsWhereTheRateIsUsedUp) {
  const AxisProfile profile = AxisProfile::brake(20.0, -8.0, 16.0);
  EXPECT_DOUBLE_EQ(profile.duration_s(), 0.5);
  EXPECT_DOUBLE_EQ(profile.at(0.5).position_deg, 18.0);
}

// Position is the integral of rate, rate of acceleration, across every corner.
TEST(RigMotion, PositionRateAndAccelerationAgree) {
  const AxisProfile profile = AxisProfile::move(3.0, -4.0, 40.0, 10.0, 7.0);
  const double h = 1e-4;
  for (double t = 0.0; t < profile.duration_s() + 1.0; t += 0.01) {
    const double rate = (profile.at(t + h).position_deg - profile.at(t).position_deg) / h;
    EXPECT_NEAR(rate, 0.5 * (profile.at(t).rate_degps + profile.at(t + h).rate_degps), 1e-3) << t;
  }
}

TableGeometry awkward_table() {
  GeometryAngles angles;
  angles.base = Vector3d(0.02, -0.03, 0.01);
  angles.heading_pitch = 0.015;
  angles.pitch_roll = -0.025;
  angles.mounting = Vector3d(0.01, 0.02, -0.03);
  SiteVectors site;
  site.earth_rate = Vector3d(0.3, 0.2, 0.0);  // far more than the Earth's, so that its terms show
  site.specific_force = Vector3d(0.0, 9.79, 0.0);
  site.field = Vector3d(0.3, -0.4, 0.0);
  site.earth_error = Vector3d(1e-3, 2e-3, 0.0);
  return TableGeometry(angles, site);
}

std::array<TrueAxis, 3> axes_at(double t) {
  const double angle[] = {0.3 + 0.7 * t + 0.1 * t * t, -0.8 - 0.4 * t + 0.2 * t * t, 1.9 + 0.5 * t - 0.3 * t * t};
  const double rate[] = {0.7 + 0.2 * t, -0.4 + 0.4 * t, 0.5 - 0.6 * t};
  const double acceleration[] = {0.2, 0.4, -0.6};
  std::array<TrueAxis, 3> axes;
  for (std::size_t i = 0; i < 3; ++i) axes[i] = {sin_cos(angle[i]), rate[i], acceleration[i]};
  return axes;
}

// C_nb' = C_nb [w_nb_b x]: the rate from the attitude by central difference, with all three axes turning.
TEST(RigGeometry, RateIsTheDerivativeOfTheAttitude) {
  const TableGeometry table = awkward_table();
  const Vector3d earth_n(0.3, 0.2, 0.0);
  const double h = 1e-5;
  for (double t = 0.0; t < 2.0; t += 0.1) {
    const Matrix3d c = table.attitude_nb(axes_at(t));
    const Matrix3d derivative = (table.attitude_nb(axes_at(t + h)) - table.attitude_nb(axes_at(t - h))) / (2.0 * h);
    const Matrix3d cross = c.transpose() * derivative;
    const Vector3d rate_nb_b(cross(2, 1), cross(0, 2), cross(1, 0));
    const Vector3d expected = rate_nb_b + c.transpose() * earth_n;
    EXPECT_LT((table.at(axes_at(t)).rate_ib_b - expected).norm(), 1e-9) << t;
    EXPECT_LT((c.transpose() * c - Matrix3d::Identity()).norm(), 1e-15);
  }
}

TEST(RigGeometry, AngularAccelerationIsTheDerivativeOfTheRate) {
  const TableGeometry table = awkward_table();
  const double h = 1e-5;
  for (double t = 0.0; t < 2.0; t += 0.1) {
    const Vector3d expected = (table.at(axes_at(t + h)).rate_ib_b - table.at(axes_at(t - h)).rate_ib_b) / (2.0 * h);
    EXPECT_LT((table.at(axes_at(t)).acceleration_b - expected).norm(), 1e-9) << t;
  }
}

TEST(RigGeometry, SiteVectorsAreTurnedIntoTheBody) {
  const TableGeometry table = awkward_table();
  const Matrix3d c_bn = table.attitude_nb(axes_at(0.7)).transpose();
  const BodyMotion motion = table.at(axes_at(0.7));
  EXPECT_LT((motion.force_b - c_bn * Vector3d(0.0, 9.79, 0.0)).norm(), 1e-14);
  EXPECT_LT((motion.field_b - c_bn * Vector3d(0.3, -0.4, 0.0)).norm(), 1e-15);
  EXPECT_LT((motion.earth_error_b - c_bn * Vector3d(1e-3, 2e-3, 0.0)).norm(), 1e-17);
}

// The definitions of docs/rig.md, one angle at a time, at H = P = R = 0 where C_nb is the small rotation itself.
TEST(RigGeometry, SignOfEachTableError) {
  const auto attitude = [](GeometryAngles angles) {
    const SiteVectors site{Vector3d::Zero(), Vector3d::UnitY(), Vector3d::Zero(), Vector3d::Zero()};
    return TableGeometry(angles, site).attitude_nb(std::array<TrueAxis, 3>{});
  };
  GeometryAngles tilt_north, north, tilt_east, heading_pitch, pitch_roll, mounting;
  tilt_north.base[0] = 1e-3;
  north.base[1] = 1e-3;
  tilt_east.base[2] = 1e-3;
  heading_pitch.heading_pitch = 1e-3;
  pitch_roll.pitch_roll = 1e-3;
  mounting.mounting[2] = 1e-3;
  EXPECT_NEAR(attitude(tilt_north)(2, 1), 1e-3, 1e-9);      // the up axis leans to east
  EXPECT_NEAR(attitude(north)(2, 0), -1e-3, 1e-9);          // x turns to west: true heading = H - north
  EXPECT_NEAR(attitude(tilt_east)(1, 0), 1e-3, 1e-9);       // x rises
  EXPECT_NEAR(attitude(heading_pitch)(1, 2), -1e-3, 1e-9);  // the pitch axis z sinks
  EXPECT_NEAR(attitude(pitch_roll)(2, 0), -1e-3, 1e-9);     // the roll axis x turns away from z
  EXPECT_NEAR(attitude(mounting)(1, 0), 1e-3, 1e-9);        // the unit's x rises
}

TEST(RigAxes, EncoderErrorsAndHiddenSlip) {
  TableErrorsInForce::Encoder encoder;
  encoder.offset_arcsec = 3600.0;  // 1 deg
  encoder.scale_ppm = 1000.0;
  encoder.harmonic_arcsec = 7200.0;  // 2 deg
  encoder.order = 2;
  encoder.phase_deg = 90.0;
  RigAxis axis(30.0, encoder, 0.0, 20.0, 0.005);
  // 30 + 0.03 + 1 + 2 sin(60 + 90 deg) = 32.03 deg
  EXPECT_NEAR(axis.truth(0, 0.0).angle.sin, sin_cos_deg(32.03).sin, 1e-14);
  axis.slip(0, 5.0, 1.0, true);
  EXPECT_NEAR(axis.truth(4000, 0.0).angle.sin, sin_cos_deg(37.03).sin, 1e-14);
  EXPECT_EQ(axis.reading(4000, 0.0).position_deg, 30.0);
  axis.slip(4000, 5.0, 1.0, false);
  EXPECT_NEAR(axis.reading(8000, 0.0).position_deg, 35.0, 1e-12);
  axis.move(8000, 0.0, 10.0, 10.0);
  EXPECT_EQ(axis.reading(16000, 0.0).position_deg, 0.0);
}

// Rates of the true angle against its numeric derivative, with encoder errors, slip and creep, moving and after it.
TEST(RigAxes, TrueRateIsTheDerivativeOfTheTrueAngle) {
  TableErrorsInForce::Encoder encoder;
  encoder.scale_ppm = 500.0;
  encoder.harmonic_arcsec = 1000.0;
  encoder.order = 3;
  RigAxis axis(0.0, encoder, 0.2, 2.0, 0.005);
  axis.move(0, 20.0, 10.0, 10.0);
  axis.slip(100, 1.0, 0.5, true);
  const double h = 1e-6;
  for (std::int64_t k = 101; k < 2000; k += 37) {
    const auto angle = [&](double offset) {
      const SinCos a = axis.truth(k, offset).angle;
      return std::atan2(a.sin, a.cos);
    };
    const double middle = 0.0021;
    EXPECT_NEAR((angle(middle + h) - angle(middle - h)) / (2.0 * h), axis.truth(k, middle).rate_radps, 1e-8) << k;
    EXPECT_NEAR((axis.truth(k, middle + h).rate_radps - axis.truth(k, middle - h).rate_radps) / (2.0 * h),
                axis.truth(k, middle).acceleration_radps2, 1e-8)
        << k;
  }
}

// After a move the axis creeps on by 36 arcsec (0.01 deg) with tau 20 s, the other way after the way back, and what has
// crept stays: +0.01 - 0.01 (1 - exp(-20/20)) after 20 s.
TEST(RigAxes, CreepFollowsTheDirectionOfTheMove) {
  RigAxis axis(0.0, {}, 0.01, 20.0, 0.005);
  const auto angle_deg = [&](std::int64_t k) {
    const SinCos a = axis.truth(k, 0.0).angle;
    return std::atan2(a.sin, a.cos) * 180.0 / pi;
  };
  axis.move(0, 2.5, 10.0, 10.0);  // lasts 1 s
  EXPECT_NEAR(angle_deg(200 + 4000), 2.5 + 0.01 * (1.0 - std::exp(-1.0)), 1e-12);
  EXPECT_FALSE(axis.standing(200 + 4000));
  EXPECT_FALSE(axis.turning(200 + 4000));
  EXPECT_TRUE(axis.standing(400000));
  axis.move(400000, 0.0, 10.0, 10.0);
  EXPECT_NEAR(angle_deg(400000 + 200 + 4000), 0.01 - 0.01 * (1.0 - std::exp(-1.0)), 1e-12);
}

// ---- elementary functions and random numbers ----

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
