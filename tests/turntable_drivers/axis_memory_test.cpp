#include "turntable_drivers/table/described_turntable.h"

#include <gtest/gtest.h>

namespace turncal {
namespace {

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
