#include "calib/statistics/segmentation.h"

#include "tests/calib/hand_rotations.h"
#include "tests/test.h"

namespace turncal {
namespace {

TEST(Segmentation, FindsEveryRestOfASyntheticRun) {
  const HandData hand = make_hand_data({});
  const Segmentation found = find_rests(hand.info, hand.samples);
  const Agreement a = compare_rests(found.segments, hand.segments, hand.info.sample_period_s);
  EXPECT_EQ(a.rests_a, 20);
  EXPECT_EQ(a.matched, 20);
  EXPECT_GT(a.common_s, 0.85 * 120.0);
  EXPECT_LT(a.only_a_s, 20 * 2 * 0.25);  // a smooth start of a turn is below the noise for a quarter of a second
  EXPECT_FALSE(found.reason.empty());
  EXPECT_GT(found.threshold, found.plateau_begin);
  EXPECT_LT(found.threshold, found.plateau_end);
  // Contiguous over all samples.
  EXPECT_EQ(found.segments.front().start_sample, 0);
  EXPECT_EQ(found.segments.back().end_sample, std::int64_t(hand.samples.size()));
  for (std::size_t k = 1; k < found.segments.size(); ++k)
    EXPECT_EQ(found.segments[k].start_sample, found.segments[k - 1].end_sample);
  EXPECT_TRUE(without_table_angles(found.segments));
}

TEST(Segmentation, ChunksMakeNoDifference) {
  const HandData hand = make_hand_data({.rests = 6});
  const Segmentation whole = find_rests(hand.info, hand.samples);
  RestFinder finder(hand.info);
  for (std::size_t at = 0; at < hand.samples.size(); at += 77)
    finder.add(std::span(hand.samples).subspan(at, std::min<std::size_t>(77, hand.samples.size() - at)));
  const Segmentation parts = finder.finish();
  ASSERT_EQ(parts.segments.size(), whole.segments.size());
  for (std::size_t k = 0; k < parts.segments.size(); ++k)
    EXPECT_EQ(parts.segments[k].end_sample, whole.segments[k].end_sample);
  EXPECT_EQ(parts.threshold, whole.threshold);
}

TEST(Segmentation, AnEvenSlowTurnIsNoRest) {
  HandData hand = make_hand_data({});
  const Segment& rest = hand.segments[8];
  ASSERT_EQ(rest.kind, SegmentKind::still);
  for (std::int64_t k = rest.start_sample; k < rest.end_sample; ++k)
    hand.samples[k].gyro[1] += 0.05 * hand.info.sample_period_s;
  const Segmentation found = find_rests(hand.info, hand.samples);
  EXPECT_EQ(found.slow_turns, 1);
  EXPECT_EQ(compare_rests(found.segments, hand.segments, hand.info.sample_period_s).rests_a, 19);
}

TEST(Segmentation, AUnitThatSwingsNeverRests) {
  HandData hand = make_hand_data({.rests = 2});
  hand.samples.resize(6000);
  for (std::size_t k = 0; k < hand.samples.size(); ++k) {
    const double t = double(k) * 0.01;
    hand.samples[k].counter = std::int64_t(k);
    const double noise = 1e-5 * std::sin(1e4 * t * t);
    hand.samples[k].gyro = {0.01 * std::sin(3.0 * t) + noise, 0.008 * std::cos(2.1 * t) - noise, 0.005 * std::sin(t)};
    hand.samples[k].accel = {0.0981 * std::sin(std::cos(3.0 * t)), 0.0981 * std::cos(std::cos(3.0 * t)), noise};
  }
  const Segmentation found = find_rests(hand.info, hand.samples);
  EXPECT_TRUE(found.segments.empty());
  EXPECT_SAYS(found.reason, "never rests");
}

// Small motions at all levels: the longest stretch of thresholds lies at 10^4 times the noise, where rests hold motion.
TEST(Segmentation, ThresholdsStayNearTheNoise) {
  HandData hand = make_hand_data({.gyro_noise_radps = 0.0002, .accel_noise_mps2 = 0.002, .seed = 6});
  // Every rest is interrupted by a wobble, each of another size up to 100 times the noise.
  int rest = 0;
  for (const Segment& s : hand.segments) {
    if (s.kind == SegmentKind::rotate) continue;
    const double size = 0.0002 * std::pow(100.0, (rest++ % 20) / 19.0) * 3.0;
    for (std::int64_t k = s.start_sample + 250; k < s.start_sample + 350; ++k)
      hand.samples[k].gyro[0] += size * std::sin(0.0628 * double(k - s.start_sample - 250)) * 0.01;
  }
  const Segmentation found = find_rests(hand.info, hand.samples);
  EXPECT_LT(found.threshold, 3.2 * segmentation_limits.most_tremor);
  SegmentationOptions given;
  given.threshold = 50.0;
  EXPECT_EQ(find_rests(hand.info, hand.samples, given).threshold, 50.0);
  EXPECT_EQ(find_rests(hand.info, hand.samples, given).reason, "given");
}

TEST(Segmentation, TooShortOrNothingAtRest) {
  const HandData hand = make_hand_data({.rests = 2, .rest_s = 0.2, .turn_s = 0.2});
  EXPECT_TRUE(find_rests(hand.info, hand.samples).segments.empty());
}

}  // namespace
}  // namespace turncal
