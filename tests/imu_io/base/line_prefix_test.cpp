#include "imu_io/base/console.h"

#include <sstream>

#include <gtest/gtest.h>

namespace turncal {
namespace {

TEST(LinePrefix, StandsInFrontOfEveryLineWhileItLives) {
  std::ostringstream out;
  out << "before\n";
  {
    const LinePrefix marked(out, "[t] ");
    out << "one\n\nt"
        << "wo" << std::endl
        << "three";
    out << ", and on\n";
  }
  out << "after\n";
  EXPECT_EQ(out.str(), "before\n[t] one\n[t]\n[t] two\n[t] three, and on\nafter\n");
}

TEST(LinePrefix, ALineDrawnAgainHasItAgain) {
  std::ostringstream out;
  const LinePrefix marked(out, "[t] ");
  out << "\r10 %"
      << "\r11 %"
      << "\x1b[2K\r"
      << "done\n";
  EXPECT_EQ(out.str(), "\r[t] 10 %\r[t] 11 %\x1b[2K\r[t] done\n");
}

TEST(LinePrefix, OneWithinAnotherStandsSecond) {
  std::ostringstream out;
  const LinePrefix outer(out, "[a] ");
  {
    const LinePrefix inner(out, "[b] ");
    out << "x\n";
  }
  out << "y\n";
  EXPECT_EQ(out.str(), "[a] [b] x\n[a] y\n");
}

TEST(LinePrefix, NoneChangesNothingAndAFailureStays) {
  std::ostringstream out;
  {
    const LinePrefix none(out, "");
    out << "x\n";
  }
  EXPECT_EQ(out.str(), "x\n");
  std::ostringstream broken;
  {
    const LinePrefix marked(broken, "[t] ");
    broken.setstate(std::ios::badbit);
  }
  EXPECT_TRUE(broken.bad());
}

}  // namespace
}  // namespace turncal
