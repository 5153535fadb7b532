// Which word a mistyped one is taken for, and when none is.
#include "imu_io/base/text_pieces.h"

#include <gtest/gtest.h>

namespace turncal {
namespace {

TEST(ClosestWord, DistanceCountsEveryKindOfSlip) {
  EXPECT_EQ(edit_distance("run", "run"), 0U);
  EXPECT_EQ(edit_distance("", "run"), 3U);
  EXPECT_EQ(edit_distance("rn", "run"), 1U);
  EXPECT_EQ(edit_distance("rrun", "run"), 1U);
  EXPECT_EQ(edit_distance("rum", "run"), 1U);
  EXPECT_EQ(edit_distance("rnu", "run"), 1U) << "neighbours swapped";
  EXPECT_EQ(edit_distance("kitten", "sitting"), 3U);
  EXPECT_EQ(edit_distance("ca", "abc"), 3U) << "no stretch is edited twice";
}

TEST(ClosestWord, OnlyACloseWordIsMeant) {
  const std::vector<std::string> known = {"calibrate", "certificate", "run", "resume"};
  EXPECT_EQ(did_you_mean("rnu", known), "; did you mean 'run'?");
  EXPECT_EQ(did_you_mean("calbirate", known), "; did you mean 'calibrate'?");
  EXPECT_EQ(did_you_mean("certifciat", known), "; did you mean 'certificate'?");
  EXPECT_EQ(did_you_mean("prun", {"run", "prune"}), "; did you mean 'prune'?") << "the first letter is seldom wrong";
  EXPECT_EQ(did_you_mean("walk", known), "");
  EXPECT_EQ(did_you_mean("xy", known), "");
  EXPECT_EQ(did_you_mean("", known), "");
  EXPECT_EQ(did_you_mean(std::string(100000, 'r'), known), "");
}

}  // namespace
}  // namespace turncal
