// A frame's text without the marks that say where its lines come from, so that lines can be found in it.
#pragma once

#include <regex>
#include <string>
#include <string_view>

namespace turncal {

inline std::string unmarked(std::string_view text) {
  return std::regex_replace(std::string(text), std::regex(" +# \\[[a-z]+\\]"), "");
}

}  // namespace turncal
