// The version of this program, as it stands in every file it writes.
#pragma once

namespace turncal {

const char* software_version();

}  // namespace turncal
