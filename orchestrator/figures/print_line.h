// A line of columns on the terminal, of at most 399 characters.
#pragma once

#include <cstdio>
#include <ostream>

namespace turncal {

template <class... Values>
void print_line(std::ostream& out, const char* format, Values... values) {
  char text[400];
  std::snprintf(text, sizeof text, format, values...);
  out << text << '\n';
}

}  // namespace turncal
