// What the unit reads at rest, by hand, and how pulses are counted.
//
// Site of every number here: latitude 29.53 deg, g = 9.7914 m/s^2. Earth rate: north 7.292115e-5 cos L = 6.3448528e-5
// rad/s = 13.0871984 deg/h, up 7.292115e-5 sin L = 3.5941319e-5 rad/s = 7.4134292 deg/h. 1 deg/h = 1 arcsec/s.
// A sample lasts 5 ms; nominal pulses are 0.932920 arcsec and 0.0005 m/s, so that 1 deg/h is 0.005/0.93292 pulses a
// sample (north 0.0701411, up 0.0397324) and g is 9.7914 * 0.005 / 0.0005 = 97.914 pulses a sample.
#include <Eigen/Core>
#include <Eigen/LU>
#include "imu_io/base/files.h"
#include "imu_io/base/key_value.h"
#include "imu_io/recordings/recording_source.h"
#include "tests/test.h"
#include "tests/turntable_drivers/rig/perfect_rig.h"
#include "turntable_drivers/rig/rig.h"
#include "turntable_drivers/rig/rig_sensors.h"

namespace turncal {
namespace {

constexpr double north = 0.0701410537, up = 0.0397323948, gravity = 97.914;

struct RestCase {
  const char* name;
  double heading_deg, pitch_deg, roll_deg;
  Triple gyro, accel;  // pulses a sample
};

class RigAtRest : public testing::TestWithParam<RestCase> {};

TEST_P(RigAtRest, ReadsEarthRateAndGravity) {
  RigConfig config = perfect_rig_config();
  config.table.power_on_deg = {GetParam().heading_deg, GetParam().pitch_deg, GetParam().roll_deg};
  Rig rig(config);
  const ImuSample sample = next_sample(rig);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(sample.gyro[i], GetParam().gyro[i], 1e-9) << "gyro " << i;
    EXPECT_NEAR(sample.accel[i], GetParam().accel[i], 1e-9) << "accelerometer " << i;
  }
}

INSTANTIATE_TEST_SUITE_P(
    Attitudes, RigAtRest,
    testing::Values(
        RestCase{"level_north", 0, 0, 0, {north, up, 0}, {0, gravity, 0}},         // x north, y up, z east
        RestCase{"level_west", -90, 0, 0, {0, up, north}, {0, gravity, 0}},        // x west, z north
        RestCase{"level_east", 90, 0, 0, {0, up, -north}, {0, gravity, 0}},        // x east, z south
        RestCase{"nose_up", 0, 90, 0, {up, -north, 0}, {gravity, 0, 0}},           // x up, y south
        RestCase{"nose_down", 0, -90, 0, {-up, north, 0}, {-gravity, 0, 0}},       // x down, y north
        RestCase{"right_side_down", 0, 0, 90, {north, 0, -up}, {0, 0, -gravity}},  // z down, y east
        RestCase{"upside_down", 0, 0, 180, {north, -up, 0}, {0, -gravity, 0}},
        RestCase{"west_left_down", -90, 0, -90, {0, -north, up}, {0, 0, gravity}},  // z up, y south: step 4 and 9
        // P = 30: x is 30 deg above north: earth rate on x cos 30 * north + sin 30 * up, on y -sin 30 north + cos 30
        // up.
        RestCase{"thirty", 0, 30, 0, {0.0806101317, -0.0006612636, 0}, {48.957, 84.7960113861, 0}},
        RestCase{"turned_once_more", 360, 0, -360, {north, up, 0}, {0, gravity, 0}}),
    [](const auto& tested) { return std::string(tested.param.name); });

// n = {{0.9331, 0.002, 0}, {0, 0.9325, 0}, ...}, N01 = 0.1 deg/h:
//   y: 7.4134292 * 0.005 / 0.9325 = 0.0397502904 pulses
//   x: (13.0871984 * 0.005 + 0.1 * 0.005 - 0.002 * 0.0397502904) / 0.9331 = 0.0705781709 pulses
// a = {{1, 7e-4, 0}, {0, 1.02, 0}, ...}, A02 = 0.004 g:
//   y: (9.7914 + 0.004 * 9.80665) * 0.005 / (1.02 * 0.0005) = 96.3786921569,  x: -7e-4 * 96.3786921569 = -0.0674650845
TEST(RigSensors, CountsInvertTheParameterEquations) {
  RigConfig config = perfect_rig_config();
  config.truth[0] = 0.1;      // N01
  config.truth[4] = 0.004;    // A02
  config.truth[6] = 0.9331;   // n11
  config.truth[7] = 0.002;    // n12
  config.truth[10] = 0.9325;  // n22
  config.truth[16] = 7e-4;    // a12
  config.truth[19] = 1.02;    // a22
  Rig rig(config);
  const ImuSample sample = next_sample(rig);
  EXPECT_NEAR(sample.gyro[0], 0.0705781709, 1e-9);
  EXPECT_NEAR(sample.gyro[1], 0.0397502904, 1e-9);
  EXPECT_NEAR(sample.accel[0], -0.0674650845, 1e-9);
  EXPECT_NEAR(sample.accel[1], 96.3786921569, 1e-9);
  EXPECT_EQ(rig.truth()[16], 7e-4);
}

TEST(RigSensors, QuantisedSumStaysWithinAPulseOfTheRealSum) {
  for (const RigQuantisation quantisation : {RigQuantisation::floor, RigQuantisation::round}) {
    RigConfig real = default_rig_config();
    real.quantisation = RigQuantisation::off;
    RigConfig counted = real;
    counted.quantisation = quantisation;
    Rig real_rig(real), counted_rig(counted);
    Triple gyro_difference{}, accel_difference{};
    for (Rig* rig : {&real_rig, &counted_rig}) rig->command_move(Axis::roll, 100.0, 10.0, 10.0);
    for (int i = 0; i < 5000; ++i) {
      const ImuSample a = next_sample(real_rig), b = next_sample(counted_rig);
      for (std::size_t axis = 0; axis < 3; ++axis) {
        EXPECT_EQ(b.gyro[axis], std::floor(b.gyro[axis]));
        EXPECT_EQ(b.accel[axis], std::floor(b.accel[axis]));
        gyro_difference[axis] += a.gyro[axis] - b.gyro[axis];
        accel_difference[axis] += a.accel[axis] - b.accel[axis];
        const double low = quantisation == RigQuantisation::floor ? 0.0 : -0.5;
        for (double difference : {gyro_difference[axis], accel_difference[axis]}) {
          ASSERT_GE(difference, low - 1e-7) << i;
          ASSERT_LT(difference, low + 1.0 + 1e-7) << i;
        }
      }
    }
  }
}

// T = 24 + 6 (1 - exp(-t/2400)): 24.000 at first, after 2400 s 24 + 6 * 0.6321206 = 27.7927.
TEST(RigSensors, TemperatureIsRecordedToAThousandth) {
  Rig rig(default_rig_config());
  std::vector<ImuSample> samples(480001);
  rig.advance(samples);
  EXPECT_EQ(samples.front().temperature_c, 24.000f);
  EXPECT_EQ(samples.back().temperature_c, 27.793f);
}

TEST(RigTruth, DrawsDependOnTheSeedAndOnNothingElse) {
  RigConfig one = default_rig_config(), two = default_rig_config(), keyed = default_rig_config();
  two.seed = 2;
  keyed.truth[3] = 0.0;
  keyed.table_errors.north_arcmin = 0.0;
  keyed.noise.gyro_random_walk_deg_per_rt_h = 0.0;
  EXPECT_EQ(Rig(one).truth(), Rig(one).truth());
  EXPECT_NE(Rig(one).truth(), Rig(two).truth());
  std::array<double, 24> expected = Rig(one).truth();
  expected[3] = 0.0;
  EXPECT_EQ(Rig(keyed).truth(), expected);
  auto errors = Rig(one).table_errors();
  for (auto& [name, value] : errors)
    if (name == "north_arcmin") value = 0.0;
  EXPECT_EQ(Rig(keyed).table_errors(), errors);
}

// c = 2 ug/C and 100 ppm/C referred to 24 C, moved to 27 C: A02 takes up 6 ug and the row 300 ppm; the two rigs' units
// are the same unit, so the counts must be the same.
TEST(RigTruth, TruthAtAnotherReferenceTemperatureIsTheSameUnit) {
  RigConfig config = default_rig_config();
  config.noise = perfect_rig_config().noise;
  config.quantisation = RigQuantisation::off;
  config.effects.accel_bias_temperature[1] = 2.0;
  config.effects.gyro_bias_temperature[0] = 0.01;
  Rig rig(config);
  const std::array<double, 24> moved = rig.truth_at_reference(27.0);
  EXPECT_NEAR(moved[4] - rig.truth()[4], 6e-6, 1e-15);
  EXPECT_NEAR(moved[0] - rig.truth()[0], 0.03, 1e-15);
  RigConfig other = config;
  other.temperature.reference_c = 27.0;
  for (std::size_t i = 0; i < 24; ++i) other.truth[i] = moved[i];
  Rig same(other);
  const ImuSample a = next_sample(rig), b = next_sample(same);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(a.gyro[i], b.gyro[i], 1e-13);
    EXPECT_NEAR(a.accel[i], b.accel[i], 1e-12);
  }
  config.effects.gyro_scale_temperature[0] = 100.0;
  EXPECT_NEAR(Rig(config).truth_at_reference(27.0)[6] * 1.0003, Rig(config).truth()[6], 1e-15);
}

