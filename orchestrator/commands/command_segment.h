// Data without a table: `turncal import --map MAP CSV --out DIR` reads any CSV into a recording without segments, and
// `turncal segment RECORDING --out DIR` finds its rests, prints them with the threshold and the reason for it, and
// writes the recording with segments static and rotate, all angles 0. Nothing is overwritten.
#pragma once

#include <string>

#include "orchestrator/jobs/command_context.h"

namespace turncal {

// What `import` does when it is given a map.
Status import_mapped_csv(const std::string& map, const std::string& csv, const std::string& out,
                         CommandContext& context);

}  // namespace turncal
