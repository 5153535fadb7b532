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
  pass_until(rig.time_s() + std::max(seconds, period_s));
}

void DryRunDevices::pass_until(double time_s) {
  const double period_s = rig.config().sample_period_s;
  std::array<ImuSample, 256> unread;
  for (;;) {
    const auto left = static_cast<std::int64_t>(std::llround((time_s - rig.time_s()) / period_s));
    if (left <= 0) return;
    // An unplugged unit holds the rig's time; its source stays closed all the same.
    if (rig.imu_unplugged()) rig.plug_imu();
    rig.advance_time(std::min<std::int64_t>(left, unread.size()), unread);
  }
}

Status DryRunDevices::put_back(std::span<const JournalCommand> commands, double until_s) {
  if (Status status = table.connect(); !status) return status;
  if (Status status = table.enable(); !status) return status;
  for (const JournalCommand& command : commands) {
    pass_until(command.time_s);
    const Status given = command.move ? table.move_absolute(command.move->axis, command.move->target_deg,
                                                            command.move->rate_degps, command.move->acceleration_degps2)
                                      : table.home();
    if (!given) return given;
  }
  pass_until(until_s);
  const Result<AxisStatus> status = table.status(Axis::heading);  // a table notices only when it is asked
  return status ? Status{} : Status{status.error()};
}

}  // namespace turncal
