// For tests: what a text says.
#pragma once

#include <gtest/gtest.h>

#include <string_view>

namespace turncal::test {

inline testing::AssertionResult says(const char*, const char*, std::string_view text, std::string_view part) {
  if (text.find(part) != std::string_view::npos) return testing::AssertionSuccess();
  return testing::AssertionFailure() << "not said: '" << part << "' in:\n" << text;
}
inline testing::AssertionResult says_not(const char*, const char*, std::string_view text, std::string_view part) {
  if (text.find(part) == std::string_view::npos) return testing::AssertionSuccess();
  return testing::AssertionFailure() << "said: '" << part << "' in:\n" << text;
}

}  // namespace turncal::test

#define EXPECT_SAYS(text, part) EXPECT_PRED_FORMAT2(::turncal::test::says, text, part)
#define EXPECT_SAYS_NOT(text, part) EXPECT_PRED_FORMAT2(::turncal::test::says_not, text, part)
#define ASSERT_SAYS(text, part) ASSERT_PRED_FORMAT2(::turncal::test::says, text, part)
