#include "orchestrator/devices/dry_run_devices.h"

#include <algorithm>

namespace turncal {

StationDevices DryRunDevices::devices() {
  return {table, imu, clock, [this](double seconds) { wait(seconds); }};
}

void DryRunDevices::wait(double seconds) {
  group.pass_until(group.now_s() + std::max(seconds, rig.config().sample_period_s));
}

Status DryRunDevices::put_back(std::span<const JournalCommand> commands, double until_s) {
  if (Status status = table.connect(); !status) return status;
  if (Status status = table.enable(); !status) return status;
  for (const JournalCommand& command : commands) {
    group.pass_until(command.time_s);
    const Status given = command.move ? table.move_absolute(command.move->axis, command.move->target_deg,
                                                            command.move->rate_degps, command.move->acceleration_degps2)
                                      : table.home();
    if (!given) return given;
  }
  group.pass_until(until_s);
  const Result<AxisStatus> status = table.status(Axis::heading);  // a table notices only when it is asked
  return status ? Status{} : Status{status.error()};
}

}  // namespace turncal
