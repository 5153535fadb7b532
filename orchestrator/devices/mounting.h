// Before each unit of a live batch somebody or something has to mount it.
//
//   hook.mount is set       it is run (orchestrator/station/hooks.h: TURNCAL_EVENT = mount) for at most hook.mount_time_s; code 0: mounted
//   input is a terminal     the operator is asked: Enter when it is mounted, `skip REASON`, `quit`
//   neither                 hook.needs_operator is called, and the batch ends
//
// Whatever is not "mounted" or "skipped" is an error of kind interrupted that says what to do: the same command goes on with the unit.
// A dry run mounts nothing and asks nothing: its hook could move something real.
#pragma once

#include <optional>
#include <ostream>
#include <string>

#include "calib/types/status.h"
#include "orchestrator/station/station_config.h"

namespace turncal {

struct Mounted {
  std::optional<std::string> skipped;  // the reason
};

// `input`: file descriptor of the answers. A request to stop (stop_signals.h) ends the wait.
Result<Mounted> mount_unit(const StationConfig& station, const std::string& unit, const std::string& folder, int input,
                           std::ostream& out, const std::string& tag);

}  // namespace turncal
