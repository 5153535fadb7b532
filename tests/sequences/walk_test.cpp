#include "sequences/walk.h"

#include "sequences/plan.h"
#include "tests/test.h"

namespace turncal {
namespace {

Walk example() {
  Walk walk;
  walk.start_deg[Axis::heading] = -90.0;
  walk.first_rest_samples = 4000;
  for (int k = 0; k < 5; ++k) {
    walk.legs.push_back({Axis::pitch, 90.0, 10.0, 2000 + k});
    walk.legs.push_back({Axis::roll, -45.0, 20.0, k == 2 ? 0 : 3000});
    walk.legs.push_back({Axis::heading, 22.5, 10.0, 400});
  }
  return walk;
}

WalkHeader walk_header() {
  WalkHeader walk_header;
  walk_header.name = "example";
  walk_header.comments = {"made for a test"};
  return walk_header;
}

TEST(Walk, TheSequenceMakesTheSameTurnsAndRests) {
  const Walk walk = example();
  const Result<Sequence> sequence = good(parse_sequence(sequence_text(walk, walk_header()), "walk.seq"));
  EXPECT_EQ(sequence->steps.size(), 2U) << "fifteen legs, eight a step";
  for (const Step& step : sequence->steps)
    for (const SequenceItem& item : step.items)
      EXPECT_FALSE(item.positioning) << "a step begins where the last one ended";
  const Walk again = walk_of(*sequence);
  EXPECT_EQ(again.start_deg, walk.start_deg);
  EXPECT_EQ(again.first_rest_samples, walk.first_rest_samples);
  ASSERT_EQ(again.legs.size(), walk.legs.size());
  for (std::size_t k = 0; k < walk.legs.size(); ++k) {
    EXPECT_EQ(again.legs[k].axis, walk.legs[k].axis) << k;
    EXPECT_DOUBLE_EQ(again.legs[k].turn_deg, walk.legs[k].turn_deg) << k;
    EXPECT_EQ(again.legs[k].rate_degps, walk.legs[k].rate_degps) << k;
    EXPECT_EQ(again.legs[k].rest_samples, walk.legs[k].rest_samples) << k;
  }
}

TEST(Walk, MovesToInitialPositionsAreTurns) {
  const Result<Sequence> sequence =
      good(parse_sequence("format = 1\nname = two\nrate_degps = 10\nacceleration_degps2 = 20\n"
                          "step 1 \"a\"\n  initial H 0 P 0 R 0\n  align 2000\n  rotate R +90\n  dwell 300\n"
                          "step 2 \"b\"\n  initial H -90 P 0 R 0\n  align 500\n  dwell 700\n",
                          "two.seq"));
  const Walk walk = walk_of(*sequence);
  ASSERT_EQ(walk.legs.size(), 3U);
  EXPECT_EQ(walk.legs[1].axis, Axis::roll);
  EXPECT_EQ(walk.legs[1].turn_deg, -90.0);
  EXPECT_EQ(walk.legs[1].rest_samples, 0);
  EXPECT_EQ(walk.legs[2].axis, Axis::heading);
  EXPECT_EQ(walk.legs[2].rest_samples, 1200);
}

TEST(Walk, OnATableThatTravelsLessItTurnsTheOtherWayOrLessFarOrNotAtAll) {
  PlanLimits limits;
  limits.axis[index(Axis::heading)] = {.soft_min_deg = -100.0, .soft_max_deg = 45.5, .max_rate_degps = 4.0};
  limits.axis[index(Axis::pitch)] = {.soft_min_deg = 300.0, .soft_max_deg = 700.0, .wrap_deg = 120.0};
  limits.axis[index(Axis::roll)] = {.soft_min_deg = 200.2, .soft_max_deg = 200.9};
  Walk walk;
  walk.start_deg[Axis::heading] = 50.0;
  walk.first_rest_samples = 2000;
  walk.legs = {{Axis::heading, 90.0, 10.0, 1000}, {Axis::heading, -360.0, 2.0, 2000}, {Axis::pitch, 90.0, 10.0, 3000},
               {Axis::pitch, 90.0, 10.0, 4000},   {Axis::pitch, -180.0, 10.0, 5000},  {Axis::roll, 90.0, 10.0, 6000}};
  const Walk fitted = on_table(walk, limits);
  EXPECT_EQ(fitted.start_deg[Axis::heading], 45.0) << "the nearest";
  EXPECT_EQ(fitted.start_deg[Axis::pitch], 360.0) << "the same pose";
  EXPECT_EQ(fitted.start_deg[Axis::roll], 200.2) << "it has no travel to speak of";
  std::vector<double> turns;
  for (const Leg& leg : fitted.legs) turns.push_back(leg.turn_deg);
  EXPECT_EQ(turns, (std::vector<double>{-90.0, 90.0, 90.0, -90.0, 120.0}));
  EXPECT_EQ(fitted.legs[0].rate_degps, 4.0);
  EXPECT_EQ(fitted.legs[1].rate_degps, 2.0);
  const Result<Sequence> sequence = good(parse_sequence(sequence_text(fitted, walk_header()), "walk.seq"));
  const Plan plan = make_plan(*sequence, limits);
  EXPECT_TRUE(plan.ok()) << plan.violations.front();
}

}  // namespace
}  // namespace turncal
