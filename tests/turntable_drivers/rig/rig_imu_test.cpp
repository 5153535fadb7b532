// The simulated unit as a source: time, counters, and its faults.
#include "turntable_drivers/rig/rig_devices.h"

#include "tests/test.h"
#include "tests/turntable_drivers/rig/perfect_rig.h"
#include "turntable_drivers/rig/rig.h"
#include "turntable_drivers/rig/rig_sensors.h"

namespace turncal {
namespace {

struct Source {
  explicit Source(const RigConfig& config) : rig(config), imu(rig) { EXPECT_TRUE(imu.open().ok()); }
  std::vector<ImuSample> read(std::size_t room, double timeout_s) {
    std::vector<ImuSample> out(room);
    const Result<std::size_t> count = imu.read(out, timeout_s);
    EXPECT_TRUE(count.ok());
    out.resize(count.ok() ? *count : 0);
    return out;
  }
  Rig rig;
  RigImu imu;
};

RigConfig quiet_config() {
  RigConfig config = perfect_rig_config();
  config.first_counter = 1000;
  return config;
}

RigConfig with_fault(const RigFault& fault) {
  RigConfig config = quiet_config();
  config.faults.push_back(fault);
  return config;
}

TEST(RigImu, ReadingPassesTimeAndNothingElseDoes) {
  Source s(quiet_config());
  EXPECT_EQ(s.read(100, 0.1).size(), 20u);
  EXPECT_NEAR(s.rig.time_s(), 0.1, 1e-12);
  EXPECT_EQ(s.read(7, 10.0).size(), 7u);
  EXPECT_EQ(s.rig.samples_passed(), 27);
  EXPECT_EQ(s.read(100, 0.004).size(), 0u);
  EXPECT_EQ(s.read(100, 0.005).size(), 1u);
  EXPECT_EQ(s.read(0, 1.0).size(), 0u);
  EXPECT_EQ(s.rig.samples_passed(), 28);
  EXPECT_EQ(s.read(1, 1.0)[0].counter, 1028);
  EXPECT_EQ(s.imu.counters().samples, 29u);
}

TEST(RigImu, ClosedSourceIsAnError) {
  Rig rig(quiet_config());
  RigImu imu(rig);
  std::vector<ImuSample> out(3);
  EXPECT_FALSE(imu.read(out, 1.0).ok());
  EXPECT_FALSE(imu.identify().ok());
  EXPECT_EQ(rig.samples_passed(), 0);
}

// A lost sample takes its 97.914 pulses of gravity with it; a duplicate that has no room comes first next time.
TEST(RigImuFaults, LostAndDuplicatedSamples) {
  constexpr auto lost = RigFaultKind::lost_sample, doubled = RigFaultKind::duplicated_sample;
  const struct {
    RigFault fault;
    std::vector<std::int64_t> counters;  // from 1000 on
    std::size_t lost, doubled;
  } cases[] = {{{.kind = lost, .sample = 5, .count = 2}, {0, 1, 2, 3, 4, 7, 8, 9}, 2, 0},
               {{.kind = lost, .sample = 5, .hidden = true}, {0, 1, 2, 3, 4, 5, 6, 7, 8}, 0, 0},
               {{.kind = doubled, .sample = 3}, {0, 1, 2, 3, 3, 4, 5, 6, 7, 8, 9}, 0, 1},
               {{.kind = doubled, .sample = 3, .hidden = true}, {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10}, 0, 0}};
  for (const auto& c : cases) {
    Source s(with_fault(c.fault));
    auto samples = s.read(4, 1.0);
    while (s.rig.samples_passed() < 10)
      for (const ImuSample& sample : s.read(1, 0.005)) samples.push_back(sample);
    std::vector<std::int64_t> counters;
    for (const ImuSample& sample : samples) {
      counters.push_back(sample.counter - 1000);
      EXPECT_NEAR(sample.accel[1], 97.914, 1e-9);
    }
    EXPECT_EQ(counters, c.counters);
    EXPECT_EQ(s.imu.counters().lost_samples, c.lost);
    EXPECT_EQ(s.imu.counters().duplicates, c.doubled);
  }
}

TEST(RigImuFaults, GlitchKnockAndInvalidFlag) {
  RigConfig config = quiet_config();
  // 1 mrad = 206.264806 arcsec = 221.095920 pulses; -0.05 m/s = -100 pulses
  config.faults = {{.kind = RigFaultKind::gyro_glitch, .sample = 2, .axis = 2, .size = 1.0},
                   {.kind = RigFaultKind::velocity_knock, .sample = 3, .axis = 0, .size = -0.05},
                   {.kind = RigFaultKind::invalid_sample, .sample = 4, .count = 2}};
  Source s(config);
  const auto samples = s.read(8, 1.0);
  for (std::size_t i = 0; i < samples.size(); ++i) {
    EXPECT_NEAR(samples[i].gyro[2], i == 2 ? 221.095920 : 0.0, 1e-5) << i;
    EXPECT_NEAR(samples[i].accel[0], i == 3 ? -100.0 : 0.0, 1e-9) << i;
    EXPECT_EQ(samples[i].flags, i == 4 || i == 5 ? sample_flag_invalid : 0u) << i;
    EXPECT_NEAR(samples[i].accel[1], 97.914, 1e-9) << i;
  }
}

// ---- rig noise ----

// The rig's noise has the sizes that its configuration states.

using rig_model::NoiseSize;
using rig_model::TriadNoise;

// Overlapping Allan variance at m samples of the integral of one channel, averaged.
double allan_variance(const std::vector<double>& integral, std::size_t m, double period_s) {
  double sum = 0.0;
  const std::size_t count = integral.size() - 2 * m;
  for (std::size_t i = 0; i < count; ++i) {
    const double d = integral[i + 2 * m] - 2.0 * integral[i + m] + integral[i];
    sum += d * d;
  }
  const double tau = double(m) * period_s;
  return sum / double(count) / (2.0 * tau * tau);
}

// Flicker through the whole rig, in its units: B = 0.01 deg/h and 5 ug, nothing else on; sums of pulses at rest. The
// floor of the Allan deviation is 0.664 B. White noise: Allan.CoefficientsOverSeeds.
TEST(RigNoise, FlickerOfTheRigIsInItsUnits) {
  std::array<double, 2> variance{};
  constexpr int seeds = 12;
  for (int seed = 0; seed < seeds; ++seed) {
    RigConfig config = perfect_rig_config();
    config.seed = std::uint64_t(seed);
    config.noise.gyro_bias_instability_degph = 0.01;
    config.noise.accel_bias_instability_ug = 5.0;
    Rig rig(config);
    constexpr std::size_t samples = 400000;  // 2000 s
    std::array<std::vector<double>, 6> integral;
    for (auto& channel : integral) channel.assign(samples + 1, 0.0);
    for (std::size_t i = 0; i < samples; ++i) {
      const ImuSample sample = next_sample(rig);
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
    TriadNoise noise(size, 0.05, std::uint64_t(seed), 1);
    std::array<double, 3> increment{};
    for (int i = 0; i < 18000; ++i) noise.add(increment);
    for (double bias : noise.bias()) square += bias * bias / 900.0;
  }
  EXPECT_NEAR(std::sqrt(square) / (0.2 * 30.0), 1.0, 0.08);
}

TEST(RigNoise, SwitchingOneSourceOffLeavesTheOthers) {
  RigConfig all = perfect_rig_config();
  all.noise = default_rig_config().noise;
  RigConfig gyro_quiet = all;
  gyro_quiet.noise.gyro_random_walk_deg_per_rt_h = gyro_quiet.noise.gyro_bias_instability_degph = 0.0;
  Rig a(all), b(gyro_quiet);
  for (int i = 0; i < 1000; ++i) EXPECT_EQ(next_sample(a).accel, next_sample(b).accel);
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
  EXPECT_EQ(digest(config), 15434108818517382049ULL);
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
