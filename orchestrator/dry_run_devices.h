// The devices of a dry run: one rig behind the table, the IMU and the clock, so that station time is virtual.
#pragma once

#include <span>

#include "orchestrator/journal_file.h"
#include "orchestrator/station_run.h"
#include "turntable_drivers/rig.h"
#include "turntable_drivers/rig_clock.h"
#include "turntable_drivers/rig_imu.h"
#include "turntable_drivers/rig_table.h"

namespace turncal {

class DryRunDevices {
 public:
  explicit DryRunDevices(const RigConfig& config) : rig(config), table(rig), imu(rig), clock(rig) {}
  DryRunDevices(const DryRunDevices&) = delete;
  DryRunDevices& operator=(const DryRunDevices&) = delete;

  // Valid as long as this object.
  StationDevices devices();

  // For a run that goes on: brings a fresh rig to the moment `until_s` of a run that gave these commands at these times. All
  // that the rig is (angles, noise, temperature, faults) follows from its configuration, the commands and the samples passed,
  // so the next sample is the one that the interrupted run would have seen. An error when the table refuses a command.
  Status put_back(std::span<const JournalCommand> commands, double until_s);

  Rig rig;
  RigTable table;
  RigImu imu;
  RigClock clock;

 private:
  void wait(double seconds);  // time passes and nobody reads the unit
  void pass_until(double time_s);
};

}  // namespace turncal
