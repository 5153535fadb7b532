// The fourteen steps and the north seeking, compiled into the program, so that it runs wherever it is copied to. The texts are those
// of sequences/fourteen_step.seq and sequences/verify.seq at build time.
#pragma once

#include <string_view>

namespace turncal {

extern const std::string_view builtin_sequence_text;
inline constexpr const char* builtin_sequence_name = "built-in fourteen_step.seq";

extern const std::string_view builtin_verify_text;
// Given for a file it means that text; in a journal, too.
inline constexpr const char* builtin_verify_name = "built-in verify.seq";

}  // namespace turncal
