// The devices of a dry run: rigs in lockstep behind one table, an IMU for each unit, and the clock, so that station time is virtual.
#pragma once

#include <span>

#include "orchestrator/records/journal_contents.h"
#include "orchestrator/run/station_run.h"
#include "turntable_drivers/rig/rig_group.h"

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

}  // namespace turncal
