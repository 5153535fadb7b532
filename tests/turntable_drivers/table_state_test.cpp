#include "turntable_drivers/table/table_state.h"

#include "tests/test.h"
#include "turntable_drivers/table/described_turntable.h"

namespace turncal {
namespace {

AxisStatus at_rest() {
  AxisStatus axis;
  axis.moving = false;
  axis.enabled = axis.homed = axis.remote = axis.in_position = true;
  return axis;
}

TEST(TableState, OfAnAxis) {
  EXPECT_EQ(state_of(AxisStatus()), TableState::not_ready) << "what is unknown";
  AxisStatus axis = at_rest();
  EXPECT_EQ(state_of(axis), TableState::idle);
  axis.in_position = false;
  EXPECT_EQ(state_of(axis), TableState::settling);
  axis.moving = true;
  EXPECT_EQ(state_of(axis), TableState::moving);
  EXPECT_EQ(state_of(axis, true), TableState::stopping);
  axis.homed = false;
  EXPECT_EQ(state_of(axis), TableState::not_ready) << "homing";
  EXPECT_EQ(state_of(axis, true), TableState::stopping) << "a homing that is being stopped";
  axis.limit = true;
  EXPECT_EQ(state_of(axis, true), TableState::fault);
  axis.emergency_stop = true;
  EXPECT_EQ(state_of(axis), TableState::emergency_stop);
  for (bool AxisStatus::*needed : {&AxisStatus::enabled, &AxisStatus::homed, &AxisStatus::remote}) {
    AxisStatus without = at_rest();
    without.*needed = false;
    EXPECT_EQ(state_of(without), TableState::not_ready);
  }
}

TEST(TableState, OfATableIsThatOfItsWorstAxis) {
  std::array<AxisStatus, 3> axes{at_rest(), at_rest(), at_rest()};
  EXPECT_EQ(state_of(axes), TableState::idle);
  axes[1].moving = true;
  EXPECT_EQ(state_of(axes), TableState::moving);
  axes[2].fault = true;
  EXPECT_EQ(state_of(axes), TableState::fault);
  EXPECT_STREQ(to_string(state_of(axes)), "FAULT");
}

// ---- what is remembered of an axis ----

// An axis that was read at this angle and then told to look for its zero.
AxisMemory homing_from(double angle_deg, bool searches = true) {
  AxisMemory axis;
  axis.note(angle_deg, 0.0);
  axis.homing_began(searches);
  return axis;
}

// A drive that has not begun yet still shows the flag of the session before.
TEST(AxisMemory, AHomedFlagThatNothingChangesIsTheOldOne) {
  AxisMemory axis = homing_from(50.0);
  for (int i = 0; i < 100; ++i) {
    axis.note(50.0, 1.0 + i);
    EXPECT_FALSE(axis.judge_homed(true, false)) << "reading " << i;
  }
  EXPECT_FALSE(axis.judge_homed(true, true)) << "it turns";
  axis.note(0.0, 110.0);
  EXPECT_TRUE(axis.judge_homed(true, false));
  EXPECT_TRUE(axis.judge_homed(true, true)) << "a move, later";
}

TEST(AxisMemory, AHomingIsSeenByItsFlagAndByItsAngle) {
  AxisMemory by_flag = homing_from(50.0);
  EXPECT_FALSE(by_flag.judge_homed(false, false));
  EXPECT_TRUE(by_flag.judge_homed(true, false)) << "wherever its zero is";
  AxisMemory by_angle = homing_from(50.0);
  by_angle.note(-120.0, 1.0);
  EXPECT_TRUE(by_angle.judge_homed(true, false)) << "nobody looked while it turned";
}

TEST(AxisMemory, AnAxisAtItsZeroIsBelievedFromTheThirdReadingOn) {
  AxisMemory axis = homing_from(0.3);
  EXPECT_FALSE(axis.judge_homed(true, false));
  EXPECT_FALSE(axis.judge_homed(true, false));
  EXPECT_TRUE(axis.judge_homed(true, false));
  EXPECT_TRUE(axis.judge_homed(true, true)) << "a move, later";
}

TEST(AxisMemory, AnEncoderThatKnowsItsAngleNeedNotTurn) {
  AxisMemory axis = homing_from(50.0, false);
  EXPECT_TRUE(axis.judge_homed(true, false));
}

}  // namespace
}  // namespace turncal
