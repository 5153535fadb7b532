// Clipped gyros, and temperatures that are read more seldom than samples come.
#include "calib/statistics/clipping.h"

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
  EXPECT_GT(found, 0.9 * static_cast<double>(clipped));  // runs of one or two are not counted
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
  for (std::size_t k = 0; k < hand.samples.size(); k += 50)
    hand.samples[k].temperature_c = static_cast<float>(truth(static_cast<double>(k)));
  const CompressedRecording recording = compress(hand.info, hand.segments, hand.samples);
  EXPECT_NEAR(recording.mean_temperature_c, truth(0.5 * static_cast<double>(hand.samples.size())), 0.05);
  for (const Block& block : recording.blocks)  // a reading lies up to half a block, 50 samples, from its middle
    EXPECT_NEAR(block.temperature_c, truth(static_cast<double>(block.start_sample) + 0.5 * block.samples), 0.06);
  for (ImuSample& sample : hand.samples) sample.temperature_c = NAN;
  EXPECT_FALSE(compress(hand.info, hand.segments, hand.samples).info.has_temperature);
}

}  // namespace
}  // namespace turncal
