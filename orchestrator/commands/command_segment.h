// Data without a table: `turncal import --map MAP CSV --out DIR` reads any CSV, .npy or .mat into a recording without segments, and
// `turncal segment RECORDING --out DIR` finds its rests, prints them with the threshold and the reason for it, and
// writes the recording with segments static and rotate, all angles 0. Nothing is overwritten.
#pragma once

#include <string>

#include "orchestrator/jobs/command_context.h"

namespace turncal {

// What `import` does when it is given a map.
struct MappedImport {
  std::string map;
  std::string file;
  std::string accel;  // of the accelerometers, where they have a file of their own
  bool skip_bad_rows = false;
};
Status import_mapped_csv(const MappedImport& from, const std::string& out, CommandContext& context);

}  // namespace turncal
