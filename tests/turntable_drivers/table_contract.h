// What every table driver must do, as one set of tests that each driver's test file runs on its own table:
//
//   struct MyFactory {
//     Turntable& table();                       // fresh, not connected
//     void pass(double seconds);                // lets time pass for the table
//     static constexpr double tolerance_deg;    // of positions read back
//     static constexpr double beyond_limits_deg;  // a heading that the table refuses; 0: it has no limits
//     static constexpr bool silent_on_the_way;  // optional, true: position and rate are not known during a motion (by hand)
//   };
//   INSTANTIATE_TYPED_TEST_SUITE_P(Mine, TableContract, MyFactory);
//
// Rules: turntable_drivers/table/turntable.h. Nothing here looks at in_position alone: a device may lie.
#pragma once

#include "tests/test.h"
#include "turntable_drivers/table/turntable.h"

namespace turncal {

template <class Factory>
constexpr bool silent_on_the_way = requires {
  requires Factory::silent_on_the_way;
};

template <class Factory>
class TableContract : public testing::Test {
 protected:
  Turntable& table() { return factory_.table(); }
  AxisStatus status(Axis axis) { return expect_value(table().status(axis)); }
  double position(Axis axis) { return status(axis).position_deg; }

  // Polls every 100 ms, at most `seconds`.
  bool wait_for(const std::function<bool()>& condition, double seconds) {
    for (double waited = 0.0; waited <= seconds; waited += 0.1) {
      if (condition()) return true;
      factory_.pass(0.1);
    }
    return false;
  }
  // Time passes as it does at a station: with a look at the table every 100 ms, which feeds a drive's watchdog.
  void hold(double seconds) {
    wait_for([this] { return status(Axis::heading).time_s < 0.0; }, seconds);
  }
  // Waits until an axis sent to 90 deg is well on its way there.
  bool on_the_way(Axis axis) {
    if (silent_on_the_way<Factory>) {
      hold(2.0);
      return status(axis).moving;
    }
    return wait_for([&] { return position(axis) > 20.0; }, 20.0);
  }
  bool all(bool (*is)(const AxisStatus&)) {
    return std::ranges::all_of(all_axes, [&](Axis axis) { return is(status(axis)); });
  }
  bool all_stand() {
    return all([](const AxisStatus& now) { return !now.moving; });
  }
  bool stands_at(Axis axis, double target_deg) {
    const AxisStatus now = status(axis);
    return !now.moving && now.in_position && std::abs(now.position_deg - target_deg) <= Factory::tolerance_deg;
  }
  void make_ready() {
    ASSERT_TRUE(table().connect().ok());
    ASSERT_TRUE(table().enable().ok());
    ASSERT_TRUE(table().home().ok());
    const auto is_ready = [](const AxisStatus& now) { return now.homed && !now.moving; };
    ASSERT_TRUE(wait_for([&] { return all(is_ready); }, 120.0));
  }
  void expect_refused(const Status& status, const char* what) {
    EXPECT_FALSE(status.ok()) << what;
    if (!status.ok()) {
      EXPECT_FALSE(status.error().message.empty()) << what;
      EXPECT_SAYS_NOT(status.error().message, "\n") << what;
    }
  }

