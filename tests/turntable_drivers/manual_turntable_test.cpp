// The table turned by hand, with an operator made of a pipe: the contract, and every way of answering.
#include "turntable_drivers/manual_turntable.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <sstream>

#include <gtest/gtest.h>

#include "tests/turntable_drivers/table_contract.h"

namespace turncal {
namespace {

struct HandClock : Clock {
  double time_s = 0.0;
  double now_s() const override { return time_s; }
  double utc_s() const override { return time_s; }
};

struct Desk {
  explicit Desk(ManualSettings settings = {}, GravitySense sense = {}) : manual(make(settings, std::move(sense))) {}
  ~Desk() {
    ::close(pipe_[0]);
    hang_up();
  }
  void type(const std::string& line) { EXPECT_EQ(::write(pipe_[1], (line + "\n").data(), line.size() + 1), static_cast<ssize_t>(line.size() + 1)); }
  void hang_up() {
    if (pipe_[1] >= 0) ::close(pipe_[1]);
    pipe_[1] = -1;
  }
  std::string said() {
    const std::string text = out.str();
    out.str("");
    return text;
  }
  int pipe_[2] = {-1, -1};
  HandClock clock;
  std::ostringstream out;
  ManualTurntable manual;

 private:
  ManualTurntable make(ManualSettings settings, GravitySense sense) {
    EXPECT_EQ(::pipe(pipe_), 0);
    return ManualTurntable(settings, clock, pipe_[0], out, std::move(sense));
  }
};

// Turns at 20 deg/s and types what it is asked for when it is there.
struct ManualFactory {
  Desk desk;
  std::array<double, 3> hand_deg{};
  Turntable& table() { return desk.manual; }
  void pass(double seconds) {
    desk.clock.time_s += seconds;
    const auto wanted = desk.manual.wanted();
    if (!wanted) return;
    double& hand = hand_deg[static_cast<std::size_t>(wanted->axis)];
    const double way_deg = wanted->target_deg - hand;
    hand += std::clamp(way_deg, -20.0 * seconds, 20.0 * seconds);
    if (std::abs(wanted->target_deg - hand) < 1e-9) desk.type(std::to_string(wanted->target_deg));
  }
  static constexpr double tolerance_deg = 1e-3;
  static constexpr double beyond_limits_deg = 0.0;
  static constexpr bool must_home = true, must_enable = true, silent_on_the_way = true;
};
INSTANTIATE_TYPED_TEST_SUITE_P(Manual, TableContract, ManualFactory);

struct ManualTable : testing::Test {
  void ready(Desk& desk) {
    ASSERT_TRUE(desk.manual.connect().ok());
    ASSERT_TRUE(desk.manual.enable().ok());
    ASSERT_TRUE(desk.manual.home().ok());
    for (int i = 0; i < 3; ++i) desk.type("0");
    for (const Axis axis : all_axes) ASSERT_TRUE(desk.manual.status(axis)->homed);
    desk.said();
  }
};

TEST_F(ManualTable, SaysAxisAngleWayAndReason) {
  Desk desk;
  ready(desk);
  desk.manual.set_reason("step 3 of 14");
  ASSERT_TRUE(desk.manual.move_absolute(Axis::pitch, -90.0, 10.0, 10.0).ok());
  EXPECT_NE(desk.said().find("Turn pitch to -90 deg (-90 deg from where it is), for step 3 of 14."), std::string::npos);
  EXPECT_TRUE(desk.manual.status(Axis::pitch)->moving);
  EXPECT_FALSE(desk.manual.status(Axis::pitch)->in_position);
  desk.type("-89.95");
  EXPECT_NEAR(desk.manual.status(Axis::pitch)->position_deg, -89.95, 1e-12) << "the angle reached, not the one wanted";
  EXPECT_TRUE(desk.manual.needs_operator());
}

TEST_F(ManualTable, RefusesBeyondToleranceAndNonsense) {
  Desk desk;
  ready(desk);
  ASSERT_TRUE(desk.manual.move_absolute(Axis::roll, 90.0, 10.0, 10.0).ok());
  for (const char* const bad : {"89.89", "90.11", "-90", "0", "nan", "ninety", "90 deg", "9 0", "1e999", "90.0.0"}) {
    desk.said();
    desk.type(bad);
    EXPECT_TRUE(desk.manual.status(Axis::roll)->moving) << bad;
    EXPECT_FALSE(desk.said().empty()) << bad;
  }
  desk.type("");
  EXPECT_TRUE(desk.manual.status(Axis::roll)->moving) << "an empty line is no answer";
  desk.type("90.1");
  EXPECT_FALSE(desk.manual.status(Axis::roll)->moving);
  // A dial knows only a circle.
  ASSERT_TRUE(desk.manual.move_absolute(Axis::roll, 450.0, 10.0, 10.0).ok());
  desk.type("89.9");
  EXPECT_NEAR(desk.manual.status(Axis::roll)->position_deg, 449.9, 1e-9);
}

TEST_F(ManualTable, TimeOutPausesAndAssumesNothing) {
  Desk desk;
  ready(desk);
  ASSERT_TRUE(desk.manual.move_absolute(Axis::roll, 90.0, 10.0, 10.0).ok());
  desk.clock.time_s += 601.0;
  EXPECT_TRUE(desk.manual.status(Axis::roll)->moving);
  EXPECT_TRUE(desk.manual.paused());
  EXPECT_NE(desk.said().find("paused"), std::string::npos);
  desk.type("90");
  EXPECT_TRUE(desk.manual.status(Axis::roll)->moving) << "continue comes first";
  desk.type("continue");
  EXPECT_TRUE(desk.manual.status(Axis::roll)->moving);
  EXPECT_NE(desk.said().find("Turn roll to 90"), std::string::npos);
  desk.type("90");
  EXPECT_FALSE(desk.manual.status(Axis::roll)->moving);
}

TEST_F(ManualTable, RepeatPauseSkipAbort) {
  Desk desk;
  ready(desk);
  ASSERT_TRUE(desk.manual.move_absolute(Axis::roll, 90.0, 10.0, 10.0).ok());
  desk.said();
  desk.type("repeat");
  EXPECT_TRUE(desk.manual.status(Axis::roll)->moving);
  EXPECT_NE(desk.said().find("Turn roll to 90"), std::string::npos);
  desk.type("p");
  EXPECT_EQ(desk.manual.status(Axis::roll)->text, "paused");
  desk.type("c");
  desk.type("skip");
  EXPECT_FALSE(desk.manual.status(Axis::roll)->fault) << "not without a reason";
  desk.type("skip the roll axis is jammed");
  const AxisStatus skipped = *desk.manual.status(Axis::roll);
  EXPECT_TRUE(skipped.fault);
  EXPECT_FALSE(skipped.in_position);
  EXPECT_EQ(skipped.text, "skipped by the operator: the roll axis is jammed");
  EXPECT_FALSE(desk.manual.move_absolute(Axis::pitch, 1.0, 10.0, 10.0).ok());
  ASSERT_TRUE(desk.manual.clear_fault().ok());
  ASSERT_TRUE(desk.manual.move_absolute(Axis::pitch, 1.0, 10.0, 10.0).ok());
  desk.type("abort");
  const Result<AxisStatus> aborted = desk.manual.status(Axis::roll);
  ASSERT_FALSE(aborted.ok());
  EXPECT_EQ(aborted.error().kind, ErrorKind::aborted);
  EXPECT_TRUE(desk.manual.stop_all().ok());
}

TEST_F(ManualTable, EndOfInputStops) {
  Desk desk;
  ready(desk);
  ASSERT_TRUE(desk.manual.move_absolute(Axis::roll, 90.0, 10.0, 10.0).ok());
  desk.type("89");  // refused
  EXPECT_EQ(::write(desk.pipe_[1], "90", 2), 2);  // without a line end: no answer
  desk.hang_up();
  const Result<AxisStatus> ended = desk.manual.status(Axis::roll);
  ASSERT_FALSE(ended.ok());
  EXPECT_EQ(ended.error().kind, ErrorKind::device);
  EXPECT_NE(ended.error().message.find("end of input"), std::string::npos);
  EXPECT_FALSE(desk.manual.move_absolute(Axis::roll, 90.0, 10.0, 10.0).ok());
  EXPECT_TRUE(desk.manual.stop_all().ok());
}

TEST_F(ManualTable, StopInMidTurnMeansNotInPosition) {
  Desk desk;
  ready(desk);
  ASSERT_TRUE(desk.manual.move_absolute(Axis::roll, 90.0, 10.0, 10.0).ok());
  ASSERT_TRUE(desk.manual.stop_all().ok());
  EXPECT_FALSE(desk.manual.status(Axis::roll)->in_position);
  EXPECT_TRUE(desk.manual.status(Axis::pitch)->in_position);
  desk.type("90");
  EXPECT_NEAR(desk.manual.status(Axis::roll)->position_deg, 0.0, 1e-12) << "nothing was asked";
}

// Pitch 30 deg, roll -45 deg: f/g = (sin 30, cos 30 cos 45, cos 30 sin 45) = (0.5, 0.61237, 0.61237).
TEST_F(ManualTable, GravityHasToAgree) {
  std::optional<std::array<double, 3>> sensed = std::array<double, 3>{0.0, 9.79, 0.0};
  Desk desk({}, [&] { return sensed; });
  ready(desk);
  ASSERT_TRUE(desk.manual.move_absolute(Axis::pitch, 30.0, 10.0, 10.0).ok());
  desk.type("30");
  EXPECT_TRUE(desk.manual.status(Axis::pitch)->moving) << "still level";
  EXPECT_NE(desk.said().find("senses gravity 30 deg away"), std::string::npos);
  sensed = std::array<double, 3>{-0.5 * 9.79, std::cos(0.5236) * 9.79, 0.0};  // turned the wrong way
  desk.type("30");
  EXPECT_TRUE(desk.manual.status(Axis::pitch)->moving);
  EXPECT_NE(desk.said().find("60 deg away"), std::string::npos);
  sensed = std::array<double, 3>{0.5 * 9.79, std::cos(0.5236) * 9.79, 0.0};
  desk.type("30");
  EXPECT_FALSE(desk.manual.status(Axis::pitch)->moving);
  ASSERT_TRUE(desk.manual.move_absolute(Axis::roll, -45.0, 10.0, 10.0).ok());
  sensed = std::array<double, 3>{0.5, 0.61237, 0.61237};
  desk.type("-45");
  EXPECT_FALSE(desk.manual.status(Axis::roll)->moving) << desk.said();
  // Where nothing is sensed there is nothing to compare with; a unit that says zero is off.
  sensed.reset();
  ASSERT_TRUE(desk.manual.move_absolute(Axis::roll, 0.0, 10.0, 10.0).ok());
  desk.type("0");
  EXPECT_FALSE(desk.manual.status(Axis::roll)->moving);
  sensed = std::array<double, 3>{};
  ASSERT_TRUE(desk.manual.move_absolute(Axis::roll, 10.0, 10.0, 10.0).ok());
  desk.type("10");
  EXPECT_TRUE(desk.manual.status(Axis::roll)->moving);
  // Heading cannot be seen by gravity.
  ASSERT_TRUE(desk.manual.stop_all().ok());
  ASSERT_TRUE(desk.manual.move_absolute(Axis::heading, 90.0, 10.0, 10.0).ok());
  desk.type("90");
  EXPECT_FALSE(desk.manual.status(Axis::heading)->moving);
}

}  // namespace
}  // namespace turncal