// ---- rig navigation ----

// The rig against navigation: what it makes is consistent motion, and its quadrature is exact. The navigation here is written for
// this test from the definitions alone. What each parameter does in its step: tests/calib/worked_numbers_test.cpp.

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double pi = 3.14159265358979323846;
constexpr double arcsec = pi / 180.0 / 3600.0;
constexpr double g = 9.7914, g0 = 9.80665, earth = 7.292115e-5;

Matrix3d cross(const Vector3d& v) {
  Matrix3d m;
  m << 0, -v[2], v[1], v[2], 0, -v[0], -v[1], v[0], 0;
  return m;
}

// v_n = C v_b, by small steps: C <- exp(-w_ie dt) C exp(dtheta), and dV = C0 M^-1 dv - g dt with M the mean over the
// sample of the body's rotation in n back to the start of the sample, so that a constant force in n is integrated
// exactly at a constant rate.
struct Navigator {
  Matrix3d c = Matrix3d::Identity();
  Vector3d velocity = Vector3d::Zero();
  double period_s = 0.005;

  static Matrix3d exponential(const Vector3d& v) {
    const double t2 = v.squaredNorm();
    const Matrix3d k = cross(v);
    return Matrix3d::Identity() + (1.0 - t2 / 6.0 + t2 * t2 / 120.0) * k + (0.5 - t2 / 24.0 + t2 * t2 / 720.0) * k * k;
  }
  void step(const Vector3d& gyro, const Vector3d& accel) {
    const double latitude = 29.53 * pi / 180.0;
    const Vector3d earth_n = earth * Vector3d(std::cos(latitude), std::sin(latitude), 0.0);
    const Vector3d turn = gyro - c.transpose() * earth_n * period_s;  // of the body in n
    const Matrix3d k = cross(turn);
    const double t2 = turn.squaredNorm();
    const Matrix3d mean_back = Matrix3d::Identity() - (0.5 - t2 / 24.0) * k + (1.0 / 6.0 - t2 / 120.0) * k * k;
    velocity += c * mean_back.inverse() * accel - Vector3d(0.0, g, 0.0) * period_s;
    c = exponential(-earth_n * period_s) * c * exponential(gyro);
  }
};

