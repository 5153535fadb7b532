// The trapezoid of one axis, signs of geometry, random numbers. That rates are derivatives: rig_rest_test.cpp.
#include "turntable_drivers/rig/rig_axes.h"

#include "tests/test.h"
#include "turntable_drivers/rig/rig_geometry.h"
#include "turntable_drivers/rig/rig_math.h"

namespace turncal::rig_model {
namespace {

using Eigen::Vector3d;

// 90 deg at 10 deg/s and 10 deg/s^2: 1 s up (5 deg), 8 s cruise, 1 s down. 2.5 deg never reach 10 deg/s: the peak is sqrt(2.5 * 10) = 5 deg/s
// after 0.5 s. From 10 deg/s the other way: brakes in 1 s (5 deg past the start), then goes back 15 deg.
TEST(RigMotion, MovesAreTrapezoids) {
  const AxisProfile far = AxisProfile::move(0.0, 0.0, 90.0, 10.0, 10.0),
                    near = AxisProfile::move(1.0, 0.0, -1.5, 10.0, 10.0),
                    back = AxisProfile::move(0.0, 10.0, -10.0, 10.0, 10.0),
                    brake = AxisProfile::brake(20.0, -8.0, 16.0);
  const struct {
    const AxisProfile& profile;
    double time_s, position_deg, rate_degps;
  } cases[] = {{far, 0.5, 1.25, 5.0},  {far, 1.0, 5.0, 10.0}, {far, 5.0, 45.0, 10.0},   {far, 9.5, 88.75, 5.0},
               {far, 10.0, 90.0, 0.0}, {far, 1e6, 90.0, 0.0}, {near, 0.5, -0.25, -5.0}, {near, 1.0, -1.5, 0.0},
               {back, 0.0, 0.0, 10.0}, {back, 1.0, 5.0, 0.0}, {back, 4.0, -10.0, 0.0},  {brake, 0.5, 18.0, 0.0}};
  for (const auto& c : cases) {
    EXPECT_NEAR(c.profile.at(c.time_s).position_deg, c.position_deg, 1e-12) << c.time_s;
    EXPECT_NEAR(c.profile.at(c.time_s).rate_degps, c.rate_degps, 1e-12) << c.time_s;
  }
  EXPECT_DOUBLE_EQ(far.at(9.5).acceleration_degps2, -10.0);
  for (const auto& [profile, duration_s] :
       {std::pair(&far, 10.0), {&near, 1.0}, {&back, 1.0 + 1.0 + 0.5 + 1.0}, {&brake, 0.5}})
    EXPECT_DOUBLE_EQ(profile->duration_s(), duration_s);
  EXPECT_EQ(near.last_direction(), -1.0);
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

// Outputs of the authors' reference program for the state 1, 2, 3, 4.
TEST(RigRandom, GeneratorGivesThePublishedNumbers) {
  RandomStream random(std::array<std::uint64_t, 4>{1, 2, 3, 4});
  EXPECT_EQ(random.next(), 41943041u);
  EXPECT_EQ(random.next(), 58720359u);
  EXPECT_EQ(random.next(), 3588806011781223u);
  EXPECT_EQ(random.next(), 3591011842654386u);
  EXPECT_EQ(random.next(), 9228616714210784205u);
}

}  // namespace
}  // namespace turncal::rig_model
