// Words of one line of a sequence file, with the column each begins at.
//
// A line is words separated by blanks; `"..."` is one title; `=` stands alone; `#` outside a title starts a comment.
// Columns count bytes from 1.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "calib/types/axis.h"
#include "calib/types/status.h"

namespace turncal {

struct Token {
  enum class Kind { word, title, equals, end } kind = Kind::end;  // end: after the last word of the line
  std::string_view text;                                          // a title without its quotes; empty at the end
  int column = 1;
};

// Where in which file, and how an error there is written: "file:line:column: found X, expected Y".
struct Place {
  std::string_view file;
  int line = 1;
  int column = 1;
};
Error unexpected(const Place& place, const Token& found, std::string_view expected);
Error problem_at(const Place& place, std::string_view what);

// The tokens of `line`, always closed by an end token. Views point into `line`.
Result<std::vector<Token>> tokenize(std::string_view line, std::string_view file, int line_number);

// The word as a value; nothing for anything else (a title, a sign too many, digits left over, overflow, inf or NaN).
std::optional<double> as_number(const Token& token);
std::optional<std::int64_t> as_integer(const Token& token);
std::optional<Axis> as_axis(const Token& token);  // H, P, R, heading, pitch, roll
bool is_word(const Token& token, std::string_view word);

// The token as it is shown to the user: quoted, at most 40 bytes, nothing unprintable.
std::string shown(const Token& token);

}  // namespace turncal
