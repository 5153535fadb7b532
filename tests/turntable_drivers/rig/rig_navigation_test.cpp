// The rig against navigation: what it makes is consistent motion, and its quadrature is exact. The navigation here is written for
// this test from the definitions alone. What each parameter does in its step: tests/calib/worked_numbers_test.cpp.
#include "tests/test.h"

#include <Eigen/Core>
#include <Eigen/LU>

#include "imu_io/base/key_value.h"
#include "imu_io/base/posix_file.h"
#include "imu_io/recordings/recording_source.h"
#include "tests/turntable_drivers/rig/perfect_rig.h"
#include "turntable_drivers/rig/rig.h"

namespace turncal {
namespace {

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
  const auto samples = static_cast<int>(std::lround(seconds / rig.config().sample_period_s));
  for (int i = 0; i < samples; ++i) step(navigator, next_sample(rig));
}

Matrix3d attitude(const Rig& rig) {
  const std::array<double, 9> rows = rig.attitude_nb();
  Matrix3d c;
  for (std::size_t i = 0; i < 9; ++i) c(static_cast<int>(i / 3), static_cast<int>(i % 3)) = rows[i];
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
  ASSERT_EQ(theirs.size(), static_cast<std::size_t>(segments.back().end_sample) + 1);

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
    samples.resize(static_cast<std::size_t>(segment.end_sample - segment.start_sample));
    rig.advance(samples);
    for (Axis axis : all_axes) EXPECT_FALSE(rig.axis(axis).moving);
    std::array<double, 6> ours{};
    for (const ImuSample& sample : samples) {
      for (std::size_t k = 0; k < 3; ++k) {
        ours[k] += sample.gyro[k];
        ours[3 + k] += sample.accel[k];
      }
    }
    const double seconds = 0.005 * static_cast<double>(samples.size());
    for (std::size_t k = 0; k < 6; ++k) {
      const double difference = theirs[static_cast<std::size_t>(segment.end_sample)][k] -
                                theirs[static_cast<std::size_t>(segment.start_sample)][k] - ours[k];
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
