// The fourteen steps, compiled into the program, so that it runs wherever it is copied to. The text is that of
// sequences/fourteen_step.seq at build time.
#pragma once

namespace turncal {

const char* builtin_sequence_text();
const char* builtin_sequence_name();

}  // namespace turncal
