// The arrival rule against axes that lie, one clause at a time.
#include "orchestrator/run/motion_watch.h"
#include "tests/test.h"

namespace turncal {
namespace {

constexpr Move to_90 = {Axis::pitch, 90.0, 10.0, 20.0};

MotionConfig arrival_config() {
  MotionConfig c;
  c.settle_s = 1.0;
  return c;
}

// Every axis at rest at zero but pitch as given.
TableStatus with_pitch(double position_deg, double rate_degps, bool moving, bool in_position) {
  TableStatus status{};
  for (AxisStatus& axis : status) {
    axis.moving = false;
    axis.in_position = true;
  }
  AxisStatus& pitch = status[static_cast<std::size_t>(Axis::pitch)];
  pitch.position_deg = position_deg;
  pitch.rate_degps = rate_degps;
  pitch.moving = moving;
  pitch.in_position = in_position;
  return status;
}

const TableStatus at_target = with_pitch(90.0, 0.0, false, true);
const TableStatus under_way = with_pitch(40.0, 10.0, true, false);

struct Started : ArrivalMonitor {
  Started() : ArrivalMonitor(arrival_config()) {
    start_move(to_90, 0.0, 0.0);
    EXPECT_EQ(update(under_way, 4.0), std::nullopt);
  }
};

TEST(ArrivalMonitor, ArrivesThenSettlesAfterTheSettleTime) {
  Started monitor;
  EXPECT_EQ(monitor.update(at_target, 9.5), RunEvent::arrived);
  EXPECT_EQ(monitor.update(at_target, 10.4), std::nullopt);
  EXPECT_EQ(monitor.update(at_target, 10.5), RunEvent::settled);
}

TEST(ArrivalMonitor, EveryClauseIsNeeded) {
  const TableStatus nearly[] = {
      with_pitch(90.0, 0.0, false, false),    // not in position
      with_pitch(90.0, 0.0, true, true),      // still says moving
      with_pitch(90.011, 0.0, false, true),   // outside 0.01 deg
      with_pitch(89.989, 0.0, false, true),   //
      with_pitch(450.0, 0.0, false, true),    // a turn too far is not here: positions are cumulative
      with_pitch(90.0, 0.011, false, true),   // still turning
      with_pitch(90.0, -0.011, false, true),  //
      with_pitch(std::numeric_limits<double>::quiet_NaN(), 0.0, false, true),  // unknown is not arrived
      with_pitch(90.0, std::numeric_limits<double>::quiet_NaN(), false, true),
  };
  for (const TableStatus& status : nearly) {
    Started monitor;
    EXPECT_EQ(monitor.update(status, 5.0), std::nullopt) << status[1].position_deg << ' ' << status[1].rate_degps;
  }
  // Another axis moves.
  Started monitor;
  TableStatus other = at_target;
  other[0].moving = true;
  EXPECT_EQ(monitor.update(other, 5.0), std::nullopt);
}

TEST(ArrivalMonitor, StaleDoneBeforeTheMotionIsNotBelieved) {
  // A move of 0.005 deg: within tolerance from the start, so motion can never be seen; the three-poll guard decides.
  ArrivalMonitor monitor(arrival_config());
  monitor.start_move({Axis::pitch, 0.005, 10.0, 20.0}, 0.0, 0.0);
  const TableStatus still = with_pitch(0.0, 0.0, false, true);
  EXPECT_EQ(monitor.update(still, 0.1), std::nullopt);
  EXPECT_EQ(monitor.update(still, 0.2), std::nullopt);
  EXPECT_EQ(monitor.update(still, 0.3), RunEvent::arrived);
}

TEST(ArrivalMonitor, FlickerBeginsTheSettleTimeAnew) {
  Started monitor;
  EXPECT_EQ(monitor.update(at_target, 9.5), RunEvent::arrived);
  EXPECT_EQ(monitor.update(with_pitch(90.0, 0.0, false, false), 10.0), RunEvent::unsettled);
  EXPECT_EQ(monitor.update(at_target, 10.1), RunEvent::arrived);
  EXPECT_EQ(monitor.update(at_target, 10.6), std::nullopt);
  EXPECT_EQ(monitor.update(at_target, 11.1), RunEvent::settled);
}

TEST(ArrivalMonitor, StallIsTwoSecondsWithoutComingNearer) {
  ArrivalMonitor monitor(arrival_config());
  monitor.start_move(to_90, 0.0, 0.0);
  EXPECT_EQ(monitor.update(with_pitch(40.0, 10.0, true, false), 4.0), std::nullopt);
  EXPECT_EQ(monitor.update(with_pitch(40.0, 10.0, true, false), 5.9), std::nullopt);
  EXPECT_EQ(monitor.update(with_pitch(40.0, 10.0, true, false), 6.0), RunEvent::stall);
  // Moving away is no progress either.
  monitor.start_move(to_90, 0.0, 0.0);
  EXPECT_EQ(monitor.update(with_pitch(-1.0, -10.0, true, false), 1.0), std::nullopt);
  EXPECT_EQ(monitor.update(with_pitch(-9.0, -10.0, true, false), 2.0), RunEvent::stall);
}

TEST(ArrivalMonitor, SlowMoveIsNoStall) {
  ArrivalMonitor monitor(arrival_config());
  monitor.start_move({Axis::pitch, 1.0, 0.01, 1.0}, 0.0, 0.0);
  for (int i = 1; i < 1000; ++i)
    ASSERT_EQ(monitor.update(with_pitch(0.001 * i, 0.01, true, false), 0.1 * i), std::nullopt) << i;
}

TEST(ArrivalMonitor, DeadlineIsThatOfTheDesign) {
  // 90/10 + 2 * 10/20 + 10 = 20 s
  Started monitor;
  EXPECT_NEAR(monitor.allowed_s(), 20.0, 1e-12);
  const TableStatus never = with_pitch(90.0, 0.0, false, false);
  EXPECT_EQ(monitor.update(never, 19.9), std::nullopt);
  EXPECT_EQ(monitor.update(never, 20.1), RunEvent::deadline);
}

TEST(ArrivalMonitor, PollsAreWorthMostAtTheEndOfTheMotion) {
  ArrivalMonitor monitor(arrival_config());
  monitor.start_move(to_90, 0.0, 100.0);
  EXPECT_NEAR(monitor.moment_of_interest_s(100.0), 109.5, 1e-12);
  EXPECT_EQ(monitor.update(under_way, 104.0), std::nullopt);
  EXPECT_EQ(monitor.update(at_target, 109.5), RunEvent::arrived);
  EXPECT_NEAR(monitor.moment_of_interest_s(109.5), 110.5, 1e-12);
}

TEST(ArrivalMonitor, SettlingWithoutAMoveWantsRestOnly) {
  ArrivalMonitor monitor(arrival_config());
  monitor.settle_only(0.0);
  EXPECT_EQ(monitor.update(with_pitch(12.0, 0.0, false, false), 0.5), std::nullopt);
  EXPECT_EQ(monitor.update(with_pitch(12.5, 1.0, true, false), 0.9), std::nullopt);
  EXPECT_EQ(monitor.update(with_pitch(13.0, 0.0, false, false), 1.5), std::nullopt);
  EXPECT_EQ(monitor.update(with_pitch(13.0, 0.0, false, false), 1.9), RunEvent::settled);
  monitor.settle_only(0.0);
  EXPECT_EQ(monitor.update(with_pitch(12.5, 1.0, true, false), 11.1), RunEvent::deadline);
}

}  // namespace
}  // namespace turncal
