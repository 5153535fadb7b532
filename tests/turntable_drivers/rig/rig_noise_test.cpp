// The rig's noise has the sizes that its configuration states.
#include "turntable_drivers/rig/rig_sensors.h"

#include <cmath>
#include <cstring>
#include <numeric>
#include <vector>

#include <gtest/gtest.h>

#include "tests/turntable_drivers/rig/perfect_rig.h"
#include "turntable_drivers/rig/rig.h"

namespace turncal {
namespace {

using rig_model::NoiseSize;
using rig_model::TriadNoise;

constexpr double pi = 3.14159265358979323846;

// Overlapping Allan variance at m samples of the integral of one channel, averaged.
double allan_variance(const std::vector<double>& integral, std::size_t m, double period_s) {
  double sum = 0.0;
  const std::size_t count = integral.size() - 2 * m;
  for (std::size_t i = 0; i < count; ++i) {
    const double d = integral[i + 2 * m] - 2.0 * integral[i + m] + integral[i];
    sum += d * d;
  }
  const double tau = static_cast<double>(m) * period_s;
  return sum / static_cast<double>(count) / (2.0 * tau * tau);
}

// Mean Allan deviation of 3 * seeds channels.
std::vector<double> allan_deviations(const NoiseSize& size, double period_s, std::size_t samples, int seeds,
                                     const std::vector<std::size_t>& places) {
  std::vector<double> variance(places.size(), 0.0);
  for (int seed = 0; seed < seeds; ++seed) {
    TriadNoise noise(size, period_s, static_cast<std::uint64_t>(seed), 0);
    std::array<std::vector<double>, 3> integral;
    for (auto& channel : integral) channel.assign(samples + 1, 0.0);
    for (std::size_t i = 0; i < samples; ++i) {
      std::array<double, 3> increment{};
      noise.add(increment);
      for (std::size_t k = 0; k < 3; ++k) integral[k][i + 1] = integral[k][i] + increment[k];
    }
    for (std::size_t j = 0; j < places.size(); ++j) {
      for (const auto& channel : integral) variance[j] += allan_variance(channel, places[j], period_s) / (3.0 * seeds);
    }
  }
  for (double& v : variance) v = std::sqrt(v);
  return variance;
}

// White noise: Allan deviation N / sqrt(tau). 60 channels of 20 000 samples give it to 0.3 % at 1 s, 2 % at 50 s.
TEST(RigNoise, RandomWalk) {
  NoiseSize size;
  size.white = 2.5;
  const auto deviation = allan_deviations(size, 0.01, 20000, 20, {1, 100, 5000});
  EXPECT_NEAR(deviation[0] / (2.5 / std::sqrt(0.01)), 1.0, 0.005);
  EXPECT_NEAR(deviation[1] / 2.5, 1.0, 0.02);
  EXPECT_NEAR(deviation[2] / (2.5 / std::sqrt(50.0)), 1.0, 0.2);
}

// Flicker: Allan deviation 0.664 B well inside the time constants (0.24 s to 1000 s).
// 120 channels of 8000 s: the spread is 1 % at 4 s and about 4 % at 256 s; the sum of Markov processes ripples by 1 %
// and is 2.5 % low at either end, for want of shorter and longer processes.
TEST(RigNoise, FlickerHasTheFloorOfBiasInstability) {
  NoiseSize size;
  size.flicker = 3.0;
  const auto deviation = allan_deviations(size, 0.05, 160000, 40, {80, 320, 1280, 5120});
  for (std::size_t i = 0; i < 3; ++i) EXPECT_NEAR(deviation[i] / 3.0, 0.664, 0.03) << i;
  EXPECT_NEAR(deviation[3] / 3.0, 0.650, 0.05);
}

// The same through the whole rig, with its units: B = 0.01 deg/h and 5 ug, nothing else on; sums of pulses at rest.
TEST(RigNoise, FlickerOfTheRigIsInItsUnits) {
  std::array<double, 2> variance{};
  constexpr int seeds = 12;
  for (int seed = 0; seed < seeds; ++seed) {
    RigConfig config = perfect_rig_config();
    config.seed = static_cast<std::uint64_t>(seed);
    config.noise.gyro_bias_instability_degph = 0.01;
    config.noise.accel_bias_instability_ug = 5.0;
    Rig rig(config);
    constexpr std::size_t samples = 400000;  // 2000 s
    std::array<std::vector<double>, 6> integral;
    for (auto& channel : integral) channel.assign(samples + 1, 0.0);
    for (std::size_t i = 0; i < samples; ++i) {
      ImuSample sample;
      rig.advance({&sample, 1});
      for (std::size_t k = 0; k < 3; ++k) {
        integral[k][i + 1] = integral[k][i] + sample.gyro[k] * 0.932920;                      // arcsec: deg/h times s
        integral[3 + k][i + 1] = integral[3 + k][i] + sample.accel[k] * 0.0005 / 9.80665e-6;  // ug s
      }
    }
    for (std::size_t k = 0; k < 6; ++k) variance[k / 3] += allan_variance(integral[k], 4000, 0.005) / (3.0 * seeds);
  }
  EXPECT_NEAR(std::sqrt(variance[0]) / 0.01, 0.664, 0.05);
  EXPECT_NEAR(std::sqrt(variance[1]) / 5.0, 0.664, 0.05);
}

// Rate random walk: the bias after t has sigma K sqrt(t). 3 * 300 values after 900 s give it to 2.4 %.
TEST(RigNoise, RateRandomWalk) {
  NoiseSize size;
  size.rate_walk = 0.2;
  double square = 0.0;
  for (int seed = 0; seed < 300; ++seed) {
    TriadNoise noise(size, 0.05, static_cast<std::uint64_t>(seed), 1);
    std::array<double, 3> increment{};
    for (int i = 0; i < 18000; ++i) noise.add(increment);
    for (double bias : noise.bias()) square += bias * bias / 900.0;
  }
  EXPECT_NEAR(std::sqrt(square) / (0.2 * 30.0), 1.0, 0.08);
}

// Default noise in one hour, without bias instability: the angle spreads by 0.002 deg = 7.2 arcsec, the velocity by
// 8e-6 * 9.80665 * 60 = 4.7072e-3 m/s. 3 axes x 30 seeds over 100 s (sqrt(100/3600) of it): to 7.5 % (one sigma).
TEST(RigNoise, DefaultRandomWalksInTheirUnits) {
  double angle_square = 0.0, velocity_square = 0.0;
  for (int seed = 0; seed < 30; ++seed) {
    RigConfig config = perfect_rig_config();
    Rig still(config);
    config.seed = static_cast<std::uint64_t>(seed);
    config.noise = default_rig_config().noise;
    config.noise.gyro_bias_instability_degph = config.noise.accel_bias_instability_ug = 0.0;
    Rig rig(config);
    std::array<double, 6> sum{};
    for (int i = 0; i < 20000; ++i) {
      ImuSample a, b;
      rig.advance({&a, 1});
      still.advance({&b, 1});
      for (std::size_t k = 0; k < 3; ++k) {
        sum[k] += (a.gyro[k] - b.gyro[k]) * 0.932920;
        sum[3 + k] += (a.accel[k] - b.accel[k]) * 0.0005;
      }
    }
    for (std::size_t k = 0; k < 3; ++k) {
      angle_square += sum[k] * sum[k] / 90.0;
      velocity_square += sum[3 + k] * sum[3 + k] / 90.0;
    }
  }
  EXPECT_NEAR(std::sqrt(angle_square) / (7.2 / 6.0), 1.0, 0.22);
  EXPECT_NEAR(std::sqrt(velocity_square) / (4.7072e-3 / 6.0), 1.0, 0.22);
}

TEST(RigNoise, SwitchingOneSourceOffLeavesTheOthers) {
  RigConfig all = perfect_rig_config();
  all.noise = default_rig_config().noise;
  RigConfig gyro_quiet = all;
  gyro_quiet.noise.gyro_random_walk_deg_per_rt_h = gyro_quiet.noise.gyro_bias_instability_degph = 0.0;
  Rig a(all), b(gyro_quiet);
  for (int i = 0; i < 1000; ++i) {
    ImuSample x, y;
    a.advance({&x, 1});
    b.advance({&y, 1});
    EXPECT_EQ(x.accel, y.accel);
  }
}

std::uint64_t digest(const RigConfig& config) {
  Rig rig(config);
  std::uint64_t hash = 14695981039346656037ULL;  // FNV-1a
  const auto take = [&](const void* data, std::size_t size) {
    const auto* bytes = static_cast<const unsigned char*>(data);
    for (std::size_t i = 0; i < size; ++i) hash = (hash ^ bytes[i]) * 1099511628211ULL;
  };
  std::vector<ImuSample> samples(3000);
  for (int round = 0; round < 20; ++round) {
    rig.command_move(Axis::pitch, round % 2 == 0 ? 90.0 : 0.0, 10.0, 10.0);
    rig.command_move(Axis::heading, round * 17.0, 12.0, 9.0);
    rig.advance(samples);
    for (const ImuSample& sample : samples) {
      take(&sample.counter, sizeof sample.counter);
      take(sample.gyro.data(), sizeof sample.gyro);
      take(sample.accel.data(), sizeof sample.accel);
      take(&sample.temperature_c, sizeof sample.temperature_c);
    }
  }
  return hash;
}

// The same bytes on every machine and with every optimisation: real-valued pulses show the last bit of every sum. If
// the model is changed on purpose, put the new number here.
TEST(RigDeterminism, SameSeedSameBytes) {
  RigConfig config = default_rig_config();
  for (const std::string& key : rig_effect_keys()) *find_effect(config.effects, key) = 0.01;
  config.noise.gyro_rate_random_walk_degph_per_rt_h = 0.001;
  config.table_errors.creep_arcsec = {1.0, 2.0, 3.0};
  config.quantisation = RigQuantisation::off;
  EXPECT_EQ(digest(config), digest(config));
  EXPECT_EQ(digest(config), 6576257072502615593ULL);
  RigConfig other = config;
  other.noise_seed = 2;
  EXPECT_NE(digest(config), digest(other));
}

// Samples do not depend on how they are fetched.
TEST(RigDeterminism, BatchesDoNotMatter) {
  Rig one(default_rig_config()), many(default_rig_config());
  one.command_move(Axis::roll, 10.0, 10.0, 10.0);
  many.command_move(Axis::roll, 10.0, 10.0, 10.0);
  std::vector<ImuSample> a(997), b(997);
  one.advance(a);
  for (std::size_t done = 0; done < b.size();) {
    const std::size_t size = std::min<std::size_t>(1 + done % 7, b.size() - done);
    many.advance(std::span(b).subspan(done, size));
    done += size;
  }
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].gyro, b[i].gyro);
    EXPECT_EQ(a[i].accel, b[i].accel);
    EXPECT_EQ(a[i].counter, b[i].counter);
  }
}

}  // namespace
}  // namespace turncal
