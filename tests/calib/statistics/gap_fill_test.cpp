// Samples that are lost: what they are taken for, and that the variance given is that of the error.
#include "calib/statistics/compression.h"

#include "calib/statistics/data_screen.h"
#include "tests/test.h"

namespace turncal {
namespace {

RecordingInfo info_with(IncrementKind kind) {
  RecordingInfo info;
  info.sample_period_s = 0.005;
  info.gyro_increment = info.accel_increment = kind;
  info.accel_pulse_mps = 0.0005;
  return info;
}

ImuSample sample_of(std::int64_t counter, double gyro, double accel) {
  ImuSample sample;
  sample.counter = counter;
  sample.gyro = {gyro, gyro, gyro};
  sample.accel = {accel, accel, accel};
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
      const ImuSample sample = sample_of(counter, reading(), 0.0);
      glitches.add(sample, events);
      filler.add(channels_of(sample));
    }
    double truth = 0.0;
    for (int k = 0; k < lost; ++k, ++counter) truth += reading();
    const ImuSample next = sample_of(counter, reading(), 0.0);
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

TEST(GapFill, AtRestTheVarianceIsThatOfCounting) {
  std::mt19937_64 random(2);
  for (const double rate : {0.075, 0.31, 17.4})
    EXPECT_NEAR(error_over_variance(IncrementKind::pulses, true, 1, counted(rate, 0.02, random)), 1.0, 0.2) << rate;
}

// Near a whole number of pulses what noise makes of the count is allowed for, whether it is there or not.
TEST(GapFill, AtRestItIsNeverTooSmall) {
  std::mt19937_64 random(4);
  for (const double rate : {0.075, 0.31, 0.335, 17.4, 12.001})
    for (const double noise : {0.02, 0.3, 1.0})
      for (const int lost : {1, 3}) {
        // Noise of the lost samples is no motion that is missed: it is taken off.
        const double white = lost * noise * noise;
        const double ratio =
            error_over_variance(IncrementKind::pulses, true, lost, counted(rate, noise, random), white);
        EXPECT_LT(ratio, 1.5) << rate << " " << noise << " " << lost;
      }
}

TEST(GapFill, InATurnItIsNeverTooSmall) {
  std::mt19937_64 random(3);
  for (const double rate : {180.02, 180.3, 57.5}) {
    const double ratio = error_over_variance(IncrementKind::pulses, false, 1, counted(rate, 0.02, random));
    EXPECT_LT(ratio, 1.1) << rate;
    EXPECT_GT(ratio, 0.3) << rate;
  }
}

// A table that takes up its rate: on the ramp nothing is wrong, in its corner the gap says how far it may be.
TEST(GapFill, ACornerOfTheMotionIsInTheVariance) {
  GapFiller filler(info_with(IncrementKind::physical));
  for (int k = 0; k < 40; ++k) filler.add(channels_of(sample_of(k, 2.0 * k, 0.0)));
  const Channels quiet = Channels::Constant(1e-6);
  const GapFill even = filler.fill(sample_of(42, 2.0 * 42, 0.0), 2, false, quiet);
  EXPECT_DOUBLE_EQ(even.first[0], 80.0);
  EXPECT_DOUBLE_EQ(even.step[0], 2.0);
  EXPECT_LT(even.variance[0], 1e-5);
  const GapFill corner = filler.fill(sample_of(42, 80.0, 0.0), 2, false, quiet);  // the rate stays at 80
  const double truth = 160.0;
  const double sum = 2.0 * corner.first[0] + corner.step[0];
  EXPECT_GT(std::abs(sum - truth), 0.5);
  EXPECT_LT(std::abs(sum - truth), 2.0 * std::sqrt(corner.variance[0]));
}

}  // namespace
}  // namespace turncal
