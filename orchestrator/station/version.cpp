#include "orchestrator/station/version.h"

namespace turncal {

const char* software_version() { return TURNCAL_VERSION; }

}  // namespace turncal
