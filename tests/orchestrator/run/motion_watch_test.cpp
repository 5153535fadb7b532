#include <gtest/gtest.h>

#include "orchestrator/run/motion_watch.h"

namespace turncal {
namespace {

constexpr std::array<AxisLimits, 3> limits = {AxisLimits{}, AxisLimits{-10.0, 10.0}, AxisLimits{}};

TableStatus at(double time_s, double heading_deg, double pitch_deg, double pitch_rate_degps = 0.0) {
  TableStatus axes{};
  for (AxisStatus& axis : axes) axis.time_s = time_s;
  axes[0].position_deg = heading_deg;
  axes[1].position_deg = pitch_deg;
  axes[1].rate_degps = pitch_rate_degps;
  return axes;
}

// There and back within its travel, with an angle that is set anew at the zero.
TEST(HomingWatch, ASearchWithinTheTravelIsNone) {
  HomingWatch watch(limits);
  double time_s = 0.0;
  for (double pitch = 9.0; pitch > -10.0; pitch -= 0.5) EXPECT_FALSE(watch.add(at(time_s += 0.1, 50.0, pitch, -5.0)));
  for (double pitch = -10.0; pitch < 0.0; pitch += 0.5) EXPECT_FALSE(watch.add(at(time_s += 0.1, 50.0, pitch, 5.0)));
  EXPECT_FALSE(watch.add(at(time_s += 0.1, -300.0, 0.0))) << "350 deg in 0.1 s is another zero";
}

TEST(HomingWatch, AnAxisThatPassesItsZeroIsSaidByItsAngle) {
  HomingWatch watch(limits);
  double turned = 0.0, time_s = 0.0;
  std::optional<std::string> said;
  for (; !said && turned < 5000.0; turned += 1.0) said = watch.add(at(time_s += 0.1, turned, 0.0));
  ASSERT_TRUE(said);
  EXPECT_NEAR(turned, 1440.0, 3.0) << "its travel of 1080 deg, and a turn";
  EXPECT_EQ(*said, "heading does not find its zero: it has turned 1441 deg, its travel is 1080 deg");
}

// Of an axis whose angle stands still, or is a code within one turn.
TEST(HomingWatch, AnAxisThatPassesItsZeroIsSaidByItsRate) {
  HomingWatch watch(limits);
  double time_s = 0.0;
  std::optional<std::string> said;
  while (!said && time_s < 100.0) said = watch.add(at(time_s += 0.1, 0.0, 3.0, -2.0));
  ASSERT_TRUE(said);
  EXPECT_NEAR(time_s, 20.0, 0.5) << "twice its travel of 20 deg";
}

// One axis after the other, each within its time; then one whose drive never begins.
TEST(HomingWatch, AnAxisThatDoesNotBeginIsSaid) {
  HomingWatch watch(limits);
  double time_s = 0.0;
  TableStatus axes = at(time_s, 50.0, 7.0);
  for (AxisStatus& axis : axes) {
    axis.homed = axis.moving = false;
    axis.rate_degps = std::numeric_limits<double>::quiet_NaN();  // not told
  }
  const auto pass = [&](double seconds) {
    std::optional<std::string> said;
    for (const double end_s = time_s + seconds; !said && time_s < end_s;) {
      for (AxisStatus& axis : axes) axis.time_s = time_s;
      said = watch.add(axes);
      time_s += 0.5;
    }
    return said;
  };
  EXPECT_EQ(pass(19.0), std::nullopt);
  axes[0].moving = true;
  EXPECT_EQ(pass(30.0), std::nullopt);
  axes[0].homed = true;
  axes[0].moving = false;
  EXPECT_EQ(pass(19.0), std::nullopt);
  axes[2].position_deg = 3.0;  // it moved
  EXPECT_EQ(pass(19.0), std::nullopt);
  axes[2].homed = true;
  EXPECT_EQ(pass(19.0).value_or(""),
            "pitch does not look for its zero: it stands at 7.0000 deg, and nothing has turned for 20 s");
  axes[1].homed = true;
  EXPECT_EQ(pass(30.0), std::nullopt);
}

}  // namespace
}  // namespace turncal