  Factory factory_;
};

TYPED_TEST_SUITE_P(TableContract);

TYPED_TEST_P(TableContract, NothingWorksBeforeConnect) {
  this->expect_refused(this->table().move_absolute(Axis::pitch, 10.0, 10.0, 10.0), "move");
  this->expect_refused(this->table().enable(), "enable");
  this->expect_refused(this->table().home(), "home");
  EXPECT_FALSE(this->table().status(Axis::pitch).ok());
  EXPECT_FALSE(this->table().identify().ok());
}

TYPED_TEST_P(TableContract, ConnectIsNotEnableAndNotHome) {
  ASSERT_TRUE(this->table().connect().ok());
  EXPECT_TRUE(this->table().identify().ok());
  EXPECT_FALSE(this->status(Axis::roll).enabled);
  this->expect_refused(this->table().move_absolute(Axis::roll, 10.0, 10.0, 10.0), "move before enable");
  ASSERT_TRUE(this->table().enable().ok());
  EXPECT_TRUE(this->wait_for([&] { return this->status(Axis::roll).enabled; }, 5.0));
  EXPECT_FALSE(this->status(Axis::roll).homed);
  this->expect_refused(this->table().move_absolute(Axis::roll, 10.0, 10.0, 10.0), "move before home");
}

TYPED_TEST_P(TableContract, MoveIsSeenAndArrives) {
  this->make_ready();
  for (Axis axis : all_axes) {
    ASSERT_TRUE(this->table().move_absolute(axis, 30.0, 10.0, 10.0).ok());
    bool seen_moving = false, seen_rate = false;
    ASSERT_TRUE(this->wait_for(
        [&] {
          const AxisStatus now = this->status(axis);
          seen_moving = seen_moving || now.moving;
          seen_rate = seen_rate || now.rate_degps > 5.0;
          return this->stands_at(axis, 30.0) && seen_moving;
        },
        20.0))
        << to_string(axis);
    EXPECT_TRUE(seen_rate || silent_on_the_way<TypeParam>) << to_string(axis);
    // A table that tells no rate has it from two positions: one interval later.
    EXPECT_TRUE(this->wait_for([&] { return std::abs(this->status(axis).rate_degps) <= 0.01; }, 0.2))
        << to_string(axis);
    for (Axis other : all_axes) {
      const bool has_moved = int(other) <= int(axis);
      EXPECT_NEAR(this->position(other), has_moved ? 30.0 : 0.0, TypeParam::tolerance_deg) << to_string(other);
    }
  }
}

TYPED_TEST_P(TableContract, PositionsAreCumulative) {
  this->make_ready();
  ASSERT_TRUE(this->table().move_absolute(Axis::roll, 360.0, 40.0, 40.0).ok());
  EXPECT_TRUE(this->wait_for([&] { return this->stands_at(Axis::roll, 360.0); }, 30.0));
  ASSERT_TRUE(this->table().move_absolute(Axis::roll, -90.0, 40.0, 40.0).ok());
  EXPECT_TRUE(this->wait_for([&] { return this->stands_at(Axis::roll, -90.0); }, 30.0));
}

TYPED_TEST_P(TableContract, BadArgumentsAreRefusedAndNothingMoves) {
  this->make_ready();
  const double nan = std::numeric_limits<double>::quiet_NaN(), inf = std::numeric_limits<double>::infinity();
  const double bad[][3] = {{nan, 10, 10}, {inf, 10, 10}, {10, nan, 10}, {10, 0, 10},  {10, -5, 10},
                           {10, inf, 10}, {10, 10, nan}, {10, 10, 0},   {10, 10, -1}, {10, 10, inf}};
  for (const auto& b : bad)
    this->expect_refused(this->table().move_absolute(Axis::heading, b[0], b[1], b[2]), "bad argument");
  if (TypeParam::beyond_limits_deg != 0.0)
    this->expect_refused(this->table().move_absolute(Axis::heading, TypeParam::beyond_limits_deg, 10.0, 10.0), "limit");
  this->factory_.pass(2.0);
  EXPECT_TRUE(this->all_stand());
  EXPECT_NEAR(this->position(Axis::heading), 0.0, TypeParam::tolerance_deg);
}

TYPED_TEST_P(TableContract, StopEndsEveryMotionShortOfTheTarget) {
  this->make_ready();
  for (Axis axis : all_axes) ASSERT_TRUE(this->table().move_absolute(axis, 90.0, 10.0, 10.0).ok());
  ASSERT_TRUE(this->on_the_way(Axis::roll));
  ASSERT_TRUE(this->table().stop_all().ok());
  ASSERT_TRUE(this->wait_for([&] { return this->all_stand(); }, 5.0));
  AxisTriple stopped;
  for (Axis axis : all_axes) {
    const double stopped_deg = stopped[axis] = this->position(axis);
    if (!silent_on_the_way<TypeParam>) {
      EXPECT_GT(stopped_deg, 20.0 - 5.0);
    }
    EXPECT_LT(stopped_deg, 45.0);
    EXPECT_FALSE(this->stands_at(axis, 90.0));
    this->hold(3.0);
    EXPECT_NEAR(this->position(axis), stopped_deg, TypeParam::tolerance_deg) << "it holds";
  }
  // And goes on when told so, with no other that would go on to the target that was given up.
  ASSERT_TRUE(this->table().move_absolute(Axis::roll, 90.0, 10.0, 10.0).ok());
  EXPECT_TRUE(this->wait_for([&] { return this->stands_at(Axis::roll, 90.0); }, 20.0));
  for (Axis other : {Axis::heading, Axis::pitch})
    EXPECT_NEAR(this->position(other), stopped[other], TypeParam::tolerance_deg) << to_string(other);
}

TYPED_TEST_P(TableContract, AbortEndsEveryMotionAndNeedsEnable) {
  this->make_ready();
  for (Axis axis : all_axes) ASSERT_TRUE(this->table().move_absolute(axis, 90.0, 10.0, 10.0).ok());
  ASSERT_TRUE(this->on_the_way(Axis::pitch));
  ASSERT_TRUE(this->table().abort_all().ok());
  ASSERT_TRUE(this->wait_for([&] { return this->all_stand(); }, 5.0));
  for (Axis axis : all_axes) {
    EXPECT_FALSE(this->stands_at(axis, 90.0));
    EXPECT_FALSE(this->status(axis).in_position && this->status(axis).enabled);
  }
  this->expect_refused(this->table().move_absolute(Axis::pitch, 0.0, 10.0, 10.0), "move after abort");
}

TYPED_TEST_P(TableContract, StatusHasTimeThatNeverGoesBack) {
  this->make_ready();
  double last_s = this->status(Axis::heading).time_s;
  for (int i = 0; i < 20; ++i) {
    this->factory_.pass(0.05);
    const double now_s = this->status(Axis::heading).time_s;
    EXPECT_GE(now_s, last_s);
    last_s = now_s;
  }
}

REGISTER_TYPED_TEST_SUITE_P(TableContract, NothingWorksBeforeConnect, ConnectIsNotEnableAndNotHome,
                            MoveIsSeenAndArrives, PositionsAreCumulative, BadArgumentsAreRefusedAndNothingMoves,
                            StopEndsEveryMotionShortOfTheTarget, AbortEndsEveryMotionAndNeedsEnable,
                            StatusHasTimeThatNeverGoesBack);

}  // namespace turncal
