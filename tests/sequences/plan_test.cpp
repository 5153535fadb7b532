// The plan: times by hand, and every reason to refuse. Its segments: StationRun.FourteenStepsAreTheIndependentRecordingsSegments.
#include "sequences/plan.h"

#include "sequences/walk.h"
#include "tests/test.h"

namespace turncal {
namespace {

const std::string header = "format = 1\nname = test\nrate_degps = 10\nacceleration_degps2 = 20\n";

PlanLimits rig_limits() {
  PlanLimits limits;
  limits.settle_s = 0.5;
  return limits;
}

Plan planned(const std::string& steps, const PlanLimits& limits = rig_limits()) {
  const Result<Sequence> sequence = parse_sequence(header + steps, "test.seq");
  EXPECT_OK(sequence);
  return sequence.ok() ? make_plan(*sequence, limits) : Plan();
}

// 10 deg/s is reached after 0.5 s and 2.5 deg; both ends together cost 0.5 s beyond angle/rate.
TEST(MoveDuration, TrapezoidAndTriangle) {
  EXPECT_DOUBLE_EQ(move_duration_s(90.0, 10.0, 20.0), 9.5);
  EXPECT_DOUBLE_EQ(move_duration_s(-180.0, 10.0, 20.0), 18.5);
  EXPECT_DOUBLE_EQ(move_duration_s(5.0, 10.0, 20.0), 1.0);  // rate^2/acceleration: both forms give the same
  // 1.25 deg: half the way at 20 deg/s^2 takes sqrt(1.25/20) = 0.25 s. The trapezoid's formula would give 0.625 s.
  EXPECT_DOUBLE_EQ(move_duration_s(1.25, 10.0, 20.0), 0.5);
}

TEST(Plan, TimesByHand) {
  const Plan plan = planned(
      "step 1\ninitial H 0 P 0 R 0\nalign 12000\nrotate R +90\ndwell 20000\nrotate R +1.25\n"
      "step 2\ninitial H -90 P 0 R 0\nalign 400\n");
  ASSERT_TRUE(plan.ok());
  ASSERT_EQ(plan.items.size(), 7U);
  EXPECT_EQ(plan.items[0].samples, 12000);
  EXPECT_EQ(plan.items[1].start_sample, 12000);
  EXPECT_DOUBLE_EQ(plan.items[1].start_s, 60.0);
  EXPECT_EQ(plan.items[1].samples, 2000);  // 9 + 0.5 + 0.5 s
  EXPECT_DOUBLE_EQ(plan.items[1].duration_s, 10.0);
  EXPECT_EQ(plan.items[3].samples, 200);  // 0.5 + 0.5 s
  EXPECT_EQ(plan.items[4].axis, Axis::roll);
  EXPECT_EQ(plan.items[4].from_deg, 91.25);
  EXPECT_EQ(plan.items[4].to_deg, 0.0);
  EXPECT_EQ(plan.items[4].samples, 2025);  // 9.125 + 0.5 + 0.5 s
  EXPECT_EQ(plan.items[5].axis, Axis::heading);
  EXPECT_TRUE(plan.items[5].positioning);
  EXPECT_EQ(plan.items[5].step, 2);
  EXPECT_EQ(plan.items[6].step_index, 1U);
  EXPECT_EQ(plan.items[6].item_index, 2U);
  EXPECT_EQ(plan.items[6].commanded_deg, (AxisTriple{{-90.0, 0.0, 0.0}}));
  EXPECT_EQ(plan.samples, 12000 + 2000 + 20000 + 200 + 2025 + 2000 + 400);
  EXPECT_DOUBLE_EQ(plan.station_s, 38625 * 0.005);
  EXPECT_DOUBLE_EQ(plan.moving_s, 6225 * 0.005);
  EXPECT_EQ(plan.moves, 4);
  EXPECT_EQ(plan.align_dwells, 2);
  EXPECT_EQ(plan.still_dwells, 1);
  EXPECT_EQ(plan.travel_max_deg, (AxisTriple{{0.0, 0.0, 91.25}}));
  EXPECT_EQ(plan.travel_min_deg, (AxisTriple{{-90.0, 0.0, 0.0}}));
  EXPECT_EQ(plan.wrap_used_deg, (AxisTriple{{90.0, 0.0, 91.25}}));
  EXPECT_EQ(plan.turned_deg, (AxisTriple{{90.0, 0.0, 182.5}}));
}

TEST(Plan, RoundsUpToWholeSamples) {
  // 10.3 deg: 1.03 + 0.5 + 0.5 = 2.03 s, exactly 406 samples although binary arithmetic gives 406.00000000000006.
  // 10.31 deg: 2.031 s, 406.2 samples, so 407.
  const Plan plan = planned("step 1\ninitial H 0 P 0 R 0\nalign 200\nrotate R +10.3\nrotate R -10.31\ndwell 200\n");
  EXPECT_EQ(plan.items[1].samples, 406);
  EXPECT_EQ(plan.items[2].samples, 407);
}

// The example of docs/sequences.md with the times of its table.
TEST(Plan, WorkedExampleOfTheDocument) {
  const std::string text = file_text(TURNCAL_SOURCE_DIR "/docs/sequences.md");
  const std::size_t begin = text.find("format = 1\nname = example");
  ASSERT_NE(begin, std::string::npos);
  const Result<Sequence> sequence =
      good(parse_sequence(text.substr(begin, text.find("```", begin) - begin), "example"));
  const Plan plan = make_plan(*sequence, rig_limits());
  const double starts_s[] = {0.0, 60.0, 97.0, 197.0, 269.75, 279.75, 339.75, 349.75};
  ASSERT_EQ(plan.items.size(), std::size(starts_s));
  for (std::size_t i = 0; i < plan.items.size(); ++i) EXPECT_DOUBLE_EQ(plan.items[i].start_s, starts_s[i]) << i;
  EXPECT_EQ(plan.samples, 89950);
  EXPECT_EQ(plan.wrap_used_deg, (AxisTriple{{90.0, 0.0, 360.0}}));
}

const std::string turning = "step 1\ninitial H 0 P 0 R 0\nalign 200\nrotate R +360\ndwell 200\nrotate R -540 rate 20\n";

TEST(Plan, EveryLimitNamesTheLineThatBreaksIt) {
  using Change = std::function<void(AxisLimits & roll, PlanLimits & all)>;
  const std::string far = "step 1\ninitial H 600 P 0 R 0\nalign 200\ndwell 200\n",
                    brief = "step 1\ninitial H 0 P 0 R 0\nalign 400\ndwell 399\n";
  const struct {
    const char* what;
    Change change;
    std::string steps;
    std::vector<std::string> expected;  // behind the name of the file
  } cases[] = {{"soft travel",
                [](AxisLimits& roll, PlanLimits&) { roll.soft_min_deg = -170.0, roll.soft_max_deg = 350.0; },
                turning,
                {"8: step 1: roll goes to 360 deg, soft travel is -170 to 350 deg",
                 "10: step 1: roll goes to -180 deg, soft travel is -170 to 350 deg"}},
               {"all of it",
                [](AxisLimits& roll, PlanLimits&) { roll.soft_min_deg = -180.0, roll.soft_max_deg = 360.0; },
                turning,
                {}},
               {"where it starts",
                [](auto&, auto&) {},
                far,
                {"5: step 1: heading goes to 600 deg, soft travel is -540 to 540 deg"}},
               {"rate and acceleration",
                [](AxisLimits& roll, PlanLimits&) { roll.max_rate_degps = 15.0, roll.max_acceleration_degps2 = 19.0; },
                turning,
                {"8: step 1: roll accelerates with 20 deg/s^2, the most allowed is 19 deg/s^2 (and 1 more)",
                 "10: step 1: roll turns at 20 deg/s, the most allowed is 15 deg/s"}},
               {"the most of both",
                [](AxisLimits& roll, PlanLimits&) { roll.max_rate_degps = roll.max_acceleration_degps2 = 20.0; },
                turning,
                {}},
               {"cable",
                [](AxisLimits& roll, PlanLimits&) { roll.wrap_deg = 500.0; },
                turning,
                {"10: step 1: roll has wound its cable by 540 deg, the most allowed is 500 deg"}},
               {"all of the cable", [](AxisLimits& roll, PlanLimits&) { roll.wrap_deg = 540.0; }, turning, {}},
               {"slip rings", [](AxisLimits& roll, PlanLimits&) { roll.wrap_deg = 0.0; }, turning, {}},
               {"of other axes",
                [](AxisLimits&, PlanLimits& all) {
                  all.axis[0] = all.axis[1] = {-1.0, 1.0, 1.0, 1.0, 1.0};
                },
                turning,
                {}},
               {"a dwell of less than a second",
                [](AxisLimits&, PlanLimits& all) { all.sample_period_s = 0.0025; },
                brief,
                {"8: step 1: a dwell of 399 samples takes 0.9975 s, the shortest that counts is 1 s"}}};
  for (const auto& c : cases) {
    PlanLimits limits = rig_limits();
    c.change(limits.axis[2], limits);
    std::vector<std::string> said;
    for (const std::string& violation : planned(c.steps, limits).violations)
      said.push_back(replaced(violation, "test.seq:", ""));
    EXPECT_EQ(said, c.expected) << c.what;
  }
}

// ---- walk ----

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

WalkHeader walk_header() { return {.name = "example", .comments = {"made for a test"}}; }

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