// Calibrated with the start values of Wang (2020).
void step(Navigator& navigator, const ImuSample& sample) {
  navigator.step(Vector3d(sample.gyro[0], sample.gyro[1], sample.gyro[2]) * (0.932920 * arcsec),
                 Vector3d(sample.accel[0], sample.accel[1], sample.accel[2]) * 0.0005);
}

void run(Rig& rig, Navigator& navigator, double seconds) {
  const auto samples = int(std::lround(seconds / rig.config().sample_period_s));
  for (int i = 0; i < samples; ++i) step(navigator, next_sample(rig));
}

Matrix3d attitude(const Rig& rig) {
  const std::array<double, 9> rows = rig.attitude_nb();
  Matrix3d c;
  for (std::size_t i = 0; i < 9; ++i) c(int(i / 3), int(i % 3)) = rows[i];
  return c;
}

// Table errors, encoder harmonics and creep are real motion: started with the true attitude, a perfect unit navigates
// to the true attitude and to zero velocity. 1 ms samples keep the test's own error (rate not constant during a ramp)
// at 1e-7 m/s.
TEST(RigNavigation, PerfectUnitComesBackToRest) {
  RigConfig config = perfect_rig_config();
  config.sample_period_s = 0.001;
  config.table_errors.random_arcmin = 30.0;
  config.table_errors.creep_arcsec = {5.0, -3.0, 4.0};
  config.table_errors.encoder[1].harmonic_arcsec = 20.0;
  Rig rig(config);
  Navigator navigator;
  navigator.period_s = 0.001;
  navigator.c = attitude(rig);
  const struct {
    Axis axis;
    double target_deg, seconds;
  } moves[] = {{Axis::roll, 90, 12},
               {Axis::pitch, -180, 21},
               {Axis::heading, 45, 7.5},
               {Axis::roll, -270, 40},
               {Axis::pitch, 33.3, 30}};
  for (const auto& move : moves) {
    rig.command_move(move.axis, move.target_deg, 10.0, 10.0);
    run(rig, navigator, move.seconds);
    EXPECT_LT(navigator.velocity.norm(), 1e-6) << to_string(move.axis);
    EXPECT_LT((navigator.c - attitude(rig)).norm(), 1e-9) << to_string(move.axis);
  }
}

