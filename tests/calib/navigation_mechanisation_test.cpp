// The mechanisation against truths that were made by other means: closed forms of the unforced Earth, of Schuler's oscillation,
// and a flight along a great circle written in inertial axes.
#include "calib/model/parameters.h"
#include "calib/navigation/mechanisation.h"
#include "tests/test.h"

namespace turncal {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

// NIMA TR8350.2, tables 3.1 to 3.4; NGA's calculator for 45 deg.
TEST(NavigationEarth, PublishedValues) {
  EXPECT_NEAR(normal_gravity_mps2(0.0, 0.0), 9.7803253359, 1e-10);
  EXPECT_NEAR(normal_gravity_mps2(0.5 * pi, 0.0), 9.8321849379, 2e-10);
  EXPECT_NEAR(normal_gravity_mps2(0.25 * pi, 0.0), 9.8061977694, 1e-9);
  // The free-air gradient, 3.086e-6 1/s^2.
  EXPECT_NEAR(normal_gravity_mps2(0.25 * pi, 1000.0) - normal_gravity_mps2(0.25 * pi, 0.0), -3.0855e-3, 2e-6);
  EXPECT_NEAR(radii_of_curvature(0.0).north_m, 6335439.3273, 1e-3);
  EXPECT_NEAR(radii_of_curvature(0.0).east_m, 6378137.0, 1e-6);
  EXPECT_NEAR(radii_of_curvature(0.5 * pi).north_m, 6399593.6258, 1e-3);
  EXPECT_NEAR(radii_of_curvature(0.5 * pi).east_m, 6399593.6258, 1e-3);
}

constexpr double gravity = 9.7914;
constexpr double T = 0.1;

// A unit that stands at the equator, level, front north (body axes are n), with errors of its readings.
MotionInterval resting_at_equator(const Vector3d& gyro_error_radps, const Vector3d& accel_error_mps2) {
  MotionInterval interval;
  interval.gyro_rad = T * (Vector3d(earth_rate_radps, 0.0, 0.0) + gyro_error_radps);
  interval.turn = quaternion_of(interval.gyro_rad);
  // The push in axes that stand still while the body turns by half a micro-radian: C push, to second order.
  interval.accel_mps = T * (Vector3d(0.0, gravity, 0.0) + accel_error_mps2);
  interval.push_mps = interval.accel_mps + 0.5 * interval.gyro_rad.cross(interval.accel_mps);
  interval.duration_s = T;
  return interval;
}

struct Flown {
  NavigationState end;
  Eigen::Vector2d moved_m;
};
Flown navigate_at_equator(const Vector3d& gyro_error_radps, const Vector3d& accel_error_mps2, double seconds) {
  NavigationState start;
  Navigator navigator(start, gravity, true);
  const MotionInterval interval = resting_at_equator(gyro_error_radps, accel_error_mps2);
  for (int k = 0; k < std::lround(seconds / T); ++k) navigator.advance(interval);
  return {navigator.state(), displacement_m(navigator.state(), 0.0, 0.0)};
}

TEST(NavigationSchuler, AtRestNothingMoves) {
  const Flown run = navigate_at_equator(Vector3d::Zero(), Vector3d::Zero(), 7200.0);
  EXPECT_LT(run.end.velocity_n_mps.norm(), 1e-6);
  EXPECT_LT(run.moved_m.norm(), 1e-2);
}

// At the equator the level errors have closed forms with no approximation but smallness. With ws^2 = g / R (R the radius of
// curvature of the direction), W the Earth's rate, s = phi_E + dr_N / R (s' = -w_E - W phi_U, phi_U' = W s - w_U):
//   accelerometer error b north:  v_N = b / ws sin(ws t),              r_N = b / ws^2 (1 - cos ws t)
//   gyro error w north:           v_E = R w (1 - cos ws t),            r_E = R w (t - sin(ws t) / ws)
//   gyro error w east:            v_N = -g w (cos W t - cos ws t) / (ws^2 - W^2)
//   gyro error w up:              v_N = g w (sin W t - W / ws sin ws t) / (ws^2 - W^2)
// A quarter, half, three quarters and the whole of a Schuler period, and three hours.
TEST(NavigationSchuler, ErrorsAtTheEquatorAreTheClosedForms) {
  constexpr double R = wgs84_semi_major_m, W = earth_rate_radps, w = 0.01 * radps_per_degph, b = 100e-6 * 9.8;
  const double ws_north = std::sqrt(gravity / (R * std::pow(1.0 - wgs84_flattening, 2)));
  const double ws_east = std::sqrt(gravity / R), of_level = gravity * w / (ws_north * ws_north - W * W);
  for (const double t : {1266.0, 2532.0, 3798.0, 5064.0, 10800.0}) {
    SCOPED_TRACE(t);
    const Flown push_north = navigate_at_equator(Vector3d::Zero(), {b, 0.0, 0.0}, t);
    EXPECT_NEAR(push_north.end.velocity_n_mps[0], b / ws_north * std::sin(ws_north * t), 1e-4 * b / ws_north);
    EXPECT_NEAR(push_north.moved_m[0], b / (ws_north * ws_north) * (1.0 - std::cos(ws_north * t)), 2e-4 * 1271.0);
    const Flown push_east = navigate_at_equator(Vector3d::Zero(), {0.0, 0.0, b}, t);
    EXPECT_NEAR(push_east.end.velocity_n_mps[2], b / ws_east * std::sin(ws_east * t), 1e-3 * b / ws_east);
    const Flown turn_north = navigate_at_equator({w, 0.0, 0.0}, Vector3d::Zero(), t);
    EXPECT_NEAR(turn_north.end.velocity_n_mps[2], R * w * (1.0 - std::cos(ws_east * t)), 1e-3 * R * w);
    EXPECT_NEAR(turn_north.moved_m[1], R * w * (t - std::sin(ws_east * t) / ws_east), 1e-3 * R * w * t);
    EXPECT_NEAR(turn_north.end.velocity_n_mps[0], 0.0, 1e-3 * R * w);
    const Flown turn_east = navigate_at_equator({0.0, 0.0, w}, Vector3d::Zero(), t);
    EXPECT_NEAR(turn_east.end.velocity_n_mps[0], -of_level * (std::cos(W * t) - std::cos(ws_north * t)),
                1e-3 * of_level);
    const Flown turn_up = navigate_at_equator({0.0, w, 0.0}, Vector3d::Zero(), t);
    EXPECT_NEAR(turn_up.end.velocity_n_mps[0], of_level * (std::sin(W * t) - W / ws_north * std::sin(ws_north * t)),
                1e-3 * of_level);
  }
}

// The flight. Latitude and longitude go along a great circle of the unit sphere (u its angle from the node, i its inclination),
//   sin L = sin i sin u,  tan lon = cos i tan u,  u = u0 + n t
// at a height that rises. Place and velocity in inertial axes (Earth's axis z, x at longitude 0 when t = 0) are closed forms of
// L, lon, h and their rates; the body keeps its axes in inertial space, so its velocity increments are differences of inertial
// velocity less gravitation, and its gyros are silent.
class Flight {
 public:
  explicit Flight(double height_mps) : climb_(height_mps) {}
  static constexpr double inclination = 50.0 * rad_per_deg, u0 = -0.3, n = 250.0 / 6378137.0;
  double u(double t) const { return u0 + n * t; }
  double latitude(double t) const { return std::asin(std::sin(inclination) * std::sin(u(t))); }
  double longitude(double t) const { return std::atan2(std::cos(inclination) * std::sin(u(t)), std::cos(u(t))); }
  double latitude_rate(double t) const { return n * std::sin(inclination) * std::cos(u(t)) / std::cos(latitude(t)); }
  double longitude_rate(double t) const { return n * std::cos(inclination) / std::pow(std::cos(latitude(t)), 2); }
  double height(double t) const { return 1000.0 + climb_ * t; }

