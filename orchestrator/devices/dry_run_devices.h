// The devices of a dry run: rigs in lockstep behind one table, an IMU for each unit, and the clock, so that station time is virtual.
#pragma once

#include <ostream>
#include <span>

#include "orchestrator/devices/gravity_watch.h"
#include "orchestrator/devices/operator_prompts.h"
#include "orchestrator/records/journal.h"
#include "orchestrator/run/station_run.h"
#include "orchestrator/station/station_config.h"
#include "turntable_drivers/manual/manual_turntable.h"
#include "turntable_drivers/rig/rig_group.h"
#include "turntable_drivers/table/limited_turntable.h"

namespace turncal {

class DryRunDevices {
 public:
  explicit DryRunDevices(const RigConfig& config, std::size_t units = 1)
      : group(config, units), rig(group.rig(0)), table(group.table()), imu(group.imu(0)), clock(group) {}
  DryRunDevices(const DryRunDevices&) = delete;
  DryRunDevices& operator=(const DryRunDevices&) = delete;

  // Valid as long as this object.
  StationDevices devices();

  // For a run that goes on: brings fresh rigs to the moment `until_s` of a run that gave these commands at these times. All
  // that a rig is (angles, noise, temperature, faults) follows from its configuration, the commands and the samples passed,
  // so the next sample is the one that the interrupted run would have seen. An error when the table refuses a command.
  Status put_back(std::span<const JournalCommand> commands, double until_s);

  RigGroup group;
  Rig& rig;  // of the first unit
  Turntable& table;
  ImuSource& imu;
  Clock& clock;

 private:
  void wait(double seconds);  // time passes and nobody reads the unit
};

// The devices of a rehearsal: a run by hand on the rig (`run --manual --dry-run`). The angle that the operator types is where the rig is
// turned to, its unit feels it, and gravity is compared as in a live run. Time is the rig's, and stands still while somebody thinks.
//
// A rehearsal that is taken up again is a rig of its own: at the time of the last completed dwell (so that noise and temperature go
// on), at 0 on all axes. It is asked for, rests, and goes on as a live run does.
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
