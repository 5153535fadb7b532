// Texts with something changed and the whole message that comes of each, in files of rows, which read better than C++ around them:
//
//   [NAME]                  the text that the rows below begin from
//   WHAT => WITH => SAID    replaced() in it, with \n, \r and \\; SAID: the error's message, or "accepted"
//   # a remark
#pragma once

#include "tests/test.h"

namespace turncal {

// `said_of(name, what, with)` gives the message. `path`: below tests.
template <class SaidOf>
void expect_said(const std::string& path, SaidOf said_of) {
  std::ifstream file(TURNCAL_SOURCE_DIR "/tests/" + path);
  std::string row, name;
  int line = 0, rows = 0;
  while (std::getline(file, row)) {
    ++line;
    if (row.empty() || row[0] == '#') continue;
    if (row[0] == '[') {
      name = row.substr(1, row.size() - 2);
      continue;
    }
    const std::size_t with = row.find("=> "), said = row.find("=> ", with + 1);
    ASSERT_NE(said, std::string::npos) << path << ":" << line << ": expected WHAT => WITH => SAID";
    const auto cell = [&](std::size_t from, std::size_t to) {
      std::string text;
      for (; from + 1 < to; ++from) {
        const char next = row[from] == '\\' ? row[++from] : '\0';
        text += next == 'n' ? '\n' : next == 'r' ? '\r' : next != '\0' ? next : row[from];
      }
      return text;
    };
    EXPECT_EQ(said_of(name, cell(0, with), cell(with + 3, said)), row.substr(said + 3)) << path << ":" << line;
    ++rows;
  }
  EXPECT_GT(rows, 0) << path;
}

// Of a Status or a Result.
template <class Outcome>
std::string said_of(const Outcome& outcome) {
  if (outcome.ok()) return "accepted";
  EXPECT_EQ(outcome.error().kind, ErrorKind::input);
  EXPECT_SAYS_NOT(outcome.error().message, "\n");
  return outcome.error().message;
}

}  // namespace turncal