  static constexpr double a = 6378137.0, f = 1.0 / 298.257223563, e2 = f * (2.0 - f);
  double east_radius(double L) const { return a / std::sqrt(1.0 - e2 * std::sin(L) * std::sin(L)); }
  double north_radius(double L) const { return a * (1.0 - e2) / std::pow(1.0 - e2 * std::sin(L) * std::sin(L), 1.5); }

  // Right angle of the local meridian plane in inertial space: longitude and Earth's turn.
  double hour(double t) const { return longitude(t) + earth_rate_radps * t; }
  Vector3d velocity_i(double t) const {
    const double L = latitude(t), h = height(t), c = std::cos(hour(t)), s = std::sin(hour(t));
    const double out = (east_radius(L) + h) * std::cos(L);
    const double out_rate = -(north_radius(L) + h) * std::sin(L) * latitude_rate(t) + climb_ * std::cos(L);
    const double hour_rate = longitude_rate(t) + earth_rate_radps;
    return {out_rate * c - out * s * hour_rate, out_rate * s + out * c * hour_rate,
            (north_radius(L) + h) * std::cos(L) * latitude_rate(t) + climb_ * std::sin(L)};
  }
  Vector3d gravitation_i(double t) const {
    const double L = latitude(t), h = height(t), c = std::cos(hour(t)), s = std::sin(hour(t));
    // Normal gravity by the two-radius form, with the polar value; height to second order.
    const double b = a * (1.0 - f);
    const double C2 = std::pow(std::cos(L), 2), S2 = std::pow(std::sin(L), 2);
    const double surface = (a * 9.7803253359 * C2 + b * 9.8321849379 * S2) / std::sqrt(a * a * C2 + b * b * S2);
    const double g =
        surface * (1.0 - 2.0 * h / a * (1.0 + f + 0.00344978650684 - 2.0 * f * S2) + 3.0 * h * h / (a * a));
    const Vector3d down(-std::cos(L) * c, -std::cos(L) * s, -std::sin(L));
    const double out = (east_radius(L) + h) * std::cos(L);
    const double W = earth_rate_radps;
    return g * down - W * W * out * Vector3d(c, s, 0.0);  // gravity holds the centrifugal part
  }
  // Columns: north, up, east in inertial axes.
  Matrix3d axes(double t) const {
    const double L = latitude(t), c = std::cos(hour(t)), s = std::sin(hour(t));
    Matrix3d m;
    m.col(0) << -std::sin(L) * c, -std::sin(L) * s, std::cos(L);
    m.col(1) << std::cos(L) * c, std::cos(L) * s, std::sin(L);
    m.col(2) << -s, c, 0.0;
    return m;
  }
  Vector3d velocity_n(double t) const {
    const double L = latitude(t), h = height(t);
    return {(north_radius(L) + h) * latitude_rate(t), climb_, (east_radius(L) + h) * std::cos(L) * longitude_rate(t)};
  }

