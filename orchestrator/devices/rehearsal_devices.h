// The devices of a rehearsal: a run by hand on the rig (`run --manual --dry-run`). The angle that the operator types is where the rig is
// turned to, its unit feels it, and gravity is compared as in a live run. Time is the rig's, and stands still while somebody thinks.
//
// A rehearsal that is taken up again is a rig of its own: at the time of the last completed dwell (so that noise and temperature go
// on), at 0 on all axes. It is asked for, rests, and goes on as a live run does.
#pragma once

#include <ostream>

#include "orchestrator/devices/dry_run_devices.h"
#include "orchestrator/devices/gravity_watch.h"
#include "orchestrator/devices/operator_prompts.h"
#include "orchestrator/station/station_config.h"
#include "turntable_drivers/manual/manual_turntable.h"
#include "turntable_drivers/table/limited_turntable.h"

namespace turncal {

class RehearsalDevices {
 public:
  // `input`: file descriptor of the answers. The stream must outlive the devices.
  RehearsalDevices(const RigConfig& config, const StationConfig& station, int input, std::ostream& out);
  RehearsalDevices(const RehearsalDevices&) = delete;
  RehearsalDevices& operator=(const RehearsalDevices&) = delete;

  StationDevices devices();  // valid as long as this object
  Status pass_until(double time_s) { return rig_.put_back({}, time_s); }
  OperatorPrompts& prompts() { return prompts_; }

 private:
  DryRunDevices rig_;
  GravityWatch watched_;
  ManualTurntable manual_;
  LimitedTurntable limited_;
  OperatorPrompts prompts_;
};

}  // namespace turncal