// The same commands with every piece of a sample cut in ten: sums of increments over the whole run agree.
TEST(RigQuadrature, TenTimesFinerChangesNothing) {
  RigConfig config = perfect_rig_config();
  config.table_errors.random_arcmin = 3.0;
  config.table_errors.creep_arcsec = {5.0, 5.0, 5.0};
  for (const std::string& key : rig_effect_keys()) *find_effect(config.effects, key) = 3.0;
  config.effects.gyro_magnetic.fill(0.01);
  config.effects.gyro_g_sensitivity.fill(0.01);
  RigConfig fine = config;
  fine.quadrature_substeps = 10;
  const auto sums = [](const RigConfig& c) {
    Rig rig(c);
    std::array<double, 6> sum{};
    const auto pass = [&](int samples) {
      for (int i = 0; i < samples; ++i) {
        const ImuSample sample = next_sample(rig);
        for (std::size_t k = 0; k < 3; ++k) {
          sum[k] += sample.gyro[k] * (0.932920 * arcsec);
          sum[3 + k] += sample.accel[k] * 0.0005;
        }
      }
    };
    for (int round = 0; round < 4; ++round) {
      const double way = round % 2 == 0 ? 1.0 : 0.0;
      rig.command_move(Axis::pitch, 180.0 * way, 10.0, 10.0);
      pass(5000);
      rig.command_move(Axis::roll, 360.0 * way, 40.0, 50.0);
      rig.command_move(Axis::heading, 77.7 * way, 13.0, 11.1);
      pass(5003);
      rig.command_move(Axis::heading, 300.0 * way, 100.0, 200.0);
      pass(301);
      rig.stop();
      pass(2000);
    }
    return sum;
  };
  const auto coarse_sums = sums(config), fine_sums = sums(fine);
  for (std::size_t k = 0; k < 3; ++k) {
    EXPECT_NEAR(coarse_sums[k], fine_sums[k], 1e-10) << k;
    EXPECT_NEAR(coarse_sums[3 + k], fine_sums[3 + k], 1e-9) << k;
  }
}