 private:
  double climb_;
};

void expect_flown(const Flight& flight) {
  NavigationState start;
  start.q_nb = Quaterniond(Matrix3d(flight.axes(0.0).transpose()));  // body axes are the inertial ones
  start.velocity_n_mps = flight.velocity_n(0.0);
  start.latitude_rad = flight.latitude(0.0);
  start.longitude_rad = flight.longitude(0.0);
  start.height_m = flight.height(0.0);
  Navigator navigator(start, normal_gravity_mps2(start.latitude_rad, start.height_m), false);
  MotionInterval interval;
  interval.duration_s = T;
  constexpr int steps = 36000;
  for (int k = 0; k < steps; ++k) {
    const double t = k * T;
    const Vector3d pull =
        T / 6.0 * (flight.gravitation_i(t) + 4.0 * flight.gravitation_i(t + 0.5 * T) + flight.gravitation_i(t + T));
    interval.push_mps = flight.velocity_i(t + T) - flight.velocity_i(t) - pull;
    navigator.advance(interval);
  }
  const double t = steps * T;  // 900 km further, from 13 deg south to 6 deg south
  const Eigen::Vector2d off = displacement_m(navigator.state(), flight.latitude(t), flight.longitude(t));
  EXPECT_LT(off.norm(), 0.1);
  EXPECT_LT((navigator.state().velocity_n_mps - flight.velocity_n(t)).norm(), 1e-3);
  // The vertical channel multiplies what rounding and the step leave by exp(3600 / 562 s) = 600.
  EXPECT_NEAR(navigator.state().height_m, flight.height(t), 0.5);
  const Quaterniond truth(Matrix3d(flight.axes(t).transpose()));
  EXPECT_LT(navigator.state().q_nb.angularDistance(truth), 1e-8);
}
TEST(NavigationFlight, GreatCircle) {
  expect_flown(Flight(0.0));
  expect_flown(Flight(2.0));
}

TEST(NavigationAngles, OfTheTablesConvention) {
  for (const Vector3d& degrees :
       {Vector3d(270.0, 0.0, 0.0), Vector3d(12.0, 40.0, -130.0), Vector3d(359.0, -85.0, 179.0)}) {
    const Vector3d r = degrees * rad_per_deg;
    const Quaterniond q = Quaterniond(Eigen::AngleAxisd(-r[0], Vector3d::UnitY())) *
                          Quaterniond(Eigen::AngleAxisd(r[1], Vector3d::UnitZ())) *
                          Quaterniond(Eigen::AngleAxisd(r[2], Vector3d::UnitX()));
    const AttitudeAngles angles = angles_of(q);
    EXPECT_NEAR(angles.heading_rad, r[0], 1e-12);
    EXPECT_NEAR(angles.pitch_rad, r[1], 1e-12);
    EXPECT_NEAR(angles.roll_rad, r[2], 1e-12);
  }
}

// ---- navigation increments ----

// Coning and sculling of motions whose result is known in closed form.

// Angle (rad) of what turns a into b.
double angle_between(const Quaterniond& a, const Quaterniond& b) { return (a.conjugate() * b).vec().norm() * 2.0; }

// The cone q(t) = (cos(b/2), sin(b/2) cos wt, sin(b/2) sin wt, 0) has, by 2 q* q', the body rate
//   (-w sin b sin wt, w sin b cos wt, -2 w sin^2(b/2)), whose integrals are elementary.
class Coning {
 public:
  Coning(double half_angle_rad, double w) : b_(half_angle_rad), w_(w) {}
  Quaterniond attitude(double t) const {
    return {std::cos(b_ / 2), std::sin(b_ / 2) * std::cos(w_ * t), std::sin(b_ / 2) * std::sin(w_ * t), 0.0};
  }
  Vector3d increment(double t1, double t2) const {
    return {std::sin(b_) * (std::cos(w_ * t2) - std::cos(w_ * t1)),
            std::sin(b_) * (std::sin(w_ * t2) - std::sin(w_ * t1)),
            -2.0 * w_ * std::pow(std::sin(b_ / 2), 2) * (t2 - t1)};
  }

