#include "orchestrator/run/run_observer.h"

#include "imu_io/base/clock.h"

namespace turncal {

std::string format_pause(const RunSnapshot& at) {
  std::string when;
  switch (at.state) {
    case RunState::homing: when = "after homing"; break;
    case RunState::moving: when = "after this move"; break;
    case RunState::settling: when = "after settling"; break;
    case RunState::dwelling: when = "after this dwell"; break;
    case RunState::parking:
    case RunState::calibrating: return "pause asked for: everything is recorded, the run finishes";
    default: return "paused";
  }
  if (at.item_end_utc_s > 0.0) when += ", at " + format_utc(at.item_end_utc_s).substr(11);
  return "pause asked for: " + when + "; Ctrl-C again stops now";
}

}  // namespace turncal
