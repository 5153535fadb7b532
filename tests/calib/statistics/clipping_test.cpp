// Clipped gyros, and temperatures that are read more seldom than samples come.
#include "calib/statistics/clipping.h"

#include "calib/statistics/data_screen.h"
#include "tests/calib/compress.h"
#include "tests/calib/hand_rotations.h"
#include "tests/test.h"

namespace turncal {
namespace {

TEST(Clipping, RunsOfTheExtremeValueAreFound) {
  HandData hand = make_hand_data({.seed = 5});
  const double limit = 0.8 * 0.01;  // rad a sample, at 0.8 rad/s
  const std::int64_t clipped = clip_gyros(hand, limit);
  std::int64_t found = 0;
  ClippingFinder finder;
  for (const ImuSample& sample : hand.samples) finder.add(sample);
  ASSERT_GT(clipped, 100);
  for (const DataEvent& run : finder.finish()) {
    found += run.count;
    EXPECT_NEAR(std::abs(run.size), limit, 1e-15);
  }
  EXPECT_GT(found, 0.9 * double(clipped));  // runs of one or two are not counted
  EXPECT_LE(found, clipped);
}

TEST(Clipping, IsNotSeenWhereNothingClips) {
  for (unsigned seed = 1; seed <= 20; ++seed)
    for (const double step : {0.0, 0.001 * 0.01}) {  // rad a sample: 0.06 deg/s, as 16 bits over 2000 deg/s
      HandPlan plan;
      plan.seed = seed;
      if (step > 0.0) plan.gyro_noise_radps = 0.0005;
      HandData hand = make_hand_data(plan);
      ClippingFinder finder;
      for (ImuSample& sample : hand.samples) {
        if (step > 0.0)
          for (double& x : sample.gyro) x = step * std::round(x / step);
        finder.add(sample);
      }
      EXPECT_TRUE(finder.finish().empty()) << seed << " " << step;
    }
}

// A table's constant rate, counted in steps: 193.9 of them a sample, 194 or 193 at a time. The same cut at 150 stands.
TEST(Clipping, AConstantRateFlickersBetweenTwoSteps) {
  for (const double range : {1e9, 150.0}) {
    ClippingFinder finder;
    double angle = 0.0;
    for (std::int64_t k = 0; k < 20000; ++k) {
      const double rate = 193.9 * std::clamp(std::abs(double(k % 4000) - 2000.0) / 200.0 - 4.0, 0.0, 1.0);
      const double before = std::floor(angle);
      angle += rate;
      ImuSample sample;
      sample.counter = k;
      sample.gyro[0] = 1e-5 * std::min(range, std::floor(angle) - before);
      finder.add(sample);
    }
    EXPECT_EQ(finder.finish().empty(), range > 1e6) << range;
  }
}

TEST(Clipping, FlaggedSamplesAreTaken) {
  ClippingFinder finder;
  for (int k = 0; k < 100; ++k) {
    ImuSample sample;
    sample.counter = k;
    sample.gyro = {0.001 * k, 0.0, 0.0};
    if (k >= 50 && k < 53) sample.flags = gyro_clipped_flag(0) | sample_flag_invalid;
    finder.add(sample);
  }
  const std::vector<DataEvent> runs = finder.finish();
  ASSERT_EQ(runs.size(), 1u);
  EXPECT_EQ(runs[0].sample, 50);
  EXPECT_EQ(runs[0].count, 3);
}

// A thermometer that is read every 50th row.
TEST(Temperature, BlanksAreInterpolatedAndNotZero) {
  HandData hand = make_hand_data({});
  hand.info.has_temperature = true;
  const auto truth = [](double sample) { return 20.0 + 0.001 * sample; };
  for (std::size_t k = 0; k < hand.samples.size(); k += 50) hand.samples[k].temperature_c = float(truth(double(k)));
  const CompressedRecording recording = compress(hand.info, hand.segments, hand.samples);
  EXPECT_NEAR(recording.mean_temperature_c, truth(0.5 * double(hand.samples.size())), 0.05);
  for (const Block& block : recording.blocks)  // a reading lies up to half a block, 50 samples, from its middle
    EXPECT_NEAR(block.temperature_c, truth(double(block.start_sample) + 0.5 * block.samples), 0.06);
  for (ImuSample& sample : hand.samples) sample.temperature_c = NAN;
  EXPECT_FALSE(compress(hand.info, hand.segments, hand.samples).info.has_temperature);
}

// ---- gap fill ----

// Samples that are lost: what they are taken for, and that the variance given is that of the error.

RecordingInfo info_with(IncrementKind kind) {
  RecordingInfo info = pulses_info();
  info.gyro_increment = info.accel_increment = kind;
  return info;
}

ImuSample sample_of(std::int64_t counter, double gyro) {
  ImuSample sample;
  sample.counter = counter;
  sample.gyro = {gyro, gyro, gyro};
  return sample;
}

// Error squared of the sum over `lost` samples less `white`, over the variance given, mean over many gaps.
template <class Reading>
double error_over_variance(IncrementKind kind, bool at_rest, int lost, Reading reading, double white = 0.0) {
  const RecordingInfo info = info_with(kind);
  GapFiller filler(info);
  GlitchFinder glitches(info, {});
  std::vector<DataEvent> events;
  double error = 0.0, variance = 0.0;
  std::int64_t counter = 0;
  for (int gap = 0; gap < 4000; ++gap) {
    for (int k = 0; k < 60; ++k, ++counter) {
      const ImuSample sample = sample_of(counter, reading());
      glitches.add(sample, events);
      filler.add(channels_of(sample));
    }
    double truth = 0.0;
    for (int k = 0; k < lost; ++k, ++counter) truth += reading();
    const ImuSample next = sample_of(counter, reading());
    const GapFill fill = filler.fill(next, lost, at_rest, glitches.mean_square());
    const double sum = lost * (fill.first[0] + 0.5 * (lost - 1) * fill.step[0]);
    error += std::pow(sum - truth, 2) - white;
    variance += fill.variance[0];
    glitches.add(next, events);
    filler.add(channels_of(next));
    ++counter;
  }
  return error / variance;
}

// A counter of a rate that is a part of a pulse a sample, with a little noise.
auto counted(double rate, double noise, std::mt19937_64& random) {
  return [=, &random, angle = 0.0, before = 0.0]() mutable {
    angle += rate + std::normal_distribution<double>(0.0, noise)(random);
    const double count = std::floor(angle) - before;
    before = std::floor(angle);
    return count;
  };
}

TEST(GapFill, TheVarianceIsThatOfTheErrorForWhiteNoise) {
  std::mt19937_64 random(1);
  const auto white = [&] { return 10.0 + std::normal_distribution<double>(0.0, 0.3)(random); };
  for (const bool at_rest : {true, false})
    for (const int lost : {1, 2, 5})
      EXPECT_NEAR(error_over_variance(IncrementKind::physical, at_rest, lost, white), 1.0, 0.12) << at_rest << lost;
}

TEST(GapFill, TheVarianceIsThatOfCounting) {
  std::mt19937_64 random(2);
  const struct {
    bool at_rest;
    double rate, least, most;
  } cases[] = {{true, 0.075, 0.8, 1.2},   {true, 0.31, 0.8, 1.2},   {true, 17.4, 0.8, 1.2},
               {false, 180.02, 0.3, 1.1}, {false, 180.3, 0.3, 1.1}, {false, 57.5, 0.3, 1.1}};
  for (const auto& [at_rest, rate, least, most] : cases) {
    const double ratio = error_over_variance(IncrementKind::pulses, at_rest, 1, counted(rate, 0.02, random));
    EXPECT_GT(ratio, least) << rate;
    EXPECT_LT(ratio, most) << rate;
  }
}

// Near a whole number of pulses what noise makes of the count is allowed for, whether it is there or not. Noise of the lost samples is no
// motion that is missed: it is taken off.
TEST(GapFill, AtRestItIsNeverTooSmall) {
  std::mt19937_64 random(4);
  for (const double rate : {0.31, 0.335, 12.001})
    for (const double noise : {0.02, 0.3, 1.0})
      for (const int lost : {1, 3})
        EXPECT_LT(
            error_over_variance(IncrementKind::pulses, true, lost, counted(rate, noise, random), lost * noise * noise),
            1.5)
            << rate << " " << noise << " " << lost;
}

// A table that takes up its rate: on the ramp nothing is wrong, in its corner the gap says how far it may be.
TEST(GapFill, ACornerOfTheMotionIsInTheVariance) {
  GapFiller filler(info_with(IncrementKind::physical));
  for (int k = 0; k < 40; ++k) filler.add(channels_of(sample_of(k, 2.0 * k)));
  const Channels quiet = Channels::Constant(1e-6);
  const GapFill even = filler.fill(sample_of(42, 2.0 * 42), 2, false, quiet);
  EXPECT_DOUBLE_EQ(even.first[0], 80.0);
  EXPECT_DOUBLE_EQ(even.step[0], 2.0);
  EXPECT_LT(even.variance[0], 1e-5);
  const GapFill corner = filler.fill(sample_of(42, 80.0), 2, false, quiet);  // the rate stays at 80
  const double truth = 160.0;
  const double sum = 2.0 * corner.first[0] + corner.step[0];
  EXPECT_GT(std::abs(sum - truth), 0.5);
  EXPECT_LT(std::abs(sum - truth), 2.0 * std::sqrt(corner.variance[0]));
}

}  // namespace
}  // namespace turncal