 private:
  double b_, w_;
};

struct Moved {
  Quaterniond q = Quaterniond::Identity();
  Vector3d v = Vector3d::Zero();
};
Moved moved_by(const IncrementIntegrator& integrator) {
  Moved moved;
  for (const MotionInterval& interval : integrator.intervals()) {
    moved.v += moved.q * interval.push_mps;
    moved.q = moved.q * interval.turn;
  }
  return moved;
}

TEST(NavigationIncrements, ConingDriftIsTakenOff) {
  constexpr double dt = 0.005, w = 2.0 * pi * 5.0, b = 0.1 * rad_per_deg;
  const Coning cone(b, w);
  IncrementIntegrator integrator(dt, 20);
  for (int k = 0; k < 40000; ++k) integrator.add(k, cone.increment(k * dt, (k + 1) * dt), Vector3d::Zero(), false);
  const double seconds = 40000 * dt;
  const Quaterniond truth = cone.attitude(0.0).conjugate() * cone.attitude(seconds);
  // Plain products of the increments miss the share 1 - sin(w dt) / (w dt) of the cone's rate w sin^2(b) / 2. With b^2 / 6
  // (1 - cos(w dt)) sin(w dt) a sample the algorithm takes off all but (w dt)^4 / 30 of the rate.
  const double coning_rate = 0.5 * w * std::pow(std::sin(b), 2);
  const double uncorrected = coning_rate * (1.0 - std::sin(w * dt) / (w * dt)) * seconds;
  const double left = coning_rate * std::pow(w * dt, 4) / 30.0 * seconds;
  ASSERT_GT(uncorrected, 100.0 * left);
  EXPECT_NEAR(angle_between(moved_by(integrator).q, truth), left, 0.02 * left);
}

// Rocking about x, a = A sin wt, while the body's y axis feels B sin wt. Along the fixed z axis the mean of
// B sin wt sin(A sin wt) is B J1(A), J1 the Bessel function.
TEST(NavigationIncrements, ScullingIsTakenOff) {
  constexpr double dt = 0.005, w = 2.0 * pi * 4.0, A = 0.02, B = 10.0;
  constexpr int n = 20000;  // 400 whole periods
  IncrementIntegrator integrator(dt, 20);
  for (int k = 0; k < n; ++k) {
    const double t1 = k * dt, t2 = t1 + dt;
    integrator.add(k, {A * (std::sin(w * t2) - std::sin(w * t1)), 0.0, 0.0},
                   {0.0, B / w * (std::cos(w * t1) - std::cos(w * t2)), 0.0}, false);
  }
  const auto [q, v] = moved_by(integrator);
  const double truth = B * std::cyl_bessel_j(1.0, A) * n * dt;
  // Without the sculling term (w dt)^2 / 12 of it is missing; with it a term of fourth order.
  EXPECT_NEAR(v[2], truth, 3e-5 * truth);
  EXPECT_GT(w * w * dt * dt / 12.0, 1e-3);
  EXPECT_NEAR(v[1], 0.0, 1e-4);
}

// A turn at a constant rate under a constant push in body axes: v = (sin, 1 - cos) / rate, exactly.
TEST(NavigationIncrements, ConstantTurnIsExact) {
  constexpr double dt = 0.005, rate = 100.0 * rad_per_deg, push = 9.8;
  IncrementIntegrator integrator(dt, 10);
  constexpr int n = 180;  // a quarter of a turn
  for (int k = 0; k < n; ++k) integrator.add(k, {0.0, 0.0, rate * dt}, {push * dt, 0.0, 0.0}, false);
  const auto [q, v] = moved_by(integrator);
  const double angle = rate * dt * n;
  EXPECT_NEAR(angle, 0.5 * pi, 1e-12);
  // (rate dt)^3 / 24 of the push is left of the series, 2e-7 m/s; without its second-order term 7e-5 m/s.
  EXPECT_NEAR(v[0], push / rate * std::sin(angle), 1e-6);
  EXPECT_NEAR(v[1], push / rate * (1.0 - std::cos(angle)), 1e-6);
  EXPECT_LT(angle_between(q, Quaterniond(Eigen::AngleAxisd(angle, Vector3d::UnitZ()))), 1e-12);
}

TEST(NavigationIncrements, LostSamplesAreFilledInAndCounted) {
  IncrementIntegrator integrator(0.005, 10);
  for (int k = 0; k < 100; ++k)
    if (k < 42 || k >= 47) integrator.add(k, {1e-6, 2e-6, 3e-6}, {0.0, 0.049, 0.0}, true);
  integrator.add(99, {1.0, 1.0, 1.0}, {1.0, 1.0, 1.0}, true);  // a duplicate is dropped
  ASSERT_EQ(integrator.intervals().size(), 10u);
  for (std::size_t k = 0; k < 10; ++k) {
    EXPECT_EQ(integrator.intervals()[k].missing, k == 4 ? 5 : 0);
    EXPECT_NEAR(integrator.intervals()[k].accel_mps[1], 0.49, 1e-12);
    EXPECT_TRUE(integrator.intervals()[k].at_rest);
  }
}

}  // namespace
}  // namespace turncal
