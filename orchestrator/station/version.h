// Returns the version of this program, which stands in every file it writes.
#pragma once

namespace turncal {

const char* software_version();

}  // namespace turncal
