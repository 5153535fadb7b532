// Coning and sculling of motions whose result is known in closed form.
#include "calib/model/parameters.h"
#include "calib/navigation/mechanisation.h"
#include "tests/test.h"

namespace turncal {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

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

Quaterniond product_of(const std::vector<MotionInterval>& intervals) {
  Quaterniond q = Quaterniond::Identity();
  for (const MotionInterval& interval : intervals) q = q * interval.turn;
  return q;
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
  EXPECT_NEAR(angle_between(product_of(integrator.intervals()), truth), left, 0.02 * left);
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
  Quaterniond q = Quaterniond::Identity();
  Vector3d v = Vector3d::Zero();
  for (const MotionInterval& interval : integrator.intervals()) {
    v += q * interval.push_mps;
    q = q * interval.turn;
  }
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
  Quaterniond q = Quaterniond::Identity();
  Vector3d v = Vector3d::Zero();
  for (const MotionInterval& interval : integrator.intervals()) {
    v += q * interval.push_mps;
    q = q * interval.turn;
  }
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
