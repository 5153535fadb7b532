// An axis whose rate or moving bit is dead is found while it is commissioned, and one in order is not.
#include "orchestrator/devices/commissioning.h"
#include "tests/outcome.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>

namespace turncal {
namespace {

// A turn of 5 deg at 1 deg/s and 2 deg/s^2, polled 0.1 s apart; what is told of the rate is that times `scale`.
Status judged(double scale, bool says_moving, double poll_s = 0.1) {
  const auto at = [&](double t) {
    AxisStatus axis;
    const double end_s = 5.5, ramp_s = 0.5;
    const double up = std::min(t, ramp_s), down = std::clamp(end_s - t, 0.0, ramp_s);
    axis.time_s = t;
    axis.rate_degps = std::min({2.0 * up, 1.0, 2.0 * down});
    axis.position_deg = t <= ramp_s ? t * t : t <= end_s - ramp_s ? 0.25 + (t - ramp_s) : 5.0 - down * down;
    axis.moving = says_moving && axis.rate_degps > 0.0;
    axis.rate_degps *= scale;
    return axis;
  };
  RateCheck check(at(0.0));
  for (double t = poll_s; t < 6.0; t += poll_s) check.add(at(t));
  return check.judge(Axis::pitch, 0.3);
}

TEST(RateCheck, ARateThatIsToldIsFine) {
  EXPECT_TRUE(judged(1.0, true).ok());
  EXPECT_TRUE(judged(1.25, true).ok()) << "within the tolerance";
}

TEST(RateCheck, ADeadRateIsNamed) {
  for (const double scale : {0.0, -1.0, 0.1, 60.0, std::numeric_limits<double>::quiet_NaN()}) {
    const Status status = judged(scale, true);
    ASSERT_FALSE(status.ok()) << scale;
    EXPECT_EQ(status.error().kind, ErrorKind::input);
    EXPECT_SAYS(status.error().message, "pitch turned by +5.000 deg while its rate summed up to");
  }
}

TEST(RateCheck, ADeadMovingBitIsNamed) {
  const Status status = judged(1.0, false);
  ASSERT_FALSE(status.ok());
  EXPECT_SAYS(status.error().message, "never said so");
}

TEST(RateCheck, AFewReadingsAreNotJudged) { EXPECT_TRUE(judged(0.0, false, 1.0).ok()); }

}  // namespace
}  // namespace turncal