// ---- against a recording of a simulator that shares nothing with the rig ----

TEST(RigAgainstAnotherSimulator, SameUnitSameMotionSamePulses) {
  const std::string folder = TURNCAL_SOURCE_DIR "/../shared/data/recordings/clean";
  if (!path_exists(folder)) GTEST_SKIP() << "no recordings beside the repository";
  RigConfig config = perfect_rig_config();
  Result<KeyValueFile> truth = good(KeyValueFile::read(folder + "/truth.conf"));
  for (std::size_t i = 0; i < 24; ++i)
    if (const std::string key(rig_truth_keys[i]); truth->has(key)) config.truth[i] = truth->number(key);
  const Result<std::unique_ptr<RecordingSource>> recording = good(RecordingSource::open(folder));
  std::vector<std::array<double, 6>> theirs(1);  // sums of the six columns, one more than samples
  ASSERT_OK((*recording)->read([&](std::span<const ImuSample> samples) {
    for (const ImuSample& sample : samples) {
      std::array<double, 6> next = theirs.back();
      for (std::size_t k = 0; k < 6; ++k) next[k] += k < 3 ? sample.gyro[k] : sample.accel[k - 3];
      theirs.push_back(next);
    }
    return Status();
  }));
  const Segments& segments = (*recording)->segments();
  ASSERT_EQ(segments.size(), 106u);
  ASSERT_EQ(theirs.size(), std::size_t(segments.back().end_sample) + 1);

  Rig rig(config);
  std::array<double, 3> before_deg{};
  std::vector<ImuSample> samples;
  for (const Segment& segment : segments) {
    const std::array<double, 3> angles_deg = {segment.heading_deg, segment.pitch_deg, segment.roll_deg};
    for (Axis axis : all_axes) {
      const std::size_t i = index(axis);
      if (angles_deg[i] != before_deg[i]) rig.command_move(axis, angles_deg[i], 10.0, 10.0);
    }
    before_deg = angles_deg;
    samples.resize(std::size_t(segment.end_sample - segment.start_sample));
    rig.advance(samples);
    for (Axis axis : all_axes) EXPECT_FALSE(rig.axis(axis).moving);
    std::array<double, 6> ours{};
    for (const ImuSample& sample : samples) {
      for (std::size_t k = 0; k < 3; ++k) {
        ours[k] += sample.gyro[k];
        ours[3 + k] += sample.accel[k];
      }
    }
    const double seconds = 0.005 * double(samples.size());
    for (std::size_t k = 0; k < 6; ++k) {
      const double difference =
          theirs[std::size_t(segment.end_sample)][k] - theirs[std::size_t(segment.start_sample)][k] - ours[k];
      const std::string where = "samples " + std::to_string(segment.start_sample) + " on, column " + std::to_string(k);
      if (k >= 3) {
        EXPECT_NEAR(difference * 0.0005 / seconds, 0.0, 0.03) << where;  // m/s^2: 10 arc minutes of g
      } else if (segment.kind == SegmentKind::rotate) {
        EXPECT_NEAR(difference * 0.932920 / 3600.0, 0.0, 0.45) << where;  // deg in up to 360
      } else {
        EXPECT_NEAR(difference * 0.932920 / seconds, 0.0, 0.09) << where;  // deg/h: tilt 0.04, noise 0.012
      }
    }
  }
}

}  // namespace
}  // namespace turncal
