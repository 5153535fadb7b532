// A unit of which a channel, or all six, give one and the same number in a dwell while its counter runs on.
#include "orchestrator/run/dwell_monitor.h"

#include "calib/statistics/data_screen.h"

#include "tests/orchestrator/rig_station.h"

namespace turncal {
namespace {

// `count` samples from `first` on, of pulses that come at random; from `from` to before `to` the numbers of the sample before.
std::vector<ImuSample> dwell(std::mt19937_64& random, std::int64_t first, std::int64_t count, std::int64_t from = 0,
                             std::int64_t to = 0) {
  std::poisson_distribution<int> few(0.05), many(98.0);
  std::vector<ImuSample> samples(static_cast<std::size_t>(count));
  for (std::int64_t k = 0; k < count; ++k) {
    ImuSample& s = samples[std::size_t(k)];
    for (double& x : s.gyro) x = few(random);
    for (double& x : s.accel) x = many(random);
    if (k >= from && k < to && k > 0) s = samples[std::size_t(k - 1)];
    s.counter = first + k;
  }
  return samples;
}

// What a dwell monitor says of a dwell, with room for what is not still in coarse units.
std::string dwell_defect(DwellMonitor& monitor, const std::vector<ImuSample>& samples) {
  monitor.start(samples.front().counter, std::int64_t(samples.size()));
  std::optional<DwellMonitor::Defect> defect;
  for (std::size_t k = 0; k < samples.size() && !defect; k += 100)
    defect = monitor.add(std::span(samples).subspan(k, 100));
  return defect ? defect->reason : "";
}

DwellMonitor patient_monitor() {
  RigConfig config = default_rig_config();
  Rig rig(config);
  RecordingInfo info;
  RigImu(rig).describe(info);
  DwellConfig dwell_config;
  dwell_config.max_gyro_std_degps = dwell_config.max_gyro_peak_degps = 10.0;
  dwell_config.max_accel_std_mps2 = dwell_config.max_accel_peak_mps2 = 10.0;
  return {dwell_config, info};
}

// Anywhere in a dwell of 100 s, the first and a repeated one, at its beginning and to its end too: the samples that repeat the one before are
// named with it, as soon as the stretch is over.
TEST(DeadChannels, AllSixFrozenAreNamedWithTheVerySamples) {
  std::mt19937_64 random(6);
  DwellMonitor monitor = patient_monitor();
  for (int draw = 0; draw < 60; ++draw) {
    const auto length = std::int64_t(500 + random() % 4000);
    const auto from = draw == 0 ? 1 : draw == 1 ? 20000 - length : std::int64_t(1 + random() % 15000);
    const std::vector<ImuSample> samples = dwell(random, 7000, 20000, from, from + length);
    const std::string text = dwell_defect(monitor, samples);
    const std::string named = std::to_string(7000 + from - 1) + " to " + std::to_string(7000 + from + length - 1);
    EXPECT_TRUE(text.starts_with("all six channels") && text.find(named) != std::string::npos) << text << ": " << named;
    const std::int64_t told = 20000 - monitor.remaining();
    EXPECT_LE(told, std::min<std::int64_t>(from + length + 500, 20000));
    EXPECT_GE(told, from + length);
    if (draw % 10 == 0) {
      ASSERT_EQ(dwell_defect(monitor, dwell(random, 0, 4000)), "");
    }
  }
}

TEST(DeadChannels, WhatGoesOnIsToldAfterHalfAMinute) {
  std::mt19937_64 random(8);
  DwellMonitor monitor = patient_monitor();
  const std::string text = dwell_defect(monitor, dwell(random, 0, 120000, 1000, 120000));
  EXPECT_TRUE(text.starts_with("all six channels gave the same in 6")) << text;
  EXPECT_LE(120000 - monitor.remaining(), 7300);
}

TEST(DeadChannels, AUnitThatIsUsedToItIsNotFrozen) {
  std::mt19937_64 random(9);
  DwellMonitor monitor = patient_monitor();
  // Coarse: nothing but a flicker of one channel, a few seconds apart.
  std::bernoulli_distribution flickers(0.002);
  std::vector<ImuSample> coarse(20000);
  for (int i = 0; i < 20; ++i) {
    for (std::size_t k = 0; k < coarse.size(); ++k) {
      coarse[k].counter = std::int64_t(k);
      coarse[k].accel[1] = flickers(random) ? 1.0 : 0.0;
    }
    EXPECT_EQ(dwell_defect(monitor, coarse), "");
  }
  // Without any noise: dwells of different lengths, each one number.
  for (const std::size_t count : {200U, 20000U, 400U, 120000U, 12000U}) {
    std::vector<ImuSample> silent(count);
    for (std::size_t k = 0; k < count; ++k) silent[k].counter = std::int64_t(k);
    EXPECT_EQ(dwell_defect(monitor, silent), "") << count;
  }
}

// Six dwells of 100 s of a clean unit of any grade, at any heading, each of its axes near the east at some of them.
std::vector<std::vector<ImuSample>> clean_unit(std::uint64_t seed) {
  std::mt19937_64 random(seed);
  const auto draw = [&](double from, double to) { return std::uniform_real_distribution(from, to)(random); };
  RigConfig config = default_rig_config();
  config.seed = seed;
  const double grade = std::exp(draw(std::log(0.01), std::log(1000.0)));
  config.noise.gyro_random_walk_deg_per_rt_h *= grade;
  config.noise.gyro_bias_instability_degph *= grade;
  config.noise.accel_random_walk_ug_per_rt_hz *= std::min(grade, 30.0);
  Rig rig(config);
  RigTable table(rig);
  RigImu imu(rig);
  EXPECT_TRUE(table.connect().ok() && table.enable().ok() && imu.open().ok());
  std::vector<ImuSample> some(2000);
  const auto pass = [&](double seconds) {
    for (double left_s = seconds; left_s > 0.0; left_s -= 10.0)
      EXPECT_TRUE(imu.read(some, std::min(left_s, 10.0)).ok());
  };
  EXPECT_TRUE(table.home().ok());
  pass(5.0);
  std::vector<std::vector<ImuSample>> dwells;
  for (int i = 0; i < 6; ++i) {
    const double to_deg = i % 2 == 0 ? 90.0 * double(random() % 4) : draw(0.0, 360.0);
    const Axis axis = all_axes[random() % 3];
    EXPECT_TRUE(table.move_absolute(axis, to_deg, 50.0, 100.0).ok());
    pass(12.0);
    dwells.emplace_back(20000);
    const Result<std::size_t> got = imu.read(dwells.back(), 100.0);
    EXPECT_TRUE(got.ok() && *got == 20000u);
  }
  return dwells;
}

TEST(DeadChannels, OfHundredsOfDwellsOfCleanUnitsNoneIsFrozen) {
  int dwells = 0;
  for (std::uint64_t seed = 1; seed <= 100; ++seed) {
    DwellMonitor monitor = patient_monitor();
    for (const std::vector<ImuSample>& one : clean_unit(seed)) {
      ASSERT_EQ(dwell_defect(monitor, one), "") << "unit " << seed;
      ++dwells;
      for (std::size_t from = 0; from < one.size(); from += 1000) {  // and of 5 s
        const auto piece = one.begin() + std::ptrdiff_t(from);
        ASSERT_EQ(dwell_defect(monitor, {piece, piece + 1000}), "") << "unit " << seed << " from " << from;
      }
    }
  }
  EXPECT_EQ(dwells, 600);
}

// A gyro reads zero for 1 to 10 s, from any sample on, while the others live. Noticed wherever that costs more than what its noise does.
TEST(DeadChannels, AGyroThatReadsZeroForSecondsIsNoticed) {
  int harmful = 0, noticed = 0, wrong = 0;
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    std::mt19937_64 random(seed);
    DwellMonitor monitor = patient_monitor();
    for (std::vector<ImuSample> last : clean_unit(seed)) {
      const std::size_t channel = random() % 3, length = 200 + random() % 1800, from = random() % 15000;
      double sum = 0.0, squares = 0.0;
      for (std::size_t window = 0; window < 100; ++window) {
        double counts = 0.0;
        for (std::size_t k = 200 * window; k < 200 * (window + 1); ++k) counts += last[k].gyro[channel];
        sum += counts;
        squares += counts * counts;
      }
      const double mean = sum / 100.0, sigma = std::sqrt(std::max(0.0, squares / 100.0 - mean * mean));
      const double windows = double(length) / 200.0;
      for (std::size_t k = from; k < from + length; ++k) last[k].gyro[channel] = 0.0;
      const std::string text = dwell_defect(monitor, last);
      wrong += !text.empty() && !text.starts_with(channel_names[channel]) ? 1 : 0;
      const bool visible = std::abs(mean) * windows > 10.0 * std::sqrt(sigma * sigma * windows + 1.0 / 6.0);
      harmful += visible ? 1 : 0;
      noticed += visible && !text.empty() ? 1 : 0;
    }
  }
  EXPECT_EQ(wrong, 0);
  EXPECT_GE(harmful, 40);
  EXPECT_EQ(noticed, harmful);
}

// In a dwell of 5 s of a unit that sends rad, a third of it zero at a hundred times the noise: no other dwell tells what it is used to.
TEST(DeadChannels, AGyroThatReadsZeroInAShortDwellIsNoticed) {
  RecordingInfo info;
  info.sample_period_s = 0.01;
  info.gyro_increment = info.accel_increment = IncrementKind::physical;
  std::mt19937_64 random(4);
  std::normal_distribution<double> noise;
  for (int draw = 0; draw < 200; ++draw) {
    const std::size_t count = draw % 2 == 0 ? 500 : 1000, length = 100 + random() % (count / 2 - 100);
    const std::size_t from = random() % (count - length), channel = random() % 3;
    std::vector<ImuSample> samples(count);
    for (std::size_t k = 0; k < count; ++k) {
      samples[k].counter = std::int64_t(k);
      for (double& x : samples[k].gyro) x = 1e-9 * std::round(1e9 * (7e-7 + 1e-7 * noise(random)));
      for (double& x : samples[k].accel) x = 1e-6 * std::round(1e6 * (0.05 + 1e-5 * noise(random)));
    }
    DwellConfig config;  // with room for what is not still
    config.max_gyro_std_degps = config.max_gyro_peak_degps = 10.0;
    DwellMonitor monitor(config, info);
    ASSERT_EQ(dwell_defect(monitor, samples), "") << draw;
    for (std::size_t k = from; k < from + length; ++k) samples[k].gyro[channel] = 0.0;
    EXPECT_TRUE(dwell_defect(monitor, samples).starts_with(channel_names[channel]))
        << draw << ": " << dwell_defect(monitor, samples);
  }
}

// For 15 s of a dwell of 60 s: the dwell is repeated once, and the run goes on.
TEST(DeadChannels, ARunRepeatsTheDwell) {
  RigStation rig(
      "format = 1\nname = frozen\nrate_degps = 30\nacceleration_degps2 = 60\nstep 1\n  initial H 0 P 0 R 0\n"
      "  align 2000\n  rotate P +90\n  dwell 12000\n  rotate P -90\n");
  ImuSample last;
  FrontUnit imu(rig.devices.imu, [&](std::span<ImuSample> out, double timeout_s) {
    const Result<std::size_t> got = rig.devices.imu.read(out, timeout_s);
    for (ImuSample& sample : out.first(got ? *got : 0)) {
      if (sample.counter < 6000 || sample.counter >= 9000) last = sample;
      sample.gyro = last.gyro;
      sample.accel = last.accel;
    }
    return got;
  });
  const RunOutcome outcome = ended(rig.run_with(imu), RunState::done);
  EXPECT_EQ(outcome.repeated_dwells, 1);
  ASSERT_EQ(rig.watcher.count(RunEvent::dwell_bad), 1);
  for (const TransitionRecord& record : rig.watcher.transitions) {
    if (record.event != RunEvent::dwell_bad) continue;
    long long samples = 0, first = 0, last = 0;
    ASSERT_EQ(std::sscanf(record.detail.c_str(), "all six channels gave the same in %lld samples, %lld to %lld",
                          &samples, &first, &last),
              3)
        << record.detail;
    // The recording began 400 samples after the unit. A neighbour may happen to be the same.
    EXPECT_LE(first, 6000 - 1 - 400);
    EXPECT_GE(last, 9000 - 1 - 400);
    EXPECT_LE(samples, 3000 + 5) << record.detail;
  }
}

}  // namespace
}  // namespace turncal
