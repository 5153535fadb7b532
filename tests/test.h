// What every test uses: the standard headers, what came of a call said in full when it is not what was expected, files and folders.
#pragma once

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iomanip>
#include <iostream>
#include <iterator>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <numbers>
#include <numeric>
#include <optional>
#include <random>
#include <set>
#include <span>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <system_error>
#include <tuple>
#include <type_traits>
#include <utility>
#include <vector>

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

// The same Result or Status where there is no error; with one the test ends, and says where and why.
template <class Outcome>
Outcome good(Outcome outcome, const char* file = __builtin_FILE(), int line = __builtin_LINE()) {
  if (outcome.ok()) return outcome;
  throw std::runtime_error(std::string(file) + ":" + std::to_string(line) + ": " + outcome.error().message);
}

// The text with the one in place of the other, which must be there; of nothing: behind all of it.
inline std::string replaced(std::string text, const std::string& what, const std::string& with) {
  if (what.empty()) return text + with;
  const std::size_t at = text.find(what);
  EXPECT_NE(at, std::string::npos) << "no '" << what << "'";
  return at == std::string::npos ? text : text.replace(at, what.size(), with);
}

// A text of keys with these lines, in place of those with the same key.
inline std::string with_keys(std::string text, const std::string& more) {
  std::istringstream lines(more);
  for (std::string line; std::getline(lines, line);) {
    const std::size_t old = text.find("\n" + line.substr(0, line.find('=') + 1));
    if (old != std::string::npos) text.erase(old, text.find('\n', old + 1) - old);
    text += line + "\n";
  }
  return text;
}

// A folder of its own for a test, removed at the end. In memory where there is such a file system: tests sync thousands of times.
class TemporaryFolder {
 public:
  TemporaryFolder() {
    const std::filesystem::path memory = "/dev/shm";
    std::error_code ignored;
    const bool in_memory = std::filesystem::is_directory(memory, ignored) && ::access(memory.c_str(), W_OK) == 0;
    std::string pattern =
        ((in_memory ? memory : std::filesystem::temp_directory_path()) / "turncal_test_XXXXXX").string();
    if (::mkdtemp(pattern.data()) == nullptr) std::abort();
    path_ = pattern;
  }
  ~TemporaryFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;

  const std::string& path() const { return path_; }
  std::string operator/(const std::string& name) const { return path_ + "/" + name; }

  std::vector<std::string> names() const {
    std::vector<std::string> result;
    for (const auto& entry : std::filesystem::directory_iterator(path_)) result.push_back(entry.path().filename());
    return result;
  }

 private:
  std::string path_;
};

// A disk that is full, as far as a test can have one: no file may grow beyond `bytes`.
class FileSizeLimit {
 public:
  explicit FileSizeLimit(rlim_t bytes) {
    previous_handler_ = std::signal(SIGXFSZ, SIG_IGN);
    getrlimit(RLIMIT_FSIZE, &previous_);
    rlimit limit = previous_;
    limit.rlim_cur = bytes;
    setrlimit(RLIMIT_FSIZE, &limit);
  }
  ~FileSizeLimit() {
    setrlimit(RLIMIT_FSIZE, &previous_);
    std::signal(SIGXFSZ, previous_handler_);
  }

 private:
  rlimit previous_{};
  void (*previous_handler_)(int) = nullptr;
};

inline void write_file(const std::filesystem::path& path, const std::string& content) {
  std::ofstream(path, std::ios::binary) << content;
}

inline std::string file_text(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
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
