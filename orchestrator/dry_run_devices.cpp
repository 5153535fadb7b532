#include "orchestrator/dry_run_devices.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace turncal {

StationDevices DryRunDevices::devices() {
  return {table, imu, clock, [this](double seconds) { wait(seconds); }};
}

void DryRunDevices::wait(double seconds) {
  const double period_s = rig.config().sample_period_s;
  const double end_s = rig.time_s() + std::max(seconds, period_s) - 0.5 * period_s;
  std::array<ImuSample, 4> unread;
  while (rig.time_s() < end_s) {
    // An unplugged unit holds the rig's time; its source stays closed all the same.
    if (rig.imu_unplugged()) rig.plug_imu();
    rig.advance_time(1, unread);
  }
}

}  // namespace turncal
