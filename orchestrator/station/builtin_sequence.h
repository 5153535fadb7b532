// The fourteen steps, compiled into the program, so that it runs wherever it is copied to. The text is that of
// sequences/fourteen_step.seq at build time.
#pragma once

#include <string_view>

namespace turncal {

extern const std::string_view builtin_sequence_text;
inline constexpr const char* builtin_sequence_name = "built-in fourteen_step.seq";

}  // namespace turncal
