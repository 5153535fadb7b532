// Alignment, and the covariance of what follows, on motions made here: rests and turns about fixed axes at a fixed point.
#include "calib/model/attitude.h"
#include "calib/navigation/alignment.h"
#include "calib/navigation/free_navigation.h"
#include "calib/navigation/mechanisation.h"
#include "tests/calib/compress.h"
#include "tests/test.h"

namespace turncal {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr int samples_per_interval = 20;

struct Phase {  // a rest when the rate is zero
  double seconds = 0.0;
  Vector3d axis_b = Vector3d::UnitX();
  double rate_radps = 0.0;
};

// Samples of an ideal unit at a fixed point. C_ib = Exp(W t) C_nb; a sample's gyro increment is the rotation vector of its turn,
// its velocity increment the integral of C_bi f_i over it, by Simpson.
struct Samples {
  std::vector<Vector3d> gyro, accel;
  std::vector<char> at_rest;
  Quaterniond q_nb;  // at the end
};
Samples samples_of(const Quaterniond& start_q_nb, const std::vector<Phase>& phases,
                   const DriftCovariance::Site& drift_site) {
  const Vector3d earth = earth_rate_n(drift_site.latitude_rad / rad_per_deg);
  Samples samples;
  Quaterniond q = start_q_nb;
  const auto angle_axis = [](const Vector3d& v) {
    const double angle = v.norm();
    return angle > 0.0 ? Quaterniond(Eigen::AngleAxisd(angle, v / angle)) : Quaterniond::Identity();
  };
  for (const Phase& phase : phases) {
    const Quaterniond begun = q;
    const long n = std::lround(phase.seconds / dt);
    // Body relative to the axes of n at the sample's start, t s into it.
    const auto attitude = [&](double t_of_phase, double t_of_sample) {
      return angle_axis(earth * t_of_sample) * begun * angle_axis(phase.axis_b * phase.rate_radps * t_of_phase);
    };
    const auto force = [&](double t_of_phase, double t_of_sample) {  // in body axes
      const Vector3d up = angle_axis(earth * t_of_sample) * Vector3d(0.0, drift_site.gravity_mps2, 0.0);
      return Vector3d(attitude(t_of_phase, t_of_sample).conjugate() * up);
    };
    for (long k = 0; k < n; ++k) {
      const double t = double(k) * dt;
      const Eigen::AngleAxisd turn(attitude(t, 0.0).conjugate() * attitude(t + dt, dt));
      samples.gyro.push_back(turn.axis() * turn.angle());
      samples.accel.push_back(dt / 6.0 * (force(t, 0.0) + 4.0 * force(t + 0.5 * dt, 0.5 * dt) + force(t + dt, dt)));
      samples.at_rest.push_back(phase.rate_radps == 0.0);
    }
    q = begun * angle_axis(phase.axis_b * phase.rate_radps * phase.seconds);
  }
  samples.q_nb = q;
  return samples;
}

std::vector<MotionInterval> integrated(const Samples& samples, const Parameters& wrong) {
  IncrementIntegrator integrator(dt, samples_per_interval);
  integrator.reserve(std::int64_t(samples.gyro.size()));
  const Vector3d gyro_bias = wrong.N0_degph * radps_per_degph * dt;
  const Vector3d accel_bias = wrong.A0_g * standard_gravity_mps2 * dt;
  for (std::size_t k = 0; k < samples.gyro.size(); ++k)
    integrator.add(std::int64_t(k), wrong.n * samples.gyro[k] - gyro_bias, wrong.a * samples.accel[k] - accel_bias,
                   samples.at_rest[k] != 0);
  return integrator.intervals();
}

Parameters ideal() {
  Parameters parameters;
  parameters.n.setIdentity();
  return parameters;
}

NoiseModel some_noise() {
  NoiseModel noise;
  noise.gyro_bias_instability_radps = 0.002 * radps_per_degph;
  noise.accel_bias_instability_mps2 = 5e-6;
  noise.accel_pulse_mps = 0.0005;
  return noise;
}

constexpr DriftCovariance::Site drift_site{-38.0 * rad_per_deg, 9.8003};

// Rest, a turn while aligning, rest; a turn of the navigation and an hour less a bit.
std::vector<Phase> walk(double rest_s) {
  return {{60.0},
          {9.0, Vector3d::UnitX(), 10.0 * rad_per_deg},
          {81.0},
          {18.0, Vector3d(0.6, 0.8, 0.0), -10.0 * rad_per_deg},
          {rest_s}};
}
constexpr std::size_t align_intervals = 1500;  // 150 s

struct Result7 {
  Eigen::Matrix<double, 7, 1> x;
  DriftCovariance drift;
};
Eigen::Matrix<double, 7, 1> error_of(const NavigationState& s, const Quaterniond& true_q_nb) {
  Quaterniond off = true_q_nb * s.q_nb.conjugate();  // C_true = Exp(phi) C
  if (off.w() < 0.0) off.coeffs() = -off.coeffs();
  const Eigen::Vector2d moved = displacement_m(s, drift_site.latitude_rad, 0.0);
  Eigen::Matrix<double, 7, 1> x;
  x << 2.0 * off.vec(), s.velocity_n_mps[0], s.velocity_n_mps[2], moved;
  return x;
}
Result7 navigate(const std::vector<MotionInterval>& intervals, const Quaterniond& true_end_q_nb,
                 const NoiseModel& noise, const std::optional<CountsModel>& counts) {
  Result<Alignment> alignment =
      align(std::span(intervals).first(align_intervals), drift_site, DriftCovariance(drift_site, noise, counts));
  EXPECT_TRUE(alignment.ok());
  Navigator navigator(alignment->state, drift_site.gravity_mps2, true);
  for (std::size_t k = align_intervals; k < intervals.size(); ++k) {
    const Quaterniond before = navigator.state().q_nb;
    navigator.advance(intervals[k]);
    alignment->drift.advance(before.slerp(0.5, navigator.state().q_nb).toRotationMatrix(), intervals[k]);
  }
  return {error_of(navigator.state(), true_end_q_nb), alignment->drift};
}

TEST(NavigationAlignment, ExactWithoutNoiseThroughATurn) {
  for (const Vector3d& degrees :
       {Vector3d(0.0, 0.0, 0.0), Vector3d(200.0, 60.0, 170.0), Vector3d(-75.0, -89.9, 20.0)}) {
    const Vector3d r = degrees * rad_per_deg;
    const Samples samples = samples_of(Quaterniond(attitude_from_angles(r[0], r[1], r[2])), walk(1.0), drift_site);
    const std::vector<MotionInterval> intervals = integrated(samples, ideal());
    const Quaterniond coarse = coarse_alignment(std::span(intervals).first(align_intervals), drift_site);
    EXPECT_LT(coarse.angularDistance(Quaterniond(attitude_from_angles(r[0], r[1], r[2]))), 1e-5);
    const Result7 end = navigate(intervals, samples.q_nb, some_noise(), {});
    EXPECT_LT(end.x.head<3>().norm(), 2e-6) << degrees.transpose();
    EXPECT_LT(end.x.segment<2>(3).norm(), 1e-4);
  }
}

TEST(NavigationAlignment, RefusesWhatCannotBeAligned) {
  const DriftCovariance drift(drift_site, some_noise(), {});
  const std::vector<MotionInterval> turning =
      integrated(samples_of(Quaterniond::Identity(), {{5.0}, {30.0, Vector3d::UnitY(), 0.1}}, drift_site), ideal());
  EXPECT_ERROR(align(turning, drift_site, drift), "alignment: 5 s at rest, expected at least 20 s");
  EXPECT_FALSE(align(turning, {86.0 * rad_per_deg, 9.83}, drift).ok());
}

// Each column dx/dp of the linear model against the difference that a wrong parameter makes to the whole: alignment through a turn,
// another turn, free navigation.
void expect_sensitivity_of(double rest_s) {
  const Samples samples = samples_of(Quaterniond(attitude_from_angles(1.0, 0.4, -0.3)), walk(rest_s), drift_site);
  const NoiseModel noise = some_noise();
  RecordingInfo info;
  info.gyro_increment = info.accel_increment = IncrementKind::physical;
  const Result7 base = navigate(integrated(samples, ideal()), samples.q_nb, noise, counts_model(ideal(), info));
  for (const int p : free_parameters()) {
    ParameterVector v = to_vector(ideal());
    const double step = p < 3 ? 0.01 : 1e-6;
    v[p] += step;
    const Result7 wrong = navigate(integrated(samples, from_vector(v)), samples.q_nb, noise, {});
    const Eigen::Matrix<double, 7, 1> difference = wrong.x - base.x;
    const Eigen::Matrix<double, 7, 1> linear = step * base.drift.sensitivity().col(p).head<7>();
    // Each of attitude, velocity and position against the size of its own.
    for (const auto& [first, count] : {std::pair{0, 3}, std::pair{3, 2}, std::pair{5, 2}})
      EXPECT_LT((difference - linear).segment(first, count).norm(), 0.02 * linear.segment(first, count).norm() + 1e-9)
          << parameter_keys[p] << " rows " << first << ": " << difference.transpose() << " against "
          << linear.transpose();
  }
}
TEST(NavigationSensitivity, AgreesWithTheDifferenceOfTwoNavigations) {
  expect_sensitivity_of(60.0);
  expect_sensitivity_of(1500.0);
}

// The noise part of the covariance against what noise does: 60 runs, normalised error squared of the seven states together.
// chi2 with 60 * 7 degrees of freedom: 420 +- 3.3 * 29.
TEST(NavigationDrift, NoiseCovarianceIsConsistent) {
  const Quaterniond start(attitude_from_angles(2.0, 0.1, 0.2));
  const std::vector<Phase> rest = {{150.0}, {1800.0}};
  const Samples samples = samples_of(start, rest, drift_site);
  const std::vector<MotionInterval> quiet = integrated(samples, ideal());
  NoiseModel noise = some_noise();
  noise.angle_random_walk.setConstant(1.2e-6);
  noise.accel_pulse_mps = 0.0;
  std::mt19937_64 random(7);
  std::normal_distribution<double> normal;
  const auto draw = [&] { return Vector3d(normal(random), normal(random), normal(random)); };
  double nees = 0.0;
  constexpr int runs = 60;
  Eigen::Matrix<double, 7, 1> ratio = Eigen::Matrix<double, 7, 1>::Zero();
  for (int run = 0; run < runs; ++run) {
    std::vector<MotionInterval> intervals = quiet;
    Vector3d gyro_bias = noise.gyro_bias_instability_radps * draw();
    Vector3d accel_bias = noise.accel_bias_instability_mps2 * draw();
    const double T = intervals.front().duration_s;
    const double keep = std::exp(-T / noise.bias_correlation_s), gain = std::sqrt(1.0 - keep * keep);
    for (MotionInterval& interval : intervals) {
      const Vector3d turned = std::sqrt(T) * noise.angle_random_walk.cwiseProduct(draw()) + T * gyro_bias;
      const Vector3d pushed = std::sqrt(T) * noise.velocity_random_walk.cwiseProduct(draw()) + T * accel_bias;
      interval.turn = interval.turn * quaternion_of(turned);
      interval.push_mps += pushed;
      gyro_bias = keep * gyro_bias + gain * noise.gyro_bias_instability_radps * draw();
      accel_bias = keep * accel_bias + gain * noise.accel_bias_instability_mps2 * draw();
    }
    const Result7 end = navigate(intervals, samples.q_nb, noise, {});
    const Eigen::Matrix<double, 7, 7> P = end.drift.noise_covariance().topLeftCorner<7, 7>();
    const Eigen::Matrix<double, 7, 1> sigma = P.diagonal().cwiseSqrt();
    const Eigen::Matrix<double, 7, 1> x = end.x.cwiseQuotient(sigma);
    const Eigen::Matrix<double, 7, 7> R = sigma.cwiseInverse().asDiagonal() * P * sigma.cwiseInverse().asDiagonal();
    nees += x.dot(R.ldlt().solve(x));
    ratio += x.cwiseAbs2() / runs;
  }
  EXPECT_NEAR(nees, 7.0 * runs, 3.3 * std::sqrt(2.0 * 7.0 * runs)) << ratio.transpose();
  for (int k = 0; k < 7; ++k) EXPECT_NEAR(ratio[k], 1.0, 3.5 * std::sqrt(2.0 / runs)) << k;
}

// Two samples filled in, in one interval: 2 q / sqrt(12); singles add in squares.
TEST(NavigationDrift, SamplesThatWereFilledInShow) {
  NoiseModel noise;
  noise.gyro_pulse_rad = 0.93 * rad_per_arcsec;
  noise.accel_pulse_mps = 0.0005;
  const auto grown = [&](int singles, int doubles) {
    DriftCovariance drift({30.0 * rad_per_deg, 9.79}, noise, std::nullopt);
    drift.begin(0.0, 0.0);
    MotionInterval interval;
    interval.duration_s = 0.1;
    for (int k = 0; k < 200; ++k) {
      interval.missing = k < singles ? 1 : k < singles + doubles ? 2 : 0;
      drift.advance(Eigen::Matrix3d::Identity(), interval);
    }
    drift.begin_navigation();
    return drift.noise_covariance();
  };
  const DriftMatrix none = grown(0, 0);
  const double angle = std::pow(noise.gyro_pulse_rad, 2) / 12.0;
  EXPECT_NEAR(grown(0, 1)(1, 1) - none(1, 1), 4.0 * angle, 0.01 * angle);
  EXPECT_NEAR(grown(100, 0)(1, 1) - none(1, 1), 100.0 * angle, 1.0 * angle);
  EXPECT_GT(grown(1, 0)(3, 3) - none(3, 3), 0.9 * std::pow(noise.accel_pulse_mps, 2) / 12.0);
}

// Without data: the same covariance as that of a unit that stands there.
TEST(NavigationDrift, ExpectedAtRestIsThatOfARecordingAtRest) {
  FreeNavigationSetup setup;
  setup.site = drift_site;
  setup.noise = some_noise();
  RecordingInfo info;
  info.gyro_increment = info.accel_increment = IncrementKind::physical;
  setup.counts = counts_model(ideal(), info);
  setup.parameter_covariance.diagonal().head<3>().setConstant(4e-6);
  setup.parameter_covariance.diagonal().segment<3>(3).setConstant(1e-12);
  setup.align_s = 100.0;
  const Samples samples = samples_of(Quaterniond(attitude_from_angles(0.5, 0.0, 0.0)), {{1300.0}}, drift_site);
  const std::vector<MotionInterval> intervals = integrated(samples, ideal());
  const Result<FreeNavigation> navigated = good(navigate_freely(intervals, setup));
  const ExpectedDrift expected = expected_drift(setup, 0.5, 1200.0, 300.0);
  ASSERT_EQ(expected.points.size(), 4u);
  EXPECT_NEAR(expected.points.back().time_s, 1200.0, 1e-6);
  const Eigen::Matrix2d& covariance = expected.points.back().covariance_m2;
  EXPECT_LT((covariance - navigated->end_covariance_m2).norm(), 1e-3 * covariance.norm());
  EXPECT_LT((expected.align_sigma_rad - navigated->align_sigma_rad).norm(), 1e-3 * expected.align_sigma_rad.norm());
  EXPECT_LT(expected.points.back().noise_m2.trace(), covariance.trace());
  // The unit has no error: it stays.
  EXPECT_LT(navigated->track.back().moved_m.norm(), 1.0);
  EXPECT_LT(navigated->nm_per_h, 1e-3);
}

TEST(NavigationError, RatesOfKnownRuns) {
  RadialErrorRate rate;
  for (int k = 0; k <= 360; ++k) rate.add(10.0 * k, 10.0 * k * 1852.0 / 3600.0 * 0.7);  // 0.7 nautical miles an hour
  EXPECT_NEAR(rate.nm_per_h(), 0.7, 1e-12);
  EXPECT_EQ(RadialErrorRate().nm_per_h(), 0.0);
  // 20 000 draws of alike normal errors: half lie within CEP, 95 % within R95.
  std::mt19937_64 random(3);
  std::normal_distribution<double> normal;
  std::vector<double> radial(20000);
  for (double& r : radial) r = std::hypot(normal(random), normal(random));
  const DriftOverRuns drift = drift_over_runs(radial);
  const auto share = [&](double limit) {
    return double(std::ranges::count_if(radial, [&](double r) { return r <= limit; })) / 20000.0;
  };
  EXPECT_NEAR(share(drift.cep_nm_per_h), 0.5, 0.012);
  EXPECT_NEAR(share(drift.r95_nm_per_h), 0.95, 0.006);
}

}  // namespace
}  // namespace turncal
