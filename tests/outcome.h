// What came of a call, said in full when it is not what was expected.
#pragma once

#include <gtest/gtest.h>

#include <string>
#include <string_view>

#include "calib/types/status.h"

namespace turncal {

// The text has this part.
inline testing::AssertionResult says(std::string_view text, std::string_view part) {
  if (text.find(part) == std::string_view::npos)
    return testing::AssertionFailure() << "not said: '" << part << "' in:\n" << text;
  return testing::AssertionSuccess() << "said: '" << part << "' in:\n" << text;
}

// Of a Status or a Result.
template <class Outcome>
testing::AssertionResult succeeds(const Outcome& outcome) {
  if (outcome.ok()) return testing::AssertionSuccess() << "no error";
  return testing::AssertionFailure() << outcome.error().message;
}

template <class Outcome>
testing::AssertionResult fails(const Outcome& outcome, std::string_view part = "") {
  if (outcome.ok()) return testing::AssertionFailure() << "no error, '" << part << "' was expected";
  return says(outcome.error().message, part);
}
template <class Outcome>
testing::AssertionResult fails(const Outcome& outcome, ErrorKind kind, std::string_view part = "") {
  if (outcome.ok() || outcome.error().kind == kind) return fails(outcome, part);
  return testing::AssertionFailure() << "of another kind: " << outcome.error().message;
}

// An empty value and a failure where there is none.
template <class T>
T expect_value(const Result<T>& result) {
  EXPECT_TRUE(succeeds(result));
  return result.ok() ? *result : T();
}

// The text with the one in place of the other, which must be there; of nothing: behind all of it.
inline std::string replaced(std::string text, const std::string& what, const std::string& with) {
  if (what.empty()) return text + with;
  const std::size_t at = text.find(what);
  EXPECT_NE(at, std::string::npos) << "no '" << what << "'";
  return at == std::string::npos ? text : text.replace(at, what.size(), with);
}

}  // namespace turncal

#define EXPECT_SAYS(...) EXPECT_TRUE(::turncal::says(__VA_ARGS__))
#define EXPECT_SAYS_NOT(...) EXPECT_FALSE(::turncal::says(__VA_ARGS__))
#define ASSERT_SAYS(...) ASSERT_TRUE(::turncal::says(__VA_ARGS__))
#define ASSERT_OK(...) ASSERT_TRUE(::turncal::succeeds((__VA_ARGS__)))
#define EXPECT_OK(...) EXPECT_TRUE(::turncal::succeeds((__VA_ARGS__)))
// The whole line, so that a change of wording is a decision.
#define EXPECT_ERROR(expression, text)                               \
  do {                                                               \
    const auto& checked_ = (expression);                             \
    EXPECT_FALSE(checked_.ok()) << "expected the error: " << (text); \
    if (!checked_.ok()) {                                            \
      EXPECT_EQ(checked_.error().message, (text));                   \
    }                                                                \
  } while (false)
