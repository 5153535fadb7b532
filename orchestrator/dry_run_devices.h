// The devices of a dry run: one rig behind the table, the IMU and the clock, so that station time is virtual.
#pragma once

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

  Rig rig;
  RigTable table;
  RigImu imu;
  RigClock clock;

 private:
  void wait(double seconds);  // time passes and nobody reads the unit
};

}  // namespace turncal
