#include "turntable_drivers/table/table_state.h"

#include <array>

#include <gtest/gtest.h>

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

}  // namespace
}  // namespace turncal
