#include "calib/statistics/segmentation.h"

#include "tests/calib/hand_rotations.h"
#include "tests/calib/rest_agreement.h"
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

TEST(Segmentation, TooShortOrNothingAtRest) {
  const HandData hand = make_hand_data({.rests = 2, .rest_s = 0.2, .turn_s = 0.2});
  EXPECT_TRUE(find_rests(hand.info, hand.samples).segments.empty());
}

}  // namespace
}  // namespace turncal
